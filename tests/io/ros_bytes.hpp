#pragma once
// Messages of events and recordings of ROS, by the descriptions of their formats.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/evt3.hpp"
#include "io/recording_bytes.hpp"

namespace evmarker::io::test {

/// Fields of a message, in the serialization of ROS 1 or in CDR, which aligns numbers and ends texts with a zero.
class MessageBytes {
 public:
  explicit MessageBytes(bool cdr) : cdr_(cdr) {}

  MessageBytes& add(std::uint64_t value, std::size_t bytes) {
    while (cdr_ && bytes_.size() % bytes != 0) bytes_ += '\0';
    bytes_ += little(value, bytes);
    return *this;
  }
  MessageBytes& add(const std::string& text) {
    add(text.size() + (cdr_ ? 1 : 0), 4);
    bytes_ += text + (cdr_ ? std::string(1, '\0') : "");
    return *this;
  }
  MessageBytes& add_bytes(const std::string& bytes) {
    add(bytes.size(), 4);
    bytes_ += bytes;
    return *this;
  }
  std::string bytes() const { return (cdr_ ? std::string("\0\1\0\0", 4) : "") + bytes_; }

 private:
  bool cdr_;
  std::string bytes_;
};

/// The fields that messages of events begin with.
inline MessageBytes message_of_size(SensorSize size, bool cdr) {
  MessageBytes message(cdr);
  if (!cdr) message.add(7, 4);  // number
  message.add(1700000000, 4).add(5, 4).add("camera");
  return message.add(static_cast<std::uint64_t>(size.height), 4).add(static_cast<std::uint64_t>(size.width), 4);
}

inline std::string event_packet(SensorSize size, const std::string& encoding, std::uint64_t time_base_ns,
                                const std::string& events, bool cdr, bool big_endian = false) {
  auto message = message_of_size(size, cdr);
  message.add(3, 8).add(time_base_ns, 8).add(encoding).add(big_endian ? 1 : 0, 1).add_bytes(events);
  return message.bytes();
}

/// dvs_msgs/EventArray.
inline std::string event_array(SensorSize size, std::span<const Event> events, bool cdr) {
  auto message = message_of_size(size, cdr);
  message.add(events.size(), 4);
  for (const Event& event : events) {
    const auto t = static_cast<std::uint64_t>(event.t);
    message.add(event.x, 2).add(event.y, 2).add(t / 1000000, 4).add(t % 1000000 * 1000, 4).add(event.p > 0, 1);
  }
  return message.bytes();
}

inline std::string as_text(const std::vector<std::byte>& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Times of the events are in [base, base + 2^32 ns).
inline std::string mono_words(std::span<const Event> events, Timestamp base) {
  std::string bytes;
  for (const Event& event : events)
    bytes += little(static_cast<std::uint64_t>(event.t - base) * 1000, 4) + little(event.x, 2) +
             little((event.p > 0 ? 0x8000U : 0U) | event.y, 2);
  return bytes;
}

inline std::string libcaer_words(std::span<const Event> events, Timestamp base) {
  std::string bytes;
  for (const Event& event : events)
    bytes += little(std::uint64_t{event.x} << 17U | std::uint64_t{event.y} << 2U | (event.p > 0 ? 2U : 0U) | 1U, 4) +
             little(static_cast<std::uint64_t>(event.t - base) & 0x7FFFFFFFU, 4);
  return bytes;
}

/// Times of the events are in [base, base + 2^24 us). Neighbours in a column are words with a mask.
inline std::string libcaer_cmp_words(std::span<const Event> events, Timestamp base) {
  std::string bytes;
  const auto put = [&](std::uint64_t type, std::uint64_t payload) { bytes += little(type << 12U | payload, 2); };
  std::uint64_t high = 0, low = 0;
  for (std::size_t i = 0; i < events.size(); ++i) {
    const Event& event = events[i];
    const auto t = static_cast<std::uint64_t>(event.t - base);
    const std::uint64_t on = event.p > 0 ? 0x800 : 0;
    if (t >> 12U != high) put(0, high = t >> 12U);
    if ((t & 0xFFFU) != low) put(1, low = t & 0xFFFU);
    put(2, event.x);
    const Event above{event.x, static_cast<std::uint16_t>(event.y + 1), event.p, event.t};
    const bool two = i + 1 < events.size() && events[i + 1] == above;
    if (two) {
      put(4, on | event.y), put(5, 0), put(4, on | event.y), put(5, 3);
      ++i;
    } else {
      put(3, on | event.y);
    }
  }
  return bytes;
}

/// What messages are made of, each of up to 1000 events.
enum class RosEvents { array, mono, libcaer, libcaer_cmp, evt3 };

constexpr const char* type_of(RosEvents kind) {
  return kind == RosEvents::array ? "dvs_msgs/EventArray" : "event_camera_msgs/EventPacket";
}

inline std::vector<std::string> event_messages(std::span<const Event> events, SensorSize size, RosEvents kind,
                                               bool cdr) {
  std::vector<std::string> messages;
  Evt3Encoder encoder(size.width);
  for (; !events.empty(); events = events.subspan(std::min<std::size_t>(1000, events.size()))) {
    const auto part = events.first(std::min<std::size_t>(1000, events.size()));
    const Timestamp base =
        std::min_element(part.begin(), part.end(), [](const Event& a, const Event& b) { return a.t < b.t; })->t;
    const auto packet = [&](const char* encoding, const std::string& words) {
      messages.push_back(event_packet(size, encoding, static_cast<std::uint64_t>(base) * 1000, words, cdr));
    };
    std::vector<std::byte> words;
    switch (kind) {
      case RosEvents::array: messages.push_back(event_array(size, part, cdr)); break;
      case RosEvents::mono: packet("mono", mono_words(part, base)); break;
      case RosEvents::libcaer: packet("libcaer", libcaer_words(part, base)); break;
      case RosEvents::libcaer_cmp: packet("libcaer_cmp", libcaer_cmp_words(part, base)); break;
      case RosEvents::evt3:
        encoder.encode(part, words);
        packet("evt3", as_text(words));
        break;
    }
  }
  return messages;
}

inline std::string mcap_record(int type, const std::string& content) {
  return little(static_cast<std::uint64_t>(type), 1) + little(content.size(), 8) + content;
}
inline std::string mcap_text(const std::string& text) { return little(text.size(), 4) + text; }

inline std::string mcap_begin() { return "\x89MCAP0\r\n" + mcap_record(1, mcap_text("ros2") + mcap_text("tests")); }

/// A schema and a channel of the same id.
inline std::string mcap_channel(int id, const std::string& topic, const std::string& type,
                                const std::string& encoding = "cdr") {
  const std::string number = little(static_cast<std::uint64_t>(id), 2);
  return mcap_record(3, number + mcap_text(type) + mcap_text("ros2msg") + mcap_text("# fields\nuint8 x")) +
         mcap_record(4, number + number + mcap_text(topic) + mcap_text(encoding) + little(0, 4));
}

inline std::string mcap_message(int channel, const std::string& message) {
  return mcap_record(
      5, little(static_cast<std::uint64_t>(channel), 2) + little(0, 4) + little(1, 8) + little(1, 8) + message);
}

inline std::string mcap_chunk(const std::string& records, Compression compression = Compression::none) {
  const std::string name = compression == Compression::none ? "" : compression == Compression::lz4 ? "lz4" : "zstd";
  const std::string bytes = compress(records, compression);
  return mcap_record(6, little(1, 8) + little(1, 8) + little(records.size(), 8) + little(0, 4) + mcap_text(name) +
                            little(bytes.size(), 8) + bytes);
}

/// The end of the data, a summary of these channels (none where they are empty) and the footer.
/// @param begin bytes in front of it
inline std::string mcap_end(std::size_t begin, const std::string& channels) {
  const std::string end_of_data = mcap_record(15, little(0, 4));
  const std::uint64_t summary = channels.empty() ? 0 : begin + end_of_data.size();
  return end_of_data + channels + mcap_record(2, little(summary, 8) + little(0, 8) + little(0, 4)) + "\x89MCAP0\r\n";
}

/// An MCAP recording: each message of events in a chunk of its own, with another topic's around it.
inline std::string make_mcap(std::span<const Event> events, SensorSize size, RosEvents kind,
                             Compression compression = Compression::none, bool cdr = true) {
  const std::string channels =
      mcap_channel(0, "/imu", "sensor_msgs/msg/Imu") + mcap_channel(1, "/events", type_of(kind), cdr ? "cdr" : "ros1");
  std::string bytes = mcap_begin();
  for (const std::string& message : event_messages(events, size, kind, cdr))
    bytes += mcap_chunk(channels + mcap_message(0, "no events") + mcap_message(1, message) + mcap_message(0, "none"),
                        compression) +
             mcap_record(7, "an index");
  return bytes + mcap_end(bytes.size(), channels);
}

/// Fields `name=value`, each with its length in front.
using BagFieldBytes = std::vector<std::pair<std::string, std::string>>;

inline std::string bag_fields(const BagFieldBytes& fields) {
  std::string bytes;
  for (const auto& [name, value] : fields) bytes += mcap_text(name + "=" + value);
  return bytes;
}

inline std::string bag_record(int type, const BagFieldBytes& fields, const std::string& content) {
  const std::string op = bag_fields({{"op", little(static_cast<std::uint64_t>(type), 1)}});
  return mcap_text(bag_fields(fields) + op) + mcap_text(content);
}

inline std::string bag_connection(int id, const std::string& topic, const std::string& type) {
  return bag_record(7, {{"conn", little(static_cast<std::uint64_t>(id), 4)}, {"topic", topic}},
                    bag_fields({{"topic", topic}, {"type", type}, {"md5sum", "0"}, {"message_definition", "a\nb"}}));
}

inline std::string bag_message(int connection, const std::string& message) {
  return bag_record(2, {{"conn", little(static_cast<std::uint64_t>(connection), 4)}, {"time", little(5, 8)}}, message);
}

inline std::string bag_chunk(const std::string& records, Compression compression = Compression::none) {
  return bag_record(5, {{"compression", to_string(compression)}, {"size", little(records.size(), 4)}},
                    compress(records, compression));
}

/// The first line and the header.
/// @param index its position; 0 where there is none
inline std::string bag_begin(std::uint64_t index = 0) {
  return "#ROSBAG V2.0\n" +
         bag_record(3, {{"index_pos", little(index, 8)}, {"conn_count", little(2, 4)}}, std::string(4000, ' '));
}

/// A recording of ROS 1: each message of events in a chunk of its own, with another topic's around it.
inline std::string make_rosbag(std::span<const Event> events, SensorSize size, RosEvents kind,
                               Compression compression = Compression::none) {
  const std::string topics = bag_connection(0, "/imu", "sensor_msgs/Imu") + bag_connection(1, "/events", type_of(kind));
  std::string chunks;
  for (const std::string& message : event_messages(events, size, kind, false))
    chunks += bag_chunk(topics + bag_message(0, "no events") + bag_message(1, message) + bag_message(0, "none"),
                        compression) +
              bag_record(4, {{"ver", little(1, 4)}}, "an index");
  return bag_begin(bag_begin().size() + chunks.size()) + chunks + topics + bag_record(6, {{"ver", little(1, 4)}}, "x");
}

}  // namespace evmarker::io::test
