#pragma once
// Fuzzed: recordings of ROS.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/io/event_messages.hpp"
#include "evmarker/io/mcap_reader.hpp"
#include "evmarker/io/rosbag_reader.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/recording_targets.hpp"
#include "fuzz/target.hpp"
#include "io/ros_bytes.hpp"

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

}  // namespace detail

inline void fuzz_mcap(std::string_view input) { detail::fuzz_recording<io::McapReader>(input, 61); }
inline void fuzz_rosbag(std::string_view input) { detail::fuzz_recording<io::RosbagReader>(input, 61); }

inline std::vector<Target> ros_targets() {
  using namespace detail;
  return {
      {"mcap", fuzz_mcap, mcap_seeds, {0, 1, make_mcap_part}, 4096, 50'000, 2.4},
      {"rosbag", fuzz_rosbag, rosbag_seeds, {0, 1, make_rosbag_part}, 4096, 50'000, 1.15},
  };
}

}  // namespace evmarker::fuzz
