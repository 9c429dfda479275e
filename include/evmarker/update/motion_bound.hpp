#pragma once
// How far edges can have moved, by the number of events that they made.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "evmarker/update/motion_model.hpp"

namespace evmarker {

/// Bounds the motion of the edges by the number of events, noise among them: few events mean little motion.
class MotionBound {
 public:
  /// Switches the bound on.
  /// @param per_px events that all edges together make while they move by a pixel
  /// @param per_passage events that one pixel makes while an edge passes over it
  void set(double per_px, double per_passage) noexcept {
    events_per_px_ = per_px;
    events_per_passage_ = per_passage;
  }
  bool is_set() const noexcept { return events_per_px_ > 0; }
  double events_per_px() const noexcept { return events_per_px_; }
  double events_per_passage() const noexcept { return events_per_passage_; }

  /// Takes the bound away until the next one is measured.
  void lift() noexcept { most_m_ = kInfinity; }

  /// Measures the bound. Events come in passages of c = events_per_passage, so their number N has the variance N c. One
  /// passage is added to N, which may be 0.
  /// @param px_per_m by which the motion of the edges shows in the image
  void measure(int events, double px_per_m) noexcept {
    constexpr double kSafety = 6;  // for edges parallel to the motion, hidden ones, and fewer events of fast ones
    const double deviation = std::sqrt((events + events_per_passage_) * events_per_passage_);
    most_m_ = kSafety * (events + 3 * deviation) / (events_per_px_ * px_per_m);
  }

  /// How far the edges have moved at most [m]; infinite without a bound.
  double most_m() const noexcept { return most_m_; }

  /// The process noise of a step, limited to the bound and to ten turns of the marker: then nothing is known any more,
  /// and beside the larger variances of a pause of years rounding would leave a covariance that is not definite.
  /// @param acceleration density of the white acceleration of the translation [m^2/s^3]
  /// @param lever2 mean squared distance of the edges from the marker's origin [m^2]; infinite if not known
  MotionStep limited(MotionStep motion, double acceleration, double lever2) const noexcept {
    constexpr double kTenTurns = 20 * std::numbers::pi;
    const double most2 = std::min(most_m_ * most_m_, kTenTurns * kTenTurns * lever2);
    const double pose = acceleration * motion.q_pose;
    if (!(pose > most2)) return motion;
    motion.q_pose *= most2 / pose;
    motion.q_cross *= std::sqrt(most2 / pose);
    return motion;
  }

 private:
  static constexpr double kInfinity = std::numeric_limits<double>::infinity();

  double events_per_px_ = 0;  // 0: not known
  double events_per_passage_ = 1;
  double most_m_ = kInfinity;
};

}  // namespace evmarker
