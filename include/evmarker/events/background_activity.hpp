#pragma once
// An estimate of how many events per pixel and second a sensor makes without a cause.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>

#include "evmarker/events/camera_time.hpp"

namespace evmarker {

/// Measures the rate of background activity [Hz/px] from the ages of events: the time since the last event of the same
/// pixel or of one of its 8 neighbours.
///
/// Where noise of rate r is all that happens, an event has an age over a with the probability exp(-9 r a). So r is at
/// most n(a) exp(9 r a), where n(a) is the measured rate of the events with an age over a. The rate of all events,
/// a = 0, is a first bound on r. It is lowered step by step with longer ages, as long as not more than one
/// noise event is expected, at the present bound, in the 9 pixels within that age. With noise alone every bound equals
/// r; events of edges, hot pixels and bursts leave the count once a exceeds their ages. Where edges pass so often that
/// no age is free of them, the bound stays above r.
class BackgroundActivity {
 public:
  /// @param pixels how many the sensor has
  explicit BackgroundActivity(double pixels) noexcept : hz_per_px_by_events_per_us_(1e6 / pixels) {}

  /// Adds one event as a sample; not every event is needed, one in about 0.2 ms is enough. Samples come in order of
  /// arrival, the first after `kEventsAtFirst` events.
  /// @param age_us time from the last event at this pixel or one of its neighbours to this event
  /// @param t time of the event [us]
  /// @return how many events later the next sample is to be added
  std::uint64_t add(std::uint64_t age_us, Timestamp t) noexcept {
    // A jump ahead counts only with its first second.
    const std::uint64_t passed_us = std::min(time_.advance(t), kLongest_us);
    observed_us_ += static_cast<double>(passed_us);
    // An age cannot be longer than the time observed: what came before the first sample is unknown.
    const std::uint64_t known_us = std::min({age_us, static_cast<std::uint64_t>(observed_us_), kOldest_us});
    by_age_[static_cast<std::size_t>(std::bit_width(known_us / kYoungest_us))] += static_cast<double>(per_sample_);
    if (++samples_ % kSamplesPerEstimate == 0 && observed_us_ > 0) estimate();
    if (passed_us < kEnough_us / 2)
      per_sample_ = std::min(2 * per_sample_, kMostPerSample);
    else if (passed_us > 2 * kEnough_us)
      per_sample_ = std::max(per_sample_ / 2, kEventsAtFirst);
    return per_sample_;
  }

  /// The present estimate [Hz/px]; 1 before there was one.
  double hz_per_px() const noexcept { return hz_per_px_; }

  /// Number of events before the first sample.
  static constexpr std::uint64_t kEventsAtFirst = 32;

 private:
  static constexpr std::uint64_t kYoungest_us = 64, kOldest_us = kYoungest_us << 10;  // limits of the bins
  static constexpr std::size_t kAges = 12;
  static constexpr std::uint64_t kSamplesPerEstimate = 16;
  static constexpr std::uint64_t kEnough_us = 200;              // aimed at between two samples
  static constexpr std::uint64_t kMostPerSample = 1024;         // events
  static constexpr std::uint64_t kLongest_us = 1000000;         // counted at most between two samples
  static constexpr double kPrior = 1, kPriorSamples = 16;       // first guess [Hz/px], and its weight [samples]
  static constexpr double kMemory_us = 200000, kMemory = 1024;  // [us] and samples: whichever reaches farther back

  void estimate() noexcept {
    // Rate of the `older` events, those with an age over `age_us`: their number, and one sample more, as a rate may be
    // above 0 where no event was seen, divided by the time in which such an age could be seen: not just after
    // the begin.
    const auto rate_of = [&](double older, double age_us) {
      return (older + static_cast<double>(per_sample_)) * hz_per_px_by_events_per_us_ /
             (observed_us_ - begin_share_ * age_us);
    };
    double older = std::accumulate(by_age_.begin(), by_age_.end(), 0.0);
    double rate = rate_of(older, 0), age_us = kYoungest_us;
    for (std::size_t i = 0; i + 1 < kAges; ++i, age_us *= 2) {
      const double noise_within_age = 9e-6 * rate * age_us;
      if (noise_within_age > 1 || age_us > observed_us_ / 2) break;
      older -= by_age_[i];
      rate = std::min(rate, rate_of(older, age_us) * std::exp(noise_within_age));
    }
    remembered_ += static_cast<double>(kSamplesPerEstimate);
    hz_per_px_ = (remembered_ * rate + kPriorSamples * kPrior) / (remembered_ + kPriorSamples);
    if (observed_us_ > 2 * kMemory_us && remembered_ > 2 * kMemory) forget_half();
  }

  void forget_half() noexcept {
    for (double& count : by_age_) count /= 2;
    observed_us_ /= 2;
    remembered_ /= 2;
    begin_share_ /= 2;
  }

  double hz_per_px_by_events_per_us_;   // [Hz/px] of one event per microsecond on the whole sensor
  std::array<double, kAges> by_age_{};  // events, by the bins of their ages
  double observed_us_ = 0;
  double remembered_ = 0;   // samples, the forgotten ones taken off
  double begin_share_ = 1;  // of the counts that go back to the begin, before which no ages were known
  std::uint64_t samples_ = 0, per_sample_ = kEventsAtFirst;
  CameraTime time_;
  double hz_per_px_ = kPrior;
};

}  // namespace evmarker
