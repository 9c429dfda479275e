#pragma once
// Forward/backward verification: does the tracker come back to where it was? Eqs. (13) and (14).
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <utility>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/tracking/edge_follower.hpp"

namespace evmarker {

struct VerificationSettings {
  int updates = 100;              ///< k: updates of the forward tracker in a window, which is then backtracked
  int every = 2;                  ///< one window in this many is backtracked; 1: all, at twice the cost
  double max_translation_px = 5;  ///< epsilon_T
  /// epsilon_R; automatic: the paper's 0.15 rad or, if larger, three times (one per axis) max_translation_px / s, the
  /// angle at which opposite sides of a marker of s pixels move by max_translation_px against each other.
  double max_rotation_rad = kAutomatic;
  std::size_t min_events = 1000;      ///< in a window, unless brief: backtracking over fewer is mostly noise
  std::size_t max_events = 1u << 15;  ///< kept of a window; one that nearly fills this begins its way back early
};

/// @throws std::invalid_argument naming the setting that is out of range
inline void validate(const VerificationSettings& settings) {
  const Require require("verification");
  require(settings.updates >= 1, "updates", settings.updates);
  require(settings.every >= 1, "every", settings.every);
  require(settings.max_translation_px > 0, "max_translation_px", settings.max_translation_px);
  require(settings.max_rotation_rad >= 0, "max_rotation_rad", settings.max_rotation_rad);
  require(settings.max_events >= 1, "max_events", settings.max_events);
}

/// Length of a window. Brief: the fewest events by which backtracking can be judged, EdgeFollower::events_to_fix_pose,
/// for a tracker that has not been verified yet.
enum class VerificationWindow { full, brief };

/// How far the backtracked pose is from the pose that the forward tracker had at the same time, to within an update.
struct BacktrackError {
  double translation_px = 0;  ///< Eq. (13): |x - x'| + |y - y'| of the marker's projected origin, undistorted pixels
  double rotation_rad = 0;    ///< Eq. (14): sum of the absolute roll, pitch, yaw differences
  double angle_rad = 0;       ///< the geodesic angle between the two rotations
  /// Standard deviations by the rule's covariance, summed over the axes as in Eq. (13) or (14), then over both poses as
  /// root of the sum of squares. Zero where the rule has no covariance.
  double expected_px = 0;
  double expected_rad = 0;
};

/// Eqs. (13), (14) between a forward and a backtracked pose. Unlike in the paper, both poses are of the same time, and
/// angle differences are wrapped to [-pi, pi].
inline BacktrackError backtrack_error(const Eigen::Isometry3d& forward, const Eigen::Isometry3d& backward,
                                      double focal_length) noexcept {
  const auto centre = [&](const Eigen::Isometry3d& T) { return image_point(translation(T), focal_length); };
  const Vec2 moved = centre(forward) - centre(backward);
  const Vec3 turned = Vec3(roll_pitch_yaw(forward.linear())) - Vec3(roll_pitch_yaw(backward.linear()));
  return {std::abs(moved.x) + std::abs(moved.y),
          std::abs(wrap_angle(turned.x)) + std::abs(wrap_angle(turned.y)) + std::abs(wrap_angle(turned.z)),
          geodesic_angle(forward.linear(), backward.linear())};
}

/// Standard deviations of the place of a marker's origin in the image, along x and along y, added as in Eq. (13) [px].
/// @param covariance of the pose, see PoseEstimate
/// @param T the origin [m, camera frame]
inline double origin_deviation_px(const Matrix6d& covariance, Vec3 T, double focal_length) noexcept {
  const Vec2 variances = image_variances(covariance, T, Vec3(), focal_length);
  return std::sqrt(std::max(0.0, variances.x)) + std::sqrt(std::max(0.0, variances.y));  // rounding may go below 0
}

/// Keeps the events of `updates` updates and then runs a copy of the tracker backwards over them: on average two steps
/// back with every new event, so that no event waits for the whole way. Two exceptions are done at once: a brief
/// window, as a tracker waits for its result, and the rest of a way back when the next window is nearly full.
template <PoseUpdateRule Rule>
class Verification {
 public:
  /// @throws std::invalid_argument naming the setting that is out of range
  Verification(const EdgeFollower<Rule>& forward, const VerificationSettings& settings)
      : settings_((validate(settings), settings)),
        window_(settings.max_events),
        past_(settings.max_events),
        backward_(forward),
        T_start_(forward.T_camera_marker()) {
    const MarkerModel& model = forward.matcher().model();
    const Vec3 middle = centre(model);
    for (const Eigen::Vector3d& vertex : model.vertices) {
      const Vec3 v = Vec3(vertex) - middle;
      size_m_ = std::max({size_m_, 2 * std::abs(v.x), 2 * std::abs(v.y), 2 * std::abs(v.z)});
    }
  }

