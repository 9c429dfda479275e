// The paper's method from the first event to a verified pose, beside the library's version of it on the same events.
#include <algorithm>
#include <cstdio>
#include <evmarker/evaluation/accuracy.hpp>
#include <evmarker/events/polarity_frame.hpp>
#include <evmarker/events/spatiotemporal_filter.hpp>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/simulation/simulator.hpp>
#include <optional>

#include "paper_tracker.hpp"

using namespace evmarker;

namespace {

// The paper's tracker and the library's, with the paper's numbers, started from the same detection.
struct Trackers {
  paper::Tracker paper;
  MarkerTracker<DecoupledUpdate> library;

  Trackers(const PinholeCamera& camera, const MarkerModel& model, const Eigen::Isometry3d& T_camera_marker)
      : paper(camera, model, T_camera_marker),
        library(camera, model, T_camera_marker,
                {.events_per_update = 100, .update = DecoupledSettings::paper(), .start_search = std::nullopt}) {}
};

class Comparison {
 public:
  /// Every hundredth pose ends a way back.
  void add(Timestamp t, const Eigen::Isometry3d& truth, const Trackers& trackers) {
    add(paper_, t, trackers.paper.pose(), truth);
    add(library_, t, trackers.library.T_camera_marker(), truth);
    add(difference_, t, trackers.paper.pose(), trackers.library.T_camera_marker());
    if (poses() % 100 != 0) return;
    ++ways_back_;
    verified_ += trackers.paper.verified();
  }

  std::size_t poses() const { return paper_.poses(); }

  void print() const {
    std::printf("%zu poses; %d of %d ways back led to where they should\n", poses(), verified_, ways_back_);
    print("paper", paper_);
    print("library", library_);
    print("difference", difference_);
  }

 private:
  static void add(AccuracyMeter& meter, Timestamp t, const Eigen::Isometry3d& T, const Eigen::Isometry3d& truth) {
    meter.add({.t = t, .T_camera_marker = T, .quality = {.state = TrackingState::tracking}}, truth);
  }

  static void print(const char* what, const AccuracyMeter& meter) {
    std::printf("%-10s %6.2f mm %5.2f deg on average\n", what, meter.translation_mm().mean, meter.rotation_deg().mean);
  }

  AccuracyMeter paper_, library_, difference_;
  int ways_back_ = 0, verified_ = 0;
};

}  // namespace

int main() {
  const PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
  opencv::ArucoDetector detector(camera, {.dictionary = "DICT_4X4_50", .marker_length = 0.10});
  const auto motion = trajectory::handheld({.frequency_hz = 2});
  Simulator events(camera, {{.id = 7, .length = 0.10, .bits = detector.bits(7), .T_camera_marker = motion}});

  SpatiotemporalFilter filter(camera.sensor_size(), kPaperWindow);  // an event needs a neighbour within 2 ms
  PolarityFrame frame(camera.sensor_size());                        // in which the marker is detected once
  Timestamp next_detection = 5000;
  std::optional<Trackers> trackers;
  Comparison comparison;
  for_each_event(events, [&](const Event& event) {
    if (!filter.accept(event)) return;
    if (trackers) {
      trackers->library.push(event);
      if (trackers->paper.push(event)) comparison.add(event.t, events.T_camera_marker(0, event.t), *trackers);
      return;
    }
    frame.update(event);
    if (event.t < next_detection) return;
    next_detection = event.t + 5000;
    for (const auto& found : detector.detect(frame))
      if (!trackers) trackers.emplace(camera, detector.model(found.id), found.T_camera_marker);
  });

  if (comparison.poses() == 0) {
    std::fprintf(stderr, "paper: the marker was not found\n");
    return 1;
  }
  comparison.print();
}
