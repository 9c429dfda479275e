#pragma once
// From a start that may be off to a pose that may be used, and to its loss.
#include <algorithm>
#include <cstdint>
#include <limits>
#include <utility>

#include "evmarker/events/event.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// The state of a tracked marker, by its updates and verifications. While it is `converging`, updates only refine the
/// start pose, until it has settled; what follows is evidence. It is `tracking` once it has been verified since. A
/// converging marker may fail a verification because its start was off. Later, one failure may be chance: two in a row
/// lose it.
class TrackProgress {
 public:
  /// @param least_events matched events before it is `tracking`
  explicit TrackProgress(int least_events) noexcept : least_events_(least_events) {}

  TrackingState state() const noexcept { return state_; }
  bool converging() const noexcept { return state_ == TrackingState::converging; }
  bool tracking() const noexcept { return state_ == TrackingState::tracking; }
  bool lost() const noexcept { return state_ == TrackingState::lost; }
  /// True once the start has been refined.
  bool settled() const noexcept { return settled_; }
  /// Matched events since the start.
  std::int64_t matched() const noexcept { return matched_; }
  /// Why it must be lost, whatever else speaks for it; `none` as long as nothing says so.
  LossReason certain_loss() const noexcept { return certain_loss_; }

  /// Adds an update by `matched` events at time t.
  void add_update(int matched, Timestamp t) noexcept {
    matched_ += matched;
    if (!converging()) return;
    converging_since_ = std::min(converging_since_, t);
    if (elapsed_us(converging_since_, t) > kLongestConverging_us) certain_loss_ = LossReason::not_confirmed;
  }

  /// Takes the result of a verification. Returns true if another one should begin at once.
  bool add_verification(bool passed) noexcept {
    verified_ |= passed && settled_;
    const bool failed = !passed && tracking();
    if (std::exchange(failed_before_, failed) && failed) certain_loss_ = LossReason::verification;
    return failed;
  }

  /// The start has been refined.
  void settle() noexcept { settled_ = true; }
  /// Makes the state `tracking`, if verifications and events allow. Returns true if it has become that.
  bool confirm() noexcept {
    if (!converging() || !verified_ || matched_ < least_events_) return false;
    state_ = TrackingState::tracking;
    return true;
  }
  void lose() noexcept { state_ = TrackingState::lost; }

 private:
  static constexpr std::uint64_t kLongestConverging_us = 2000000;

  TrackingState state_ = TrackingState::converging;
  std::int64_t least_events_, matched_ = 0;
  bool settled_ = false;
  bool verified_ = false;       // a verification has passed since it has settled
  bool failed_before_ = false;  // the last verification failed
  LossReason certain_loss_ = LossReason::none;
  Timestamp converging_since_ = std::numeric_limits<Timestamp>::max();
};

}  // namespace evmarker
