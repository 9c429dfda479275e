#pragma once
// Do the edges that move make the events that they used to make? Tells a hidden marker from one in sight.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/model/marker_model.hpp"

namespace evmarker {

/// Compares each edge's events with that edge's own history. An edge makes events by the area that it sweeps in the
/// image, times a rate of its own: printed edges differ by their contrast, those of a body by a factor of forty. One
/// that makes hardly any of what it used to make is hidden, or is not there: other things hold the wireframe.
class EdgeActivity {
 public:
  /// @param focal_length [px]
  EdgeActivity(const MarkerModel& model, double focal_length)
      : focal_length_(focal_length),
        interval_(std::clamp(20 * static_cast<int>(model.segments.size()), 60, 400)),
        events_(model.segments.size()),
        history_(events_.size()),
        begin_(events_.size()),
        end_(events_.size()) {
    for (const MarkerSegment& segment : model.segments) printed_ = printed_ && !segment.dark_side.isZero();
  }

  /// Counts an event that was matched to a segment.
  void add(int segment) noexcept {
    ++events_[static_cast<std::size_t>(segment)];
    ++total_;
  }

  /// True once there are events enough for `log_likelihood_of_loss`, which costs as much as some hundred events.
  bool due() const noexcept { return total_ >= interval_; }

  /// Logarithm of how much likelier the events since the last answer are if half of the edges are hidden than if all
  /// are in sight. Nothing before the wireframe has moved by about a pixel.
  std::optional<double> log_likelihood_of_loss(const MarkerModel& model,
                                               const Eigen::Isometry3d& T_camera_marker) noexcept {
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
      total_ = 0;  // due again after as many events, which count together with these
      return std::nullopt;
    }
    const double evidence = weigh(swept_px2);
    restart(true);
    return evidence;
  }

  /// Events that a pixel makes while an edge passes over it, by all edges; 0 before it is known.
  double events_per_px2() const noexcept { return density_; }

  /// Forgets the events since the last answer: the next one is about the motion after that.
  void restart() noexcept { restart(false); }

 private:
  static constexpr double kDistance = 1;      // [px] mean way of the edges that is enough to judge them
  static constexpr double kJitter_px = 0.5;   // an edge may seem to move that far by the error of the pose
  static constexpr double kHidden = 0.1;      // share of its events that a hidden edge makes: of what hides it
  static constexpr double kMost = 3;          // that one edge can say: its contrast may have changed
  static constexpr double kFading = 0.9;      // of the history, for every answer
  static constexpr double kLeastRate = 1e-6;  // [1/px^2]
  static constexpr double kGrazing = 0.3;     // cosine of the angle between a side's normal and the line of sight

  struct Edge {
    Eigen::Vector2d middle{0, 0}, along{0, 0};  // [px]
  };
  struct Activity {
    double events = 0, swept_px2 = 0;
  };

  double weigh(double swept_px2) noexcept {
    double all = 0, by_events = 0;
    for (std::size_t i = 0; i < end_.size(); ++i) {
      all += events_[i];
      if (swept(i) > 0) by_events += events_[i] * std::min(1.0, events_[i] / (rate(i) * swept(i)));
    }
    density_ += (density_ > 0 ? 0.1 : 1) * (all / swept_px2 - density_);
    // Motion counts as far as the edges that do make events confirm it: where a pose was moved by a prediction alone,
    // no edge is silent.
    const double confirmed = all > 0 ? by_events / all : 0;
    double evidence = 0;
    for (std::size_t i = 0; i < end_.size(); ++i) {
      const double length_px = end_[i].along.norm(), swept = confirmed * this->swept(i);
      double silent = 0;
      if (swept > kJitter_px * length_px && known(i, length_px)) silent = weigh(i, swept, kJitter_px * length_px);
      evidence += silent;
      if (silent > 0) continue;  // what is hidden says nothing about what the edge does in sight
      history_[i].events = kFading * history_[i].events + events_[i];
      history_[i].swept_px2 = kFading * history_[i].swept_px2 + swept;
    }
    return evidence;
  }

  // The events of one pixel in one passage come together: what is counted are pixels that were passed, each a trial of
  // its own. Poisson's logarithm of hidden against in sight, and even odds that the edge is among the hidden ones.
  double weigh(std::size_t i, double swept, double jitter) const noexcept {
    const double passed = events_[i] / rate(i);
    const double hidden = (1 - kHidden) * (swept - jitter) + std::log(kHidden) * passed;
    return std::log(0.5 + 0.5 * std::exp(std::clamp(hidden, -kMost, kMost)));
  }

  // Events per swept area. All edges of a printed marker have one contrast, until their own history says otherwise.
  double rate(std::size_t i) const noexcept {
    const double prior_px2 = 0.5 * end_[i].along.norm();
    return std::max(kLeastRate, (history_[i].events + prior_px2 * density_) / (history_[i].swept_px2 + prior_px2));
  }
  // Of another body, an edge that has never made events is not missed.
  bool known(std::size_t i, double length_px) const noexcept {
    return printed_ || history_[i].swept_px2 > 3 * length_px;
  }

  // Without length where it is on a side that is turned away, or nearly so: its edges are then too close to each other
  // to know whose their events are.
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
  int interval_;             // events
  bool printed_ = true;      // all edges are of one ink on one paper
  std::vector<int> events_;  // of every segment, since the last answer
  std::vector<Activity> history_;
  std::vector<Edge> begin_, end_;
  double density_ = 0;  // events per swept area [1/px^2], 0 before the first answer
  int total_ = 0;       // events since the last question
  bool started_ = false;
};

}  // namespace evmarker
