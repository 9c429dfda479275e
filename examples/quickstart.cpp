#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/simulation/simulator.hpp>
#include <iostream>

int main() {
  using namespace evmarker;
  const PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};  // size, fx fy cx cy [px]
  opencv::ArucoDetector detector(camera, {.dictionary = "DICT_4X4_50", .marker_length = 0.10});

  // In place of your camera or file: marker 7 in a swaying hand, 0.6 m away, for one second.
  const auto motion = trajectory::handheld({.frequency_hz = 2});
  Simulator events(camera, {{.id = 7, .length = 0.10, .bits = detector.bits(7), .T_camera_marker = motion}});

  Tracker tracker(camera, detector);
  std::optional<PoseEstimate> last;
  for_each_event(events, [&](const Event& event) {
    for (const PoseEstimate& pose : tracker.push(event)) last = pose;  // thousands a second
  });

  if (!last) return 1;
  std::cout << "marker " << last->id << " at t = " << last->t << " us is " << to_string(last->quality.state) << " at "
            << last->T_camera_marker.translation().transpose() << " m\n"
            << "truth: " << events.T_camera_marker(0, last->t).translation().transpose() << " m\n";
}
