#pragma once
// Fuzzed: whole recordings of the kinds other than RAW and text.
#include <cstddef>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/dat_reader.hpp"
#include "fuzz/evt_targets.hpp"
#include "fuzz/input.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/target.hpp"
#include "io/recording_bytes.hpp"

namespace evmarker::fuzz {

namespace detail {

struct ReadRecording : Decoded {
  std::string error;  ///< at which it ended; empty at the end of the file
  bool operator==(const ReadRecording&) const = default;
};

template <typename Reader>
ReadRecording read_recording(const MemoryFile& file, std::size_t block_bytes, bool shift) {
  ReadRecording read;
  Reader reader(io::BlockReader(file.path(), block_bytes), {SensorSize{64, 48}, shift});
  try {
    while (true) {
      const auto batch = reader.next_batch();
      read.triggers.insert(read.triggers.end(), reader.triggers().begin(), reader.triggers().end());
      if (batch.empty()) break;
      read.events.insert(read.events.end(), batch.begin(), batch.end());
    }
  } catch (const io::RecordingError& error) {
    read.error = error.what();
    require_that(read.error.find('\n') == std::string::npos, "errors are one line");
  }
  require_that(reader.bytes_read() <= reader.bytes_total(), "no more than the file is read");
  read.statistics = reader.statistics();
  if (!shift && read.error.empty()) check_counts(read, reader.sensor_size());
  return read;
}

/// @param first_block the block of this length shows the header whole
template <typename Reader>
void fuzz_recording(std::string_view input, std::size_t first_block) {
  const MemoryFile file(input);
  try {
    const auto whole = read_recording<Reader>(file, io::BlockReader::kBlockBytes, false);
    // Opening files and starting threads take most of the time: each comparison is made for one input in four.
    const std::size_t comparison = std::hash<std::string_view>()(input) % 4;
    if (comparison == 0)
      require_that(read_recording<Reader>(file, first_block + input.size() % 61, false) == whole,
                   "blocks of any length give the same events");
    if (comparison == 1) {
      const auto shifted = read_recording<Reader>(file, io::BlockReader::kBlockBytes, true);
      require_that(!shifted.error.empty() || shifted.statistics == whole.statistics, "shifted times change no counts");
    }
  } catch (const io::RecordingError& error) {
    require_that(std::string_view(error.what()).find('\n') == std::string_view::npos, "errors are one line");
  }
}

inline std::vector<Event> some_events(std::uint64_t seed) {
  Random random(seed);
  std::vector<Event> events;
  Timestamp t = 0;
  for (std::size_t count = std::size_t{1} << (seed % 6); count > 0; --count) {
    t += static_cast<Timestamp>(below(random, 100));
    events.push_back({static_cast<std::uint16_t>(below(random, 64)), static_cast<std::uint16_t>(below(random, 48)),
                      static_cast<std::int16_t>(below(random, 2)), t});
  }
  return events;
}

inline std::vector<std::string> dat_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 6; ++seed)
    seeds.push_back(io::test::make_dat(some_events(seed), {64, 48}, 2 - static_cast<int>(seed) % 2));
  seeds.push_back(io::test::dat_header({64, 48}) + "\x0e\x08" + io::test::dat_record(TriggerEvent{3, true, 100}));
  return seeds;
}

inline std::string make_dat_part(Random& random) {
  static const std::vector<std::string> lines{
      "% Version 1\n",      "% Version 2\n", "% Width 64\n", "% Height 48\n", "% Height -1\n",
      "% geometry 64x48\n", "% end\n",       "\x0c\x08",     "\x0e\x08",      "% "};
  if (below(random, 3) == 0) return lines[below(random, lines.size())];
  return io::test::dat_record(some_events(6 * random.bits()).front(), static_cast<int>(1 + below(random, 2)));
}

}  // namespace detail

inline void fuzz_dat(std::string_view input) {
  std::size_t header = 0;
  try {
    header = io::detail::read_header_lines(input, "fuzzed").bytes;
  } catch (const io::RecordingError&) {
  }
  detail::fuzz_recording<io::DatReader>(input, header + 1);
}

inline std::vector<Target> recording_targets() {
  using namespace detail;
  return {
      {"dat", fuzz_dat, dat_seeds, {0, 1, make_dat_part}, 512, 50'000, 5},
  };
}

}  // namespace evmarker::fuzz
