#pragma once
// Floor 1. Do all edges that move make events? Tells a marker that is hidden from one that is followed.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/marker_model.hpp"

namespace evmarker {

/// Counts the events of every edge of a wireframe while it moves by a pixel or two. An edge makes events by its length
/// times the way it goes along its normal; one that makes hardly any is hidden, or is not there: the wireframe is held
/// by other edges, those of what passes before it for example.
class EdgeCoverage {
 public:
  /// @param focal_length [px]
  EdgeCoverage(const MarkerModel& model, double focal_length)
      : focal_length_(focal_length), events_(model.segments.size()), begin_(events_.size()), end_(events_.size()) {}

  /// Takes an event that was matched to a segment.
  void add(int segment) noexcept {
    ++events_[static_cast<std::size_t>(segment)];
    ++total_;
  }

  /// Whether it is time to ask for `silent_share`: that costs as much as some hundred events.
  bool due() const noexcept { return total_ >= kEvents; }

  /// Share of the events to be expected since the last answer that should have come from edges that made hardly any.
  /// Nothing before the wireframe has moved far enough.
  std::optional<double> silent_share(const MarkerModel& model, const Eigen::Isometry3d& T_camera_marker) noexcept {
    for (std::size_t i = 0; i < end_.size(); ++i) end_[i] = project(model, model.segments[i], T_camera_marker);
    double swept_px2 = 0, length_px = 0;
    for (std::size_t i = 0; i < end_.size(); ++i) {
      swept_px2 += swept(i);
      length_px += end_[i].along.norm();
    }
    if (!started_ || !std::isfinite(swept_px2)) {
      restart(!started_);
      return std::nullopt;
    }
    if (swept_px2 < kDistance * length_px) {
      total_ = 0;  // asked again after as many events, which count together with these
      return std::nullopt;
    }
    const double share = silent_share(swept_px2);
    restart(true);
    return share;
  }

  /// Forgets everything: the next answer is about the motion after the next `silent_share`.
  void restart() noexcept { restart(false); }

 private:
  static constexpr int kEvents = 400;
  static constexpr double kDistance = 1.5;  // [px] mean way of the edges that is enough to tell
  static constexpr double kDrift = 1;       // [px] an edge that stands still may seem to go that far: nothing tells
  static constexpr double kEnough = 8, kHardlyAny = 0.2;
  static constexpr double kGrazing = 0.3;  // cosine of the angle between a side's normal and the line of sight

  struct Edge {
    Eigen::Vector2d middle{0, 0}, along{0, 0};  // [px]
  };

  double silent_share(double swept_px2) noexcept {
    double all = 0, silent = 0;
    for (const int events : events_) all += events;
    // A wireframe that went there and back has swept more than can be seen from where it is: more events per area than
    // usual do not make its other edges silent.
    const double density = all / swept_px2, expected_density = density_ > 0 ? std::min(density, density_) : density;
    density_ += (density_ > 0 ? 0.1 : 1) * (density - density_);
    for (std::size_t i = 0; i < end_.size(); ++i) {
      const double expected = expected_density * swept(i);
      const bool moved = swept(i) > kDrift * end_[i].along.norm();
      if (moved && expected >= kEnough && events_[i] < kHardlyAny * expected) silent += swept(i) / swept_px2;
    }
    return silent;
  }

  // Without length where it is on a side that is turned away, or nearly so: its edges then are too close to each other
  // to tell whose their events are.
  Edge project(const MarkerModel& model, const MarkerSegment& segment, const Eigen::Isometry3d& T) const noexcept {
    const Eigen::Vector3d seen_at = T * model.vertices[static_cast<std::size_t>(segment.from)];
    const double toward_camera = -(T.linear() * segment.face_normal).dot(seen_at);
    if (!segment.face_normal.isZero() && toward_camera < kGrazing * seen_at.norm()) return {};
    const auto image = [&](int vertex) -> Eigen::Vector2d {
      const Eigen::Vector3d V = T * model.vertices[static_cast<std::size_t>(vertex)];
      return focal_length_ / V.z() * V.head<2>();
    };
    const Eigen::Vector2d from = image(segment.from), to = image(segment.to);
    return {(from + to) / 2, to - from};
  }

  // Area that an edge swept: its length times the way of its middle along its normal.
  double swept(std::size_t i) const noexcept {
    if (begin_[i].along.isZero()) return 0;  // it has just come into sight
    const Eigen::Vector2d way = end_[i].middle - begin_[i].middle;
    return std::abs(way.x() * end_[i].along.y() - way.y() * end_[i].along.x());
  }

  void restart(bool from_here) noexcept {
    started_ = from_here;
    total_ = 0;
    std::fill(events_.begin(), events_.end(), 0);
    std::swap(begin_, end_);
  }

  double focal_length_;
  std::vector<int> events_;  // of every segment
  std::vector<Edge> begin_, end_;
  double density_ = 0;  // usual number of events per swept area [1/px^2], 0 before the first answer
  int total_ = 0;       // events since the last question
  bool started_ = false;
};

}  // namespace evmarker
