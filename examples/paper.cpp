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

int main() {
  using namespace evmarker;
  const PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
  opencv::ArucoDetector detector(camera, {.dictionary = "DICT_4X4_50", .marker_length = 0.10});
  const auto motion = trajectory::handheld({.frequency_hz = 2});
  Simulator events(camera, {{.id = 7, .length = 0.10, .bits = detector.bits(7), .T_camera_marker = motion}});

  SpatiotemporalFilter filter(camera.sensor_size(), kPaperWindow);  // an event needs a neighbour within 2 ms
  PolarityFrame frame(camera.sensor_size());                        // on which the marker is found once
  std::optional<paper::Tracker> plain;
  std::optional<MarkerTracker<DecoupledUpdate>> library;
  AccuracyMeter plain_error, library_error, difference;
  int ways_back = 0, verified = 0;
  Timestamp looked = 0;

  const auto add = [&](AccuracyMeter& meter, Timestamp t, const Eigen::Isometry3d& T, const Eigen::Isometry3d& truth) {
    PoseEstimate pose;
    pose.t = t;
    pose.T_camera_marker = T;
    pose.quality.state = TrackingState::tracking;
    meter.add(pose, truth);
  };
  for_each_event(events, [&](const Event& event) {
    if (!filter.accept(event)) return;
    if (!plain) {
      frame.update(event);
      if (event.t - looked < 5000) return;
      looked = event.t;
      for (const MarkerDetection& found : detector.detect(frame)) {
        plain.emplace(camera, detector.model(found.id), found.T_camera_marker);
        library.emplace(
            camera, detector.model(found.id), found.T_camera_marker,
            MarkerTrackerSettings<DecoupledUpdate>{
                .events_per_update = 100, .update = DecoupledSettings::paper(), .start_search = std::nullopt});
        return;
      }
      return;
    }
    library->push(event);
    if (const auto T = plain->push(event)) {
      const Eigen::Isometry3d truth = events.T_camera_marker(0, event.t);
      add(plain_error, event.t, *T, truth);
      add(library_error, event.t, library->T_camera_marker(), truth);
      add(difference, event.t, *T, library->T_camera_marker());
      if (plain_error.poses() % 100 == 0) {
        ++ways_back;
        verified += plain->verified();
      }
    }
  });

  if (!plain || plain_error.poses() == 0) {
    std::fprintf(stderr, "paper: the marker was not found\n");
    return 1;
  }
  const auto print = [](const char* what, const AccuracyMeter& meter) {
    std::printf("%-10s %6.2f mm %5.2f deg on average\n", what, meter.translation_mm().mean, meter.rotation_deg().mean);
  };
  std::printf("%zu poses; %d of %d ways back led to where they should\n", plain_error.poses(), verified, ways_back);
  print("paper", plain_error);
  print("library", library_error);
  print("difference", difference);
}