  /// Takes an event that the forward tracker has taken, and whether it led to an update. Returns, when a window has
  /// been backtracked, the error between the pose at its start and the backtracked one, valid until the next push; else
  /// null.
  [[gnu::always_inline]] const BacktrackError* push(const Event& event, bool updated, const EdgeFollower<Rule>& forward,
                                                    const UndistortionTable& lines_of_sight) noexcept {
    if (pause_ > 1 && steps_left_ == 0) {  // between two windows, nothing to replay
      --pause_;
      return nullptr;
    }
    return push_in_window(Event(event), updated, forward, lines_of_sight);  // a copy: `event` itself stays in registers
  }

  /// Forgets all events; the next window starts at the forward tracker's present pose.
  void restart(const EdgeFollower<Rule>& forward, VerificationWindow window = VerificationWindow::full) noexcept {
    brief_ = window == VerificationWindow::brief;
    brief_events_ = std::min(settings_.min_events, static_cast<std::size_t>(forward.events_to_fix_pose()));
    steps_left_ = 0;
    pause_ = 0;
    begin_filling(forward);
  }

  /// True if backtracking may end, and `push` return an error, within the next `events` events, none of
  /// which leads to an update.
  bool ends_within(std::size_t events) const noexcept {
    return steps_left_ > 0 && steps_left_ <= kStepsBack * (events + static_cast<std::size_t>(waited_));
  }

  /// True if the error is within the thresholds, or within six standard deviations. False for NaN.
  bool passes(const BacktrackError& error) const noexcept {
    return error.translation_px <= std::max(settings_.max_translation_px, kMaxSigmas * error.expected_px) &&
           error.rotation_rad <= std::max(max_rotation_rad(), kMaxSigmas * error.expected_rad);
  }

  /// epsilon_R of a marker at the distance at which the last window was backtracked.
  double max_rotation_rad() const noexcept {
    if (settings_.max_rotation_rad != kAutomatic) return settings_.max_rotation_rad;
    const double size_px = backward_.matcher().focal_length() * size_m_ / translation(backward_.T_camera_marker()).z;
    return std::max(kPapersRotation_rad, 3 * settings_.max_translation_px / size_px);
  }

 private:
  static constexpr double kPapersRotation_rad = 0.15;
  static constexpr double kMaxSigmas = 6;       // by how many standard deviations a right pose may come back off
  static constexpr std::size_t kStepsBack = 2;  // for each new event: the way back takes half as many as the window had
  static constexpr int kWait = 16;  // events after which the steps for all of them are made at once, which costs less

  [[gnu::noinline]] const BacktrackError* push_in_window(const Event& event, bool updated,
                                                         const EdgeFollower<Rule>& forward,
                                                         const UndistortionTable& lines_of_sight) noexcept {
    const BacktrackError* error = nullptr;
    if (steps_left_ > 0 && ++waited_ == kWait) {
      waited_ = 0;
      error = step_back(kWait * kStepsBack, lines_of_sight);
    }
    if (pause_ > 0) {  // between two windows
      if (pause_ > 1) {
        --pause_;
      } else if (updated) {  // a window begins at a new pose
        pause_ = 0;
        begin_filling(forward);
      }
      return error;
    }
    if (window_.full()) begin_filling(forward);  // no update in time: the ring would lose the events after T_start_
    window_.push(event);
    updates_ += updated;
    const bool complete = (brief_ ? window_.size() >= brief_events_
                                  : updates_ >= settings_.updates && window_.size() >= settings_.min_events) &&
                          steps_left_ == 0;
    const bool nearly_full = window_.size() > window_.capacity() - std::max<std::size_t>(window_.capacity() / 8, 1);
    if (!updated || (!complete && !nearly_full)) return error;
    if (steps_left_ > 0) error = step_back(steps_left_, lines_of_sight);  // the new window is nearly full: no more time
    turn_back(forward);
    begin_filling(forward);
    if (std::exchange(brief_, false)) return step_back(steps_left_, lines_of_sight);  // a tracker waits for the result
    pause_ = static_cast<std::size_t>(settings_.every - 1) * past_.size();
    return error;
  }

