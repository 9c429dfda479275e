#pragma once
// Checks of what a writer is given: sensor size, events, trigger channels.
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>

#include "evmarker/events/event.hpp"

namespace evmarker::io {

/// Rejects a sensor whose width or height is not in 1..`max_side` pixels.
/// @throws std::invalid_argument
inline void require_sensor_size(SensorSize size, int max_side) {
  const auto require = [&](const char* name, int value) {
    if (value < 1 || value > max_side)
      throw std::invalid_argument(std::string("sensor ") + name + " is " + std::to_string(value) +
                                  " px, must be in 1.." + std::to_string(max_side));
  };
  require("width", size.width);
  require("height", size.height);
}

/// Rejects a trigger channel that is not in 0..`max_id`, the range of `encoding`.
/// @throws std::invalid_argument
inline void require_trigger_id(int id, int max_id, const char* encoding) {
  if (id < 0 || id > max_id)
    throw std::invalid_argument("trigger: id is " + std::to_string(id) + ", " + encoding + " holds 0.." +
                                std::to_string(max_id));
}

/// Rejects events that are off the sensor or, where `negative_times` are not allowed, before time 0.
/// @param number of the first event in the recording, from 0
/// @throws std::invalid_argument with the number of the event
inline void require_writable(std::span<const Event> events, SensorSize size, std::uint64_t number,
                             bool negative_times = false) {
  for (const Event& event : events) {
    const bool good = event.x < size.width && event.y < size.height && (event.t >= 0 || negative_times);
    if (!good) [[unlikely]] {
      const std::string name = "event " + std::to_string(number);
      if (event.x >= size.width)
        throw std::invalid_argument(name + ": x is " + std::to_string(event.x) + " on a sensor of width " +
                                    std::to_string(size.width));
      if (event.y >= size.height)
        throw std::invalid_argument(name + ": y is " + std::to_string(event.y) + " on a sensor of height " +
                                    std::to_string(size.height));
      throw std::invalid_argument(name + ": t is " + std::to_string(event.t) + " us, must not be negative");
    }
    ++number;
  }
}

}  // namespace evmarker::io
