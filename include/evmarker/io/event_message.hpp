#pragma once
// The messages in which ROS carries events.
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "evmarker/events/event.hpp"
#include "evmarker/io/field_cursor.hpp"

namespace evmarker::io {

/// How the messages of a topic of events are written.
struct EventMessageFormat {
  bool is_packet = true;  ///< encoded events, as event_camera_msgs/EventPacket; else a list, as dvs_msgs/EventArray
  bool is_cdr = true;     ///< ROS 2; else the serialization of ROS 1

  constexpr bool operator==(const EventMessageFormat&) const = default;
};

/// The format of a type like `event_camera_msgs/msg/EventPacket`; nothing where it is no type of events.
inline std::optional<EventMessageFormat> find_event_message(std::string_view type, bool is_cdr) {
  constexpr std::array<std::string_view, 2> packets{"event_camera_msgs/EventPacket", "event_array_msgs/EventArray"};
  constexpr std::array<std::string_view, 2> lists{"dvs_msgs/EventArray", "prophesee_event_msgs/EventArray"};
  std::string name(type);
  if (const auto folder = name.find("/msg/"); folder != name.npos) name.erase(folder, 4);  // ROS 2 names it
  for (const std::string_view packet : packets)
    if (name == packet) return EventMessageFormat{true, is_cdr};
  for (const std::string_view list : lists)
    if (name == list) return EventMessageFormat{false, is_cdr};
  return std::nullopt;
}

/// A message, whose bytes live as long as it is used.
struct EventMessage {
  SensorSize size;                  ///< 0 x 0 where the message leaves it out
  std::uint64_t time_base = 0;      ///< [ns], of a packet
  std::string_view encoding;        ///< of a packet; empty for a list
  std::span<const std::byte> data;  ///< of a packet
  std::uint32_t count = 0;          ///< events of a list
  FieldCursor list{{}};             ///< at the first event of a list
};

/// Reads all of a message but its events.
/// @throws std::runtime_error where it is garbled, or of a serialization or byte order that is not supported
inline EventMessage parse_event_message(std::span<const std::byte> bytes, EventMessageFormat format) {
  if (format.is_cdr) {
    constexpr std::size_t encapsulation = 4;  // behind which alignment begins
    const auto kind = FieldCursor(bytes).bytes(encapsulation)[1];
    if (kind != std::byte{1})
      throw std::runtime_error("encapsulation is " + std::to_string(static_cast<int>(kind)) +
                               ", which is not supported (1, little-endian CDR, is)");
    bytes = bytes.subspan(encapsulation);
  }
  FieldCursor fields(bytes, format.is_cdr);
  if (!format.is_cdr) fields.number<std::uint32_t>();  // number of the message
  fields.bytes(8);                                     // time at which it was made
  fields.sized_bytes();                                // name of the camera's frame
  EventMessage message;
  const auto height = fields.number<std::uint32_t>(), width = fields.number<std::uint32_t>();
  constexpr std::uint32_t most = 1U << 30U;
  if (width > most || height > most)
    throw std::runtime_error("garbled: size is " + std::to_string(width) + " x " + std::to_string(height));
  message.size = {static_cast<int>(width), static_cast<int>(height)};
  if (!format.is_packet) {
    message.count = fields.number<std::uint32_t>();
    message.list = fields;
    return message;
  }
  fields.number<std::uint64_t>();  // number of the packet
  message.time_base = fields.number<std::uint64_t>();
  message.encoding = fields.text();
  if (fields.number<std::uint8_t>() != 0) throw std::runtime_error("is_bigendian is 1, which is not supported (0 is)");
  message.data = fields.sized_bytes();
  return message;
}

}  // namespace evmarker::io
