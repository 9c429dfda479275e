#pragma once
// Floor 2. Captures a wireframe near a rough pose, from its first events.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/event.hpp"
#include "evmarker/marker_model.hpp"
#include "evmarker/so3.hpp"

namespace evmarker {

/// How far a rough start pose may be off.
struct CaptureSettings {
  double reach_share = 0.18;    ///< sideways, of the wireframe's size in the image
  double depth_share = 0.1;     ///< of the depth
  double rotation_rad = 0.105;  ///< about the line of sight; about the other axes so small a tilt hardly matters
};

/// Collects the first events near a wireframe, from about a pixel of motion, and then looks for the pose near a rough
/// one at which its edges lie best on them: all shifts, depths and turns within reach, then all six degrees of freedom
/// in ever smaller steps. What it needs is allocated by the constructor.
class Capture {
 public:
  /// @param focal_length [px]
  Capture(const MarkerModel& model, double focal_length, const Eigen::Isometry3d& T_rough,
          const CaptureSettings& settings)
      : settings_(settings), focal_length_(focal_length), T_rough_(T_rough) {
    double length_px = 0;
    Eigen::Vector2d low = Eigen::Vector2d::Constant(std::numeric_limits<double>::infinity()), high = -low;
    for (const MarkerSegment& segment : model.segments) {
      const Eigen::Vector3d& from = model.vertices[static_cast<std::size_t>(segment.from)];
      const Eigen::Vector3d& to = model.vertices[static_cast<std::size_t>(segment.to)];
      const Eigen::Vector2d u = image(T_rough * from), v = image(T_rough * to);
      length_px += (v - u).norm();
      low = low.cwiseMin(u).cwiseMin(v);
      high = high.cwiseMax(u).cwiseMax(v);
      const int count = std::max(1, static_cast<int>((v - u).norm() / kSpacingPx));
      for (int i = 0; i < count; ++i) points_.push_back(from + (i + 0.5) / count * (to - from));
    }
    const double size_px = (high - low).maxCoeff();
    reach_px_ = settings.reach_share * size_px;
    const double margin = reach_px_ + 0.5 * settings.depth_share * size_px + kFar;
    low_ = low.array() - margin;
    width_ = static_cast<int>(high.x() - low.x() + 2 * margin) + 1;
    height_ = static_cast<int>(high.y() - low.y() + 2 * margin) + 1;
    distance_.resize(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_));
    count_.resize(distance_.size());
    events_.resize(static_cast<std::size_t>(kEventsPerPixel * length_px) + kFewestEvents);
  }

  /// Takes an event with its undistorted pixel, counted from the principal point. True once there are enough.
  bool push(const Event& event, const Eigen::Vector2d& u) noexcept {
    if (collected_ > 0 && elapsed_us(events_.front().t, event.t) > kLongest_us) restart();
    const int i = index(u);
    if (i < 0) return false;
    ++count_[static_cast<std::size_t>(i)];
    events_[collected_++] = event;
    return collected_ == events_.size();
  }

  /// The events so far; they are to be replayed from the pose that was found.
  std::span<const Event> events() const noexcept { return std::span(events_).first(collected_); }

  /// The rough pose itself where the events fit no pose near it.
  Eigen::Isometry3d solve() noexcept {
    measure_distances();
    search_within_reach();
    for (Candidate& candidate : best_) refine(candidate);
    const Candidate& found = *std::ranges::min_element(best_, {}, &Candidate::misfit_px);
    return found.misfit_px < kWorstFit ? found.T : T_rough_;
  }

 private:
  static constexpr double kSpacingPx = 5;  // of the points along the edges
  static constexpr float kFar = 6;         // [px] farther is as bad: there is no event of this edge
  static constexpr float kWorstFit = 3;    // [px] half of the edges without an event
  static constexpr double kEventsPerPixel = 2.5;
  static constexpr std::size_t kFewestEvents = 200, kRefined = 8;
  static constexpr std::uint64_t kLongest_us = 200000;  // what took longer is mostly noise

  using Vector6 = Eigen::Matrix<double, 6, 1>;

  struct Candidate {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    float misfit_px = 0;  // mean distance of the edges to the nearest event
  };

  Eigen::Vector2d image(const Eigen::Vector3d& P) const noexcept { return focal_length_ / P.z() * P.head<2>(); }

  int index(const Eigen::Vector2d& u) const noexcept {
    const Eigen::Vector2d p = u - low_;
    const bool inside = p.x() >= 0 && p.y() >= 0 && p.x() < width_ && p.y() < height_;
    return inside ? static_cast<int>(p.y()) * width_ + static_cast<int>(p.x()) : -1;
  }

  void restart() noexcept {
    collected_ = 0;
    std::ranges::fill(count_, std::uint16_t{0});
  }

