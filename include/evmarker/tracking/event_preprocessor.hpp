#pragma once
// What happens to an event before markers get it: hot pixels, the noise filter, the frame and the history.
#include <cstddef>
#include <span>
#include <utility>

#include "evmarker/events/event_history.hpp"
#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/hot_pixels.hpp"
#include "evmarker/events/noise_floor.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/tracking/tracker_settings.hpp"

namespace evmarker {

/// Discards events off the sensor and of hot pixels, and filters the others; those that pass the noise filter go into
/// the polarity frame and the history.
template <EventFilter Filter>
class EventPreprocessor {
 public:
  /// Discarded events are for nobody, filtered ones for confirmed markers only.
  enum class Verdict { discarded, filtered_out, accepted };

  EventPreprocessor(SensorSize size, Filter filter, std::size_t history_events)
      : sensor_size_(size),
        filter_(std::move(filter)),
        hot_pixels_(size),
        noise_floor_(size),
        frame_(size),
        history_(history_events) {}

  /// Processes an event whose time has been checked, see TimeGuard.
  [[gnu::always_inline]] Verdict process(const Event& event, TrackerStatistics& statistics) {
    if (!sensor_size_.contains(event.x, event.y)) {
      ++statistics.off_sensor;
      return Verdict::discarded;
    }
    if (hot_pixels_.is_hot(event)) [[unlikely]] {
      ++statistics.hot;
      return Verdict::discarded;
    }
    if (!filter_.accept(event)) {
      ++statistics.filtered;
      noise_floor_.add(event);
      return Verdict::filtered_out;
    }
    frame_.update(event);
    history_.push(event);
    return Verdict::accepted;
  }

  /// Fetches what `process` looks up for an event on the sensor, if the filter can: with many markers, that is all over
  /// the memory.
  [[gnu::always_inline]] void prefetch(const Event& event) const noexcept {
    if constexpr (requires { filter_.prefetch(event); }) filter_.prefetch(event);
  }

  /// Counts events for `update_hot_pixels`, those that are discarded too.
  void count(std::span<const Event> events) noexcept { hot_pixels_.count(events); }
  /// To be called before every HotPixels::kEventsPerUpdate-th event.
  void update_hot_pixels() noexcept { hot_pixels_.update(); }

  /// True if there should have been events of noise from one time to another, and there were none: the sensor or its
  /// transmission has failed.
  bool is_outage(Timestamp from, Timestamp to) const noexcept {
    constexpr double kEnough = 20;  // noise events that did not come: by chance, in 2 of 10^9 such times
    return noise_floor_.expected_events(from, to) >= kEnough;
  }
  /// Clears the frame: what it shows may have moved away.
  void clear_frame() noexcept { frame_.clear(); }

  const PolarityFrame& frame() const noexcept { return frame_; }
  const EventHistory& history() const noexcept { return history_; }

 private:
  SensorSize sensor_size_;
  Filter filter_;
  HotPixels hot_pixels_;
  NoiseFloor noise_floor_;
  PolarityFrame frame_;
  EventHistory history_;
};

}  // namespace evmarker
