#pragma once
// Fuzzed: recordings of ROS.
#include <array>
#include <cstddef>
#include <cstdint>
#include <fstream>
#include <functional>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/io/event_messages.hpp"
#include "evmarker/io/mcap_reader.hpp"
#include "evmarker/io/rosbag2_reader.hpp"
#include "evmarker/io/rosbag_reader.hpp"
#include "fuzz/input.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/recording_targets.hpp"
#include "fuzz/target.hpp"
#include "io/ros_bytes.hpp"
#include "io/rosbag2_file.hpp"

namespace evmarker::fuzz {

namespace detail {

inline io::test::RosEvents any_ros_events(std::uint64_t any) {
  return static_cast<io::test::RosEvents>(any % 5);  // all that there are
}

/// A message of a few events, in a serialization of either version of ROS.
inline std::string some_message(Random& random, io::test::RosEvents kind, bool cdr) {
  return io::test::event_messages(some_events(random.bits() % 4), {64, 48}, kind, cdr).front();
}

inline std::vector<std::string> mcap_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 10; ++seed)
    seeds.push_back(
        io::test::make_mcap(some_events(seed), {64, 48}, any_ros_events(seed), io::Compression::none, seed % 2 == 0));
  return seeds;
}

inline std::string make_mcap_part(Random& random) {
  const auto compressions = io::test::built_compressions();
  const auto kind = any_ros_events(random.bits());
  const bool cdr = below(random, 4) > 0;
  const int channel = static_cast<int>(below(random, 3));
  const std::string message = io::test::mcap_message(channel, some_message(random, kind, cdr)),
                    topic = io::test::mcap_channel(channel, below(random, 8) > 0 ? "/events" : "/other",
                                                   io::test::type_of(kind), cdr ? "cdr" : "ros1");
  switch (below(random, 6)) {
    case 0: return message;
    case 1: return topic;
    case 2: return io::test::little(random.bits() >> below(random, 64), std::size_t{1} << below(random, 4));
    case 3: return io::test::mcap_end(below(random, 1000), topic);
    default: return io::test::mcap_chunk(topic + message, compressions[below(random, compressions.size())]);
  }
}

inline std::vector<std::string> rosbag_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    std::string bag = io::test::make_rosbag(some_events(seed), {64, 48}, any_ros_events(seed));
    const auto padding = bag.find(std::string(4000, ' '));
    bag.replace(padding - 4, 4004, io::test::little(0, 4));
    seeds.push_back(bag);
  }
  return seeds;
}

inline std::string make_rosbag_part(Random& random) {
  const auto compressions = io::test::built_compressions(io::test::kRosbagCompressions);
  const auto kind = any_ros_events(random.bits());
  const int id = static_cast<int>(below(random, 3));
  const std::string message = io::test::bag_message(id, some_message(random, kind, false)),
                    topic = io::test::bag_connection(id, below(random, 8) > 0 ? "/events" : "/other",
                                                     io::test::type_of(kind));
  switch (below(random, 6)) {
    case 0: return message;
    case 1: return topic;
    case 2: return io::test::little(random.bits() >> below(random, 64), std::size_t{1} << below(random, 4));
    case 3: return io::test::bag_record(3, {{"index_pos", io::test::little(below(random, 4096), 8)}}, "");
    default: return io::test::bag_chunk(topic + message, compressions[below(random, compressions.size())]);
  }
}

#ifdef EVMARKER_HAS_SQLITE3

// Recordings of rosbag2, of which inputs say what bytes are other: files of SQLite have the version of libsqlite3 in
// them, so that they are no seeds themselves.
inline const std::string& written_rosbag2(std::size_t kind) {
  static const auto files = [] {
    std::array<std::string, 5> written;
    for (std::size_t i = 0; i < written.size(); ++i) {
      const DiskFile file("");
      io::test::write_rosbag2(file.path(), some_events(5), {64, 48}, any_ros_events(i));
      std::ifstream content(file.path(), std::ios::binary);
      written[i] = {std::istreambuf_iterator<char>(content), {}};
    }
    return written;
  }();
  return files[kind];
}

inline std::vector<std::string> rosbag2_seeds() {
  std::vector<std::string> seeds;
  for (std::size_t seed = 0; seed < 5; ++seed) seeds.push_back(io::test::little(seed, 1) + std::string(3, '\0'));
  return seeds;
}

// A position in the file, mostly in its first pages, and a byte that is other there.
inline std::string make_rosbag2_part(Random& random) {
  return io::test::little(random.bits() >> (48 + below(random, 16)), 2) + io::test::little(random.bits(), 1);
}

#endif

}  // namespace detail

#ifdef EVMARKER_HAS_SQLITE3
inline void fuzz_rosbag2(std::string_view input) {
  Numbers numbers(input);
  std::string content = detail::written_rosbag2(numbers.index(5));
  while (!numbers.empty()) {
    const std::size_t at = numbers.bits(2) % content.size();
    content[at] ^= static_cast<char>(numbers.byte());
  }
  const DiskFile file(content);
  detail::ReadRecording read;
  try {
    io::Rosbag2Reader reader(file.path(), {{SensorSize{64, 48}}});
    try {
      for (auto batch = reader.next_batch(); !batch.empty(); batch = reader.next_batch()) {
        read.events.insert(read.events.end(), batch.begin(), batch.end());
        require_that(reader.bytes_read() <= reader.bytes_total(), "no more than the file is read");
      }
      read.statistics = reader.statistics();
      read.statistics.triggers = 0;
      detail::check_counts(read, reader.sensor_size());
    } catch (const io::RecordingError&) {
      arrived += read.events.size();
      throw;
    }
  } catch (const io::RecordingError& error) {
    require_that(std::string_view(error.what()).find('\n') == std::string_view::npos, "errors are one line");
  }
}
#endif

inline void fuzz_mcap(std::string_view input) { detail::fuzz_recording<io::McapReader>(input, 61); }
inline void fuzz_rosbag(std::string_view input) { detail::fuzz_recording<io::RosbagReader>(input, 61); }

inline std::vector<Target> ros_targets() {
  using namespace detail;
  return {
#ifdef EVMARKER_HAS_SQLITE3
      {"rosbag2", fuzz_rosbag2, rosbag2_seeds, {1, 3, make_rosbag2_part}, 64, 5'000, 21},
#endif
      {"mcap", fuzz_mcap, mcap_seeds, {0, 1, make_mcap_part}, 4096, 50'000, 2.2},
      {"rosbag", fuzz_rosbag, rosbag_seeds, {0, 1, make_rosbag_part}, 4096, 50'000, 1.15},
  };
}

}  // namespace evmarker::fuzz
