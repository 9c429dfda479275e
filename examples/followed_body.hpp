#pragma once
// A wireframe's tracker with the interface of `Tracker`, so that programs treat both alike.
#include <cmath>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/wireframe.hpp>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

template <evmarker::PoseUpdateRule Rule>
class FollowedBody {
 public:
  FollowedBody(const evmarker::PinholeCamera& camera, const evmarker::Wireframe& body,
               const evmarker::WireframeTrackerSettings<Rule>& settings)
      : size_(camera.sensor_size()), frame_(size_), tracker_(camera, body, settings) {}

  template <typename Use>
  void push(std::span<const evmarker::Event> events, const Use& use) {
    for (const evmarker::Event& event : events)
      if (size_.contains(event.x, event.y)) frame_.update(event);
    tracker_.push(events, use);
  }

  const evmarker::TrackerStatistics& statistics() const { return tracker_.statistics(); }
  const evmarker::PolarityFrame& polarity_frame() const { return frame_; }
  /// The body, unless it is lost.
  std::span<const evmarker::WireframeTracker<Rule>> markers() const {
    return {&tracker_, tracker_.searching_again() ? 0u : 1u};
  }

 private:
  evmarker::SensorSize size_;
  evmarker::PolarityFrame frame_;
  evmarker::WireframeTracker<Rule> tracker_;
};

/// Reads a body. A `start` of seven numbers, `tx,ty,tz,qx,qy,qz,qw`, replaces that of the file.
/// @throws std::runtime_error or std::invalid_argument where there is no start, or an invalid one
inline evmarker::Wireframe load_body(const std::string& path, const std::vector<double>& start) {
  evmarker::Wireframe body = evmarker::opencv::load_wireframe(path);
  if (start.empty()) {
    if (!body.start) throw std::invalid_argument(path + " has no start: give one with --start");
    return body;
  }
  for (const double value : start)
    if (!std::isfinite(value)) throw std::invalid_argument("--start has a number that is " + std::to_string(value));
  const Eigen::Quaterniond q(start[6], start[3], start[4], start[5]);
  if (!(std::abs(q.norm() - 1) < 1e-2))
    throw std::invalid_argument("--start: quaternion has length " + std::to_string(q.norm()) + ", must be 1");
  body.start = Eigen::Translation3d(start[0], start[1], start[2]) * q.normalized();
  try {
    validate_start(body.model, *body.start);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string("--") + error.what());
  }
  return body;
}
