#pragma once
// Recordings in the formats that the library reads but does not write, by the descriptions of these formats.
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"

namespace evmarker::io::test {

/// The lowest `bytes` bytes of a number, in little-endian order.
inline std::string little(std::uint64_t value, std::size_t bytes) {
  std::string text;
  for (std::size_t i = 0; i < bytes; ++i) text += static_cast<char>(value >> (8 * i) & 0xFF);
  return text;
}

inline std::string dat_header(SensorSize size, int version = 2) {
  return "% Data file containing CD events.\n% Version " + std::to_string(version) + "\n% Width " +
         std::to_string(size.width) + "\n% Height " + std::to_string(size.height) + "\n";
}

inline std::string dat_record(const Event& event, int version = 2) {
  const std::uint64_t x = event.x, y = event.y, p = event.p > 0 ? 1 : 0;
  return little(static_cast<std::uint64_t>(event.t), 4) +
         little(version == 2 ? p << 28U | y << 14U | x : p << 17U | y << 9U | x, 4);
}

inline std::string dat_record(const TriggerEvent& trigger) {
  return little(static_cast<std::uint64_t>(trigger.t), 4) +
         little(static_cast<std::uint64_t>(trigger.id) << 26U | (trigger.rising ? 1U : 0U), 4);
}

/// A DAT recording of events (type 12).
inline std::string make_dat(std::span<const Event> events, SensorSize size, int version = 2) {
  std::string bytes = dat_header(size, version) + "\x0c\x08";
  for (const Event& event : events) bytes += dat_record(event, version);
  return bytes;
}

}  // namespace evmarker::io::test
