#pragma once
// Floor 0. How many of the events near the edges these explain: what tells a tracker that it follows something else.
#include <cmath>
#include <cstddef>

namespace evmarker {

/// Running mean over about the last `events` events: 1 of one that was explained, 0 of one that was not.
class MatchedFraction {
 public:
  /// @param events at least 1
  explicit MatchedFraction(int events) noexcept : events_(events) {}

  void add(bool explained) noexcept {
    if (offered_ < events_) weight_ = 1.0 / ++offered_;
    value_ += weight_ * ((explained ? 1.0 : 0.0) - value_);
  }
  /// Takes it that all were explained.
  void restore() noexcept { value_ = 1; }

  double value() const noexcept { return value_; }

  /// Whether so many more events, whatever they are, leave it on its side of a limit.
  bool keeps_side(double limit, std::size_t events) const noexcept {
    return std::abs(value_ - limit) > static_cast<double>(events + 1) * weight_;  // one more, for the rounding
  }

 private:
  int events_;
  int offered_ = 0;    // events that the mean stands for
  double weight_ = 1;  // one over them
  double value_ = 1;
};

}  // namespace evmarker