  // For every pixel how far the nearest event is: a chamfer, along and against the reading direction. An edge makes
  // several events at every pixel that it passes; a single one is noise.
  void measure_distances() noexcept {
    std::ranges::transform(count_, distance_.begin(), [](std::uint16_t n) { return n > 1 ? 0.0f : kFar; });
    const auto at = [&](int x, int y) -> float& { return distance_[static_cast<std::size_t>(y * width_ + x)]; };
    const auto relax = [&](int x, int y, int dx, int dy) {
      if (x + dx < 0 || x + dx >= width_ || y + dy < 0 || y + dy >= height_) return;
      const float step = dx != 0 && dy != 0 ? 1.414f : 1.0f;
      at(x, y) = std::min(at(x, y), at(x + dx, y + dy) + step);
    };
    for (int y = 0; y < height_; ++y)
      for (int x = 0; x < width_; ++x)
        for (const auto& [dx, dy] : {std::pair(-1, 0), {0, -1}, {-1, -1}, {1, -1}}) relax(x, y, dx, dy);
    for (int y = height_ - 1; y >= 0; --y)
      for (int x = width_ - 1; x >= 0; --x)
        for (const auto& [dx, dy] : {std::pair(1, 0), {0, 1}, {1, 1}, {-1, 1}}) relax(x, y, dx, dy);
  }

  float misfit_px(const Eigen::Isometry3d& T) const noexcept {
    float sum = 0;
    for (const Eigen::Vector3d& point : points_) {
      const int i = index(image(T * point));
      sum += i < 0 ? kFar : distance_[static_cast<std::size_t>(i)];
    }
    return sum / static_cast<float>(points_.size());
  }

  // A step sideways [px in the image], along the line of sight [share of the depth], and a rotation about the origin.
  Eigen::Isometry3d moved(const Eigen::Isometry3d& T, const Vector6& step) const noexcept {
    Eigen::Isometry3d moved = T;
    moved.translation() *= 1 + step(2);
    moved.translation().head<2>() += step.head<2>() * (T.translation().z() / focal_length_);
    moved.linear() = so3_exp(step.tail<3>()) * T.linear();
    return moved;
  }

  void search_within_reach() noexcept {
    constexpr double kStepPx = 3;
    constexpr int kDepths = 3, kTurns = 2;  // to each side
    const int sideways = static_cast<int>(std::ceil(reach_px_ / kStepPx));
    best_.fill({T_rough_, std::numeric_limits<float>::infinity()});
    for (int depth = -kDepths; depth <= kDepths; ++depth)
      for (int turn = -kTurns; turn <= kTurns; ++turn)
        for (int x = -sideways; x <= sideways; ++x)
          for (int y = -sideways; y <= sideways; ++y) {
            Vector6 step;
            step << kStepPx * x, kStepPx * y, settings_.depth_share * depth / kDepths, 0, 0,
                settings_.rotation_rad * turn / kTurns;
            keep({moved(T_rough_, step), 0});
          }
  }

  // Among the best ones, if it is one of them.
  void keep(Candidate candidate) noexcept {
    candidate.misfit_px = misfit_px(candidate.T);
    const auto worse = std::ranges::upper_bound(best_, candidate.misfit_px, {}, &Candidate::misfit_px);
    if (worse == best_.end()) return;
    std::shift_right(worse, best_.end(), 1);
    *worse = candidate;
  }

  void refine(Candidate& candidate) const noexcept {
    constexpr int kHalvings = 4, kRounds = 3;
    Vector6 steps;
    steps << 1.5, 1.5, settings_.depth_share / 6, 0.05, 0.05, settings_.rotation_rad / 4;
    for (int halving = 0; halving < kHalvings; ++halving, steps /= 2)
      for (int round = 0; round < kRounds; ++round)
        for (int axis = 0; axis < 6; ++axis)
          for (const double sign : {-1.0, 1.0}) {
            const Eigen::Isometry3d T = moved(candidate.T, sign * steps(axis) * Vector6::Unit(axis));
            if (const float misfit = misfit_px(T); misfit < candidate.misfit_px) candidate = {T, misfit};
          }
  }

  CaptureSettings settings_;
  double focal_length_;
  Eigen::Isometry3d T_rough_;
  std::vector<Eigen::Vector3d> points_;  // along the edges, in the marker frame [m]
  double reach_px_ = 0;
  Eigen::Vector2d low_{0, 0};  // corner of the box that is looked at
  int width_ = 0, height_ = 0;
  std::vector<std::uint16_t> count_;  // events at every pixel of the box
  std::vector<float> distance_;       // of every pixel to the nearest event [px]
  std::vector<Event> events_;         // as many as are needed
  std::size_t collected_ = 0;         // of them
  std::array<Candidate, kRefined> best_{};
};

}  // namespace evmarker