  // Begins to fill a window at the forward tracker's present pose.
  void begin_filling(const EdgeFollower<Rule>& forward) noexcept {
    T_start_ = forward.T_camera_marker();
    start_sigma_ = expected_error(forward);
    window_.clear();
    updates_ = 0;
  }

  // Begins to backtrack with a copy of the forward tracker, at its pose, with the rule reversed, see PoseUpdateRule.
  void turn_back(const EdgeFollower<Rule>& forward) noexcept {
    std::swap(window_, past_);
    steps_left_ = past_.size();
    backward_ = forward;
    backward_.reverse();
    T_past_start_ = T_start_;
    past_start_sigma_ = start_sigma_;
  }

  // Replays the window's events in reverse. Their times are mirrored at its end, t -> end + (end - t), so that they
  // increase for the rule.
  [[gnu::noinline]] const BacktrackError* step_back(std::size_t steps,
                                                    const UndistortionTable& lines_of_sight) noexcept {
    const Timestamp end = past_[past_.size() - 1].t;
    const auto mirrored = [end](Timestamp t) {
      return static_cast<Timestamp>(static_cast<std::uint64_t>(end) + elapsed_us(t, end));
    };
    for (steps = std::min(steps, steps_left_); steps > 0;) {
      std::size_t taken = 1;
      if (backward_.accepts_groups()) {
        EventGroup group;
        group.fill(std::min(steps, EventGroup::kMost), [&](std::size_t i) {
          const Event& event = past_[steps_left_ - 1 - i];
          return std::tuple(lines_of_sight(event), mirrored(event.t), polarity(event));
        });
        taken = 0;
        while (taken < group.count() && backward_.accepts_groups())
          taken = backward_.push(group, taken, [](auto...) { return true; });
      } else {
        const Event& event = past_[steps_left_ - 1];
        backward_.push(lines_of_sight(event), mirrored(event.t), polarity(event));
      }
      steps_left_ -= taken;
      steps -= taken;
    }
    if (steps_left_ > 0) return nullptr;
    error_ = backtrack_error(T_past_start_, backward_.T_camera_marker(), backward_.matcher().focal_length());
    const ExpectedError expected = expected_error(backward_);
    error_.expected_px = std::hypot(expected.px, past_start_sigma_.px);
    error_.expected_rad = std::hypot(expected.rad, past_start_sigma_.rad);
    return &error_;
  }

  // Standard deviations by the rule's covariance, each a sum over the axes; zero where the rule has none.
  struct ExpectedError {
    double px = 0, rad = 0;
  };
  // It may exceed the thresholds: for the tilt of a small marker far away, and for the place just after a standstill,
  // over which the filter has predicted.
  static ExpectedError expected_error(const EdgeFollower<Rule>& follower) noexcept {
    ExpectedError error;
    if constexpr (MotionEstimatingRule<Rule>) {
      const Matrix6d P = follower.rule().covariance();
      error.px = origin_deviation_px(P, translation(follower.T_camera_marker()), follower.matcher().focal_length());
      error.rad = std::sqrt(P(3, 3)) + std::sqrt(P(4, 4)) + std::sqrt(P(5, 5));
    }
    return error;
  }

  VerificationSettings settings_;
  EventHistory window_;
  EventHistory past_;           // the window that is being backtracked
  std::size_t steps_left_ = 0;  // events of it still to be replayed
  int waited_ = 0;              // events since the last steps
  Eigen::Isometry3d T_past_start_ = Eigen::Isometry3d::Identity();
  ExpectedError start_sigma_, past_start_sigma_;  // of the poses at the windows' starts
  BacktrackError error_;                          // of the last window that was backtracked
  EdgeFollower<Rule> backward_;                   // kept, so that copying into it does not allocate
  Eigen::Isometry3d T_start_;                     // the forward pose at the start of the window, the paper's P_n
  int updates_ = 0;
  bool brief_ = false;
  std::size_t brief_events_ = 0;
  double size_m_ = 0;  // of the model
  // Events until the next window, plus one. 1: it begins with the next update; 0: it is being filled.
  std::size_t pause_ = 0;
};

}  // namespace evmarker
