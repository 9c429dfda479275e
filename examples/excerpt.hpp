#pragma once
// A part of a recording, by time and by region, and where its times and pixels are counted from.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <evmarker/base/require.hpp>
#include <evmarker/events/event.hpp>
#include <evmarker/events/trigger_event.hpp>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "console.hpp"
#include "recording_checks.hpp"

struct ExcerptOptions {
  std::optional<double> from_s, to_s;
  std::vector<int> region;
  bool shift_time = false, shift_region = false;

  void add_to(CLI::App& app) {
    const CLI::Validator time = console::non_negative_number();
    app.add_option("--from", from_s, "leave out what is earlier, counted from the recording's first event [s]")
        ->check(time);
    app.add_option("--to", to_s, "leave out what is at this time or later, counted likewise [s]")->check(time);
    app.add_flag("--shift-time", shift_time, "count times from --from, so that they begin at 0; default: as recorded");
    auto* const only = app.add_option("--region", region, "leave out events elsewhere: x,y,width,height [px]")
                           ->delimiter(',')
                           ->expected(4);
    app.add_flag("--shift-region", shift_region,
                 "write the region as a sensor of its own, with its corner at 0,0: cx and cy of a calibration become "
                 "smaller by x and y; default: pixels as recorded, which any calibration still fits")
        ->needs(only);
  }

  /// @throws std::invalid_argument where no time is between --from and --to
  void validate() const {
    if (to_s && *to_s <= from_s.value_or(0))
      throw std::invalid_argument("--to: " + evmarker::number_text(*to_s) + " s is not after --from, " +
                                  evmarker::number_text(from_s.value_or(0)) + " s");
  }
};

/// Picks what the options name; triggers by their time alone.
class Excerpt {
 public:
  /// @throws std::invalid_argument where the region is not on the sensor
  Excerpt(const ExcerptOptions& options, evmarker::SensorSize sensor) : options_(options), size_(sensor) {
    if (options.region.empty()) return;
    const int x = options.region[0], y = options.region[1], width = options.region[2], height = options.region[3];
    if (x < 0 || y < 0 || width < 1 || height < 1 || width > sensor.width - x || height > sensor.height - y)
      throw std::invalid_argument("--region: " + std::to_string(width) + " x " + std::to_string(height) + " px at " +
                                  std::to_string(x) + "," + std::to_string(y) + " is not on the sensor of " +
                                  recording_checks::show(sensor));
    x_ = x, y_ = y, width_ = width, height_ = height;
    if (options.shift_region) size_ = {width, height};
  }

  /// Sensor of what is picked.
  evmarker::SensorSize sensor_size() const noexcept { return size_; }

  /// Sets the time from which the options count; before anything is picked.
  void begin_at(evmarker::Timestamp first) noexcept {
    if (options_.from_s) begin_ = evmarker::later(first, microseconds(*options_.from_s));
    if (options_.to_s) end_ = evmarker::later(first, microseconds(*options_.to_s));
    if (options_.shift_time) zero_ = begin_.value_or(first);
  }

  /// The events that are wanted, valid until the next call.
  std::span<const evmarker::Event> pick(std::span<const evmarker::Event> events) {
    picked_.clear();
    for (evmarker::Event event : events) {
      if (!in_time(event.t) || !in_region(event)) continue;
      if (options_.shift_region) {
        event.x = static_cast<std::uint16_t>(event.x - x_);
        event.y = static_cast<std::uint16_t>(event.y - y_);
      }
      event.t = since_zero(event.t);
      picked_.push_back(event);
    }
    return picked_;
  }

  std::optional<evmarker::TriggerEvent> pick(evmarker::TriggerEvent trigger) const {
    if (!in_time(trigger.t)) return std::nullopt;
    trigger.t = since_zero(trigger.t);
    return trigger;
  }

  /// True if a whole batch lies behind the end: single times that are garbled end nothing.
  bool is_over(std::span<const evmarker::Event> batch) const {
    return end_ && std::ranges::all_of(batch, [&](const evmarker::Event& event) { return event.t >= *end_; });
  }

 private:
  static std::chrono::microseconds microseconds(double s) {
    constexpr double kMost = 9e18;  // fits into 63 bits
    return std::chrono::microseconds(static_cast<std::int64_t>(std::llround(std::min(1e6 * s, kMost))));
  }

  bool in_time(evmarker::Timestamp t) const noexcept { return (!begin_ || t >= *begin_) && (!end_ || t < *end_); }
  bool in_region(const evmarker::Event& event) const noexcept {
    return event.x >= x_ && event.y >= y_ && event.x - x_ < width_ && event.y - y_ < height_;
  }
  // Times of a garbled recording may be too far apart for 63 bits.
  evmarker::Timestamp since_zero(evmarker::Timestamp t) const noexcept {
    const auto at_most = [](std::uint64_t us) {
      return static_cast<evmarker::Timestamp>(
          std::min<std::uint64_t>(us, std::numeric_limits<evmarker::Timestamp>::max()));
    };
    return t >= zero_ ? at_most(evmarker::elapsed_us(zero_, t)) : -at_most(evmarker::elapsed_us(t, zero_));
  }

  ExcerptOptions options_;
  evmarker::SensorSize size_;
  int x_ = 0, y_ = 0, width_ = std::numeric_limits<int>::max(), height_ = std::numeric_limits<int>::max();
  std::optional<evmarker::Timestamp> begin_, end_;
  evmarker::Timestamp zero_ = 0;
  std::vector<evmarker::Event> picked_;
};
