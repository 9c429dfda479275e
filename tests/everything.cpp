// All that is public, made for every rule: what a compiler has to be able to compile without a word, see
// CMakeLists.txt.
#include "every_header.hpp"  // written by CMake

namespace evmarker {

using Detector = opencv::ArucoDetector<PinholeCamera>;

template class Verification<KalmanUpdate>;
template class Verification<DecoupledUpdate>;
template class EdgeFollower<KalmanUpdate>;
template class MarkerTracker<KalmanUpdate>;
template class MarkerTracker<DecoupledUpdate>;
template class PlanarHypotheses<KalmanUpdate>;
template class PlanarHypotheses<DecoupledUpdate>;
template class WireframeTracker<KalmanUpdate>;
template class WireframeTracker<DecoupledUpdate>;
template class TrackerCore<KalmanUpdate>;
template class TrackerCore<DecoupledUpdate>;
template class Tracker<Detector, KalmanUpdate>;
template class Tracker<Detector, DecoupledUpdate>;
template class BoardDetector<Detector>;
template class opencv::ArucoDetector<PinholeCamera>;
template class live::Pipeline<Detector, KalmanUpdate>;

}  // namespace evmarker

// Members that are templates themselves.
int main() {
  using namespace evmarker;
  const PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
  const Detector detector(camera, {});
  const std::vector<Event> events;
  const auto use = [](const PoseEstimate&) {};
  Tracker tracker(camera, detector);
  tracker.push(Event{});
  tracker.push(events, use);
  std::size_t updates = 0;
  for (const auto& marker : tracker.markers()) updates += static_cast<std::size_t>(marker.follower().skipped_updates());
  MarkerTracker marker(camera, make_square_marker(0.1), facing_pose({0, 0, 1}));
  marker.push(Event{});
  marker.push(events, use);
  WireframeTracker body(camera, Wireframe{.model = make_square_marker(0.1), .start = facing_pose({0, 0, 1})});
  body.push(Event{});
  body.push(events, use);
  live::Pipeline pipeline(camera, detector, use);
  pipeline.push(events);
  return static_cast<int>(updates);
}
