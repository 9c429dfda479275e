#pragma once
// Recordings in the formats that the library reads but does not write, by the descriptions of these formats.
#ifdef EVMARKER_HAS_BZ2
#include <bzlib.h>
#endif
#ifdef EVMARKER_HAS_LZ4
#include <lz4frame.h>
#endif
#ifdef EVMARKER_HAS_ZSTD
#include <zstd.h>
#endif

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/aedat4_header.hpp"
#include "evmarker/io/compression.hpp"

namespace evmarker::io::test {

/// The lowest `bytes` bytes of a number, in little-endian order, with zeros behind them if it has fewer.
inline std::string little(std::uint64_t value, std::size_t bytes) {
  std::string text;
  for (; bytes > 0; --bytes, value >>= 8U) text += static_cast<char>(value & 0xFF);
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

/// An AEDAT 2 record: address and time.
inline std::string aedat2_record(std::uint32_t address, Timestamp t) {
  std::string bytes = little(address, 4) + little(static_cast<std::uint64_t>(t), 4);
  std::reverse(bytes.begin(), bytes.begin() + 4);
  std::reverse(bytes.begin() + 4, bytes.end());
  return bytes;
}

inline std::string aedat2_header(const std::string& chip) {
  return "#!AER-DAT2.0\r\n# This is a raw AE data file\r\n" + (chip.empty() ? "" : "# AEChip: " + chip + "\r\n") +
         "#End Of ASCII Header\r\n";
}

/// Address of an event of a DAVIS, whose pixels count from the bottom right.
inline std::uint32_t davis_address(const Event& event, SensorSize size) {
  const auto x = static_cast<std::uint32_t>(size.width - 1 - event.x),
             y = static_cast<std::uint32_t>(size.height - 1 - event.y);
  return y << 22U | x << 12U | (event.p > 0 ? 1U << 11U : 0U);
}

/// Address of an event of a DVS128, of which bit 0 says OFF.
inline std::uint32_t dvs128_address(const Event& event) {
  return (127U - event.y) << 8U | (127U - event.x) << 1U | (event.p > 0 ? 0U : 1U);
}

/// An AEDAT 2 recording of a DAVIS640.
inline std::string make_aedat2(std::span<const Event> events, SensorSize size) {
  std::string bytes = aedat2_header("eu.seebetter.ini.chips.davis.DavisRGBW640");
  for (const Event& event : events) bytes += aedat2_record(davis_address(event, size), event.t);
  return bytes;
}

inline std::string aedat3_header(const std::string& source) {
  return "#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: " + source +
         "\r\n#Start-Time: 2020-10-30 17:33:59 (TZ+0300)\r\n#!END-HEADER\r\n";
}

/// The header of an AEDAT 3.1 packet.
inline std::string aedat3_packet(int type, int source, std::uint64_t size, std::uint64_t count,
                                 std::uint64_t overflow) {
  return little(static_cast<std::uint64_t>(type), 2) + little(static_cast<std::uint64_t>(source), 2) + little(size, 4) +
         little(4, 4) + little(overflow, 4) + little(count, 4) + little(count, 4) + little(count, 4);
}

inline std::string aedat3_event(const Event& event, bool valid = true) {
  return little(std::uint64_t{event.x} << 17U | std::uint64_t{event.y} << 2U | (event.p > 0 ? 2U : 0U) | valid, 4) +
         little(static_cast<std::uint64_t>(event.t) & 0x7FFFFFFFU, 4);
}

/// An AEDAT 3.1 recording of a DAVIS640 in packets of up to 1000 events, with a packet of something else behind each.
inline std::string make_aedat3(std::span<const Event> events, SensorSize) {
  std::string bytes = aedat3_header("DAVIS640");
  while (!events.empty()) {
    const auto overflow = static_cast<std::uint64_t>(events[0].t) >> 31U;
    const auto end =
        std::find_if(events.begin(), events.begin() + static_cast<int>(std::min<std::size_t>(1000, events.size())),
                     [&](const Event& e) { return static_cast<std::uint64_t>(e.t) >> 31U != overflow; });
    const auto packet = events.first(static_cast<std::size_t>(end - events.begin()));
    bytes += aedat3_packet(1, 1, 8, packet.size(), overflow);
    for (const Event& event : packet) bytes += aedat3_event(event);
    bytes += aedat3_packet(3, 1, 36, 2, 0) + std::string(72, '\x5a');
    events = events.subspan(packet.size());
  }
  return bytes;
}

/// A flatbuffer of which the root's field 0 is a vector of structs, with its size in front.
inline std::string flatbuffer_of_vector(const std::string& identifier, std::uint64_t count,
                                        const std::string& elements) {
  const std::string buffer = little(16, 4) + identifier + little(6, 2) + little(8, 2) + little(4, 2) + little(0, 2) +
                             little(8, 4) + little(8, 4) + little(0, 4) + little(count, 4) + elements;
  return little(buffer.size(), 4) + buffer;
}

inline std::string aedat4_events(std::span<const Event> events) {
  std::string elements;
  for (const Event& event : events)
    elements += little(static_cast<std::uint64_t>(event.t), 8) + little(event.x, 2) + little(event.y, 2) +
                little(event.p > 0 ? 1 : 0, 4);
  return flatbuffer_of_vector("EVTS", events.size(), elements);
}

/// A trigger of AEDAT 4: its time, and its kind, 1 for a rising edge, 2 for a falling one, 3 for a pulse.
struct Aedat4Trigger {
  Timestamp t;
  int type;
};

/// A vector of offsets of tables, behind it the description of the tables' fields, and the tables.
inline std::string aedat4_triggers(std::span<const Aedat4Trigger> triggers) {
  const std::size_t fields = 4 * triggers.size();
  std::string offsets, tables = little(8, 2) + little(16, 2) + little(4, 2) + little(12, 2);
  for (const Aedat4Trigger& trigger : triggers) {
    const std::size_t table = tables.size();
    offsets += little(fields + table - offsets.size(), 4);
    tables += little(table, 4) + little(static_cast<std::uint64_t>(trigger.t), 8) +
              little(static_cast<std::uint64_t>(trigger.type), 4);
  }
  return flatbuffer_of_vector("TRIG", triggers.size(), offsets + tables);
}

/// Stream 0 of frames, stream 1 of events, stream 2 of other events, stream 3 of triggers.
inline std::string aedat4_streams(SensorSize size) {
  const auto stream = [](const char* name, const char* type, const std::string& info) {
    return std::string("<node name=\"") + name + "\" path=\"/mainloop/Recorder/outInfo/" + name +
           "/\"><attr key=\"typeIdentifier\" type=\"string\">" + type + "</attr><node name=\"info\" path=\"\">" + info +
           "</node></node>";
  };
  const std::string sides = "<attr key=\"sizeX\" type=\"int\">" + std::to_string(size.width) +
                            "</attr><attr key=\"sizeY\" type=\"int\">" + std::to_string(size.height) + "</attr>";
  return "<dv version=\"2.0\"><node name=\"outInfo\" path=\"/mainloop/Recorder/outInfo/\">" +
         stream("0", "FRME", "<attr key=\"sizeX\" type=\"int\">7</attr><attr key=\"sizeY\" type=\"int\">8</attr>") +
         stream("1", "EVTS", sides) + stream("2", "EVTS", sides) + stream("3", "TRIG", "") + "</node></dv>";
}

inline std::string aedat4_header(int compression, std::int64_t end_of_packets, const std::string& streams) {
  const std::string buffer =
      little(20, 4) + "IOHE" + little(10, 2) + little(20, 2) + little(4, 2) + little(8, 2) + little(16, 2) +
      little(0, 2) + little(12, 4) + little(static_cast<std::uint64_t>(compression), 4) +
      little(static_cast<std::uint64_t>(end_of_packets), 8) + little(4, 4) + little(streams.size(), 4) + streams + '\0';
  return "#!AER-DAT4.0\r\n" + little(buffer.size(), 4) + buffer;
}

inline std::string aedat4_packet(int stream, const std::string& content) {
  return little(static_cast<std::uint64_t>(stream), 4) + little(content.size(), 4) + content;
}

/// The compressions of a format, as AEDAT 4's and MCAP's, that this build has.
inline std::vector<Compression> built_compressions(std::vector<Compression> compressions = {
                                                       Compression::none, Compression::lz4, Compression::zstd}) {
  std::erase_if(compressions, [](Compression compression) {
    return compression != Compression::none && !detail::find_decompressor(compression);
  });
  return compressions;
}

inline const std::vector<Compression> kRosbagCompressions{Compression::none, Compression::lz4, Compression::bz2};

inline std::string compress(const std::string& content, Compression compression) {
  std::string frame(2 * content.size() + 1000, '\0');
#ifdef EVMARKER_HAS_LZ4
  if (compression == Compression::lz4) {
    frame.resize(LZ4F_compressFrame(frame.data(), frame.size(), content.data(), content.size(), nullptr));
    return frame;
  }
#endif
#ifdef EVMARKER_HAS_ZSTD
  if (compression == Compression::zstd) {
    frame.resize(ZSTD_compress(frame.data(), frame.size(), content.data(), content.size(), 1));
    return frame;
  }
#endif
#ifdef EVMARKER_HAS_BZ2
  if (compression == Compression::bz2) {
    auto bytes = static_cast<unsigned>(frame.size());
    BZ2_bzBuffToBuffCompress(frame.data(), &bytes, const_cast<char*>(content.data()),
                             static_cast<unsigned>(content.size()), 1, 0, 0);
    frame.resize(bytes);
    return frame;
  }
#endif
  if (compression != Compression::none) throw std::logic_error("the tests are built without this compression");
  return content;
}

inline constexpr std::size_t kAedat4PacketEvents = 1000;

/// An AEDAT 4 recording in packets of up to kAedat4PacketEvents, with packets of other streams between them, and an
/// index.
inline std::string make_aedat4(std::span<const Event> events, SensorSize size,
                               Compression compression = Compression::none) {
  std::string packets;
  for (; !events.empty(); events = events.subspan(std::min(kAedat4PacketEvents, events.size()))) {
    const Event other{1, 2, 1, events[0].t};
    packets += aedat4_packet(
        1, compress(aedat4_events(events.first(std::min(kAedat4PacketEvents, events.size()))), compression));
    packets += aedat4_packet(2, compress(aedat4_events({&other, 1}), compression)) + aedat4_packet(0, "no frame");
  }
  const int number = compression == Compression::none ? 0 : compression == Compression::lz4 ? 1 : 3;
  const std::string streams = aedat4_streams(size);
  const std::size_t begin = aedat4_header(number, 0, streams).size();
  return aedat4_header(number, static_cast<std::int64_t>(begin + packets.size()), streams) + packets + "index";
}

}  // namespace evmarker::io::test
