#pragma once
// Fuzzed: whole recordings of the kinds other than RAW and text.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/io/aedat2_reader.hpp"
#include "evmarker/io/aedat3_reader.hpp"
#include "evmarker/io/aedat4_reader.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/dat_reader.hpp"
#include "evmarker/io/hdf5_reader.hpp"
#include "fuzz/evt_targets.hpp"
#include "fuzz/input.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/target.hpp"
#include "io/hdf5_bytes.hpp"
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

inline std::vector<std::string> aedat2_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const bool davis = seed % 2 == 0;
    std::string bytes = io::test::aedat2_header(davis ? "DavisX" : "");
    for (const Event& event : some_events(seed))
      bytes += io::test::aedat2_record(
          davis ? io::test::davis_address(event, {64, 48}) : io::test::dvs128_address(event), event.t);
    seeds.push_back(bytes);
  }
  return seeds;
}

inline std::string make_aedat2_part(Random& random) {
  static const std::vector<std::string> lines{"#!AER-DAT2.0\r\n", "# AEChip: DVS128\r\n", "# AEChip: DAVIS240C\r\n",
                                              "#End Of ASCII Header\r\n", "#"};
  if (below(random, 4) == 0) return lines[below(random, lines.size())];
  const Event event = some_events(6 * random.bits()).front();
  return io::test::aedat2_record(
      below(random, 2) == 0 ? io::test::davis_address(event, {64, 48}) : io::test::dvs128_address(event), event.t - 50);
}

inline std::vector<std::string> aedat3_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 6; ++seed) seeds.push_back(io::test::make_aedat3(some_events(seed), {64, 48}));
  seeds.push_back(io::test::aedat3_header("DVS128") + io::test::aedat3_packet(0, 1, 8, 1, 0) + "\x05" +
                  std::string(7, '\0'));
  return seeds;
}

inline std::string make_aedat3_part(Random& random) {
  static const std::vector<std::string> lines{"#!AER-DAT3.1\r\n", "#Source 1: DVS128\r\n", "#Format: RAW\r\n",
                                              "#!END-HEADER\r\n"};
  switch (below(random, 4)) {
    case 0: return lines[below(random, lines.size())];
    case 1:
      return io::test::aedat3_packet(static_cast<int>(below(random, 3)), static_cast<int>(below(random, 3)), 8,
                                     below(random, 5), random.bits() % 2 == 0 ? 0 : random.bits());
    default: return io::test::aedat3_event(some_events(6 * random.bits()).front());
  }
}

// The input as the content of a frame, of which for every other input one byte is garbled.
inline void fuzz_decompressors(std::string_view input) {
  const std::size_t garbled = std::hash<std::string_view>()(input);
  for (const auto compression : {io::Compression::lz4, io::Compression::zstd, io::Compression::bz2}) {
    if (io::test::built_compressions({compression}).empty()) continue;
    const auto decompressor = io::make_decompressor(compression, "packets", "fuzzed");
    std::string frame = io::test::compress(std::string(input), compression);
    if (garbled % 2 == 1) frame[garbled / 2 % frame.size()] ^= static_cast<char>(1U << garbled / 2 % 8);
    try {
      const auto content = decompressor->decompress(as_bytes(frame));
      require_that(garbled % 2 == 1 || std::ranges::equal(content, as_bytes(input)), "frames hold what was compressed");
    } catch (const std::runtime_error&) {
      require_that(garbled % 2 == 1, "whole frames are decompressed");
    }
  }
}

inline std::string some_aedat4_triggers(std::size_t count) {
  std::vector<io::test::Aedat4Trigger> triggers;
  for (std::size_t i = 0; i < count; ++i)
    triggers.push_back({static_cast<Timestamp>(1000 * i), static_cast<int>(1 + i % 5)});
  return io::test::aedat4_triggers(triggers);
}

inline std::vector<std::string> aedat4_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 6; ++seed) seeds.push_back(io::test::make_aedat4(some_events(seed), {64, 48}));
  for (const std::size_t triggers : {std::size_t{1}, std::size_t{5}})
    seeds.push_back(io::test::aedat4_header(0, -1, io::test::aedat4_streams({64, 48})) +
                    io::test::aedat4_packet(3, some_aedat4_triggers(triggers)) +
                    io::test::aedat4_packet(1, io::test::aedat4_events(some_events(1))));
  return seeds;
}

inline std::string make_aedat4_part(Random& random) {
  const auto compressions = io::test::built_compressions();
  const auto compression = compressions[below(random, compressions.size())];
  const std::uint64_t any = random.bits() >> below(random, 64);
  switch (below(random, 5)) {
    case 0:
      return io::test::aedat4_header(static_cast<int>(below(random, 6)), static_cast<std::int64_t>(any),
                                     io::test::aedat4_streams({64, 48}));
    case 1: return io::test::little(any, std::size_t{1} << below(random, 4));
    case 2: return "<node name=\"outInfo\"><node name=\"1\"><attr key=\"typeIdentifier\">EVTS</attr></node></node>";
    case 3: return io::test::aedat4_packet(3, io::test::compress(some_aedat4_triggers(below(random, 9)), compression));
    default:
      return io::test::aedat4_packet(
          static_cast<int>(below(random, 3)),
          io::test::compress(io::test::aedat4_events(some_events(random.bits() % 4)), compression));
  }
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

// Their headers are read line by line.
inline void fuzz_aedat2(std::string_view input) { detail::fuzz_recording<io::Aedat2Reader>(input, 61); }
inline void fuzz_aedat3(std::string_view input) { detail::fuzz_recording<io::Aedat3Reader>(input, 61); }
inline void fuzz_aedat4(std::string_view input) {
  detail::fuzz_recording<io::Aedat4Reader>(input, 61);
  detail::fuzz_decompressors(input);
}

#ifdef EVMARKER_HAS_HDF5

namespace detail {

/// What the first bytes of an input say about a file of HDF5; the bytes behind them are the rows.
struct Hdf5Input {
  int layout;  ///< datasets, compounds, columns
  bool has_float_times;
  io::test::Hdf5Storage storage;
  std::int64_t offset;
  std::vector<std::int64_t> x, y, p, t;

  explicit Hdf5Input(std::string_view input) {
    Numbers numbers(input);
    layout = numbers.byte() % 3;
    has_float_times = numbers.flag();
    storage = {.chunk_rows = numbers.byte(), .deflate_level = 0};
    storage.deflate_level = numbers.byte() % 2;
    offset = static_cast<std::int64_t>(numbers.bits(8)) >> numbers.byte() % 64;
    while (!numbers.empty()) {
      x.push_back(static_cast<std::int8_t>(numbers.byte()));
      y.push_back(static_cast<std::int8_t>(numbers.byte()));
      p.push_back(static_cast<std::int8_t>(numbers.byte()) % 3);
      t.push_back(static_cast<std::int64_t>(numbers.bits(8)) >> numbers.byte() % 64);
    }
    storage.chunk_rows = std::min<hsize_t>(storage.chunk_rows, x.size());  // libhdf5 makes no others
    if (storage.chunk_rows == 0) storage.deflate_level = 0;
  }

  std::string file() const {
    io::test::Hdf5Bytes file;
    const hid_t time = has_float_times ? H5T_IEEE_F64LE : H5T_STD_I64LE;
    if (layout == 0) {
      file.add("events/x", x, H5T_STD_I8LE, storage);
      file.add("events/y", y, H5T_STD_I16BE, storage);
      file.add("events/p", p, H5T_STD_I32LE, storage);
      file.add("events/t", t, time, storage);
    } else {
      std::vector<std::int64_t> rows;
      for (std::size_t i = 0; i < x.size(); ++i) rows.insert(rows.end(), {x[i], y[i], t[i], p[i]});
      if (layout == 1) {
        const hid_t type = H5Tcreate(H5T_COMPOUND, 32);
        for (std::size_t i = 0; i < 4; ++i) H5Tinsert(type, std::string(1, "xytp"[i]).c_str(), 8 * i, H5T_NATIVE_INT64);
        file.add("CD/events", {x.size()}, type, type, rows.data(), storage);
        H5Tclose(type);
        file.add_triggers("EXT_TRIGGER/events", triggers(), storage);
      } else {
        file.add("davis/left/events", {x.size(), 4}, time, H5T_NATIVE_INT64, rows.data(), storage);
      }
    }
    file.add_number("t_offset", offset);
    return file.bytes();
  }

  // One for each event, where Prophesee has them.
  std::vector<TriggerEvent> triggers() const {
    std::vector<TriggerEvent> triggers;
    for (std::size_t i = 0; layout == 1 && i < x.size(); ++i)
      triggers.push_back({static_cast<int>(y[i] & 31), p[i] > 0, t[i]});
    return triggers;
  }
};

inline std::vector<std::string> hdf5_seeds() {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    Random random(seed);
    std::string input{static_cast<char>(seed % 3), static_cast<char>(seed / 3), static_cast<char>(seed), 1};
    input += std::string(9, '\0');
    for (const Event& event : some_events(seed))
      input += io::test::little(event.x, 1) + io::test::little(event.y, 1) + io::test::little(event.p > 0, 1) +
               io::test::little(static_cast<std::uint64_t>(event.t), 8) + '\0';
    seeds.push_back(input);
  }
  return seeds;
}

inline std::string make_hdf5_part(Random& random) {
  return io::test::little(below(random, 64), 1) + io::test::little(below(random, 48), 1) +
         io::test::little(random.bits(), 9) + io::test::little(below(random, 64), 1);
}

}  // namespace detail

// The files are whole: libhdf5 itself does not survive all that are garbled.
inline void fuzz_hdf5(std::string_view input) {
  const detail::Hdf5Input rows(input);
  const DiskFile file(rows.file());
  const SensorSize size{64, 48};
  try {
    io::Hdf5Reader reader(file.path(), {{size}, io::TimeUnit::microseconds});
    std::vector<Event> read;
    std::vector<TriggerEvent> triggers;
    std::string error;
    try {
      for (bool more = true; more;) {
        const auto batch = reader.next_batch();
        more = !batch.empty();
        read.insert(read.end(), batch.begin(), batch.end());
        triggers.insert(triggers.end(), reader.triggers().begin(), reader.triggers().end());
      }
    } catch (const io::RecordingError& fault) {
      error = fault.what();
    }
    require_that(error.find('\n') == std::string::npos, "errors are one line");
    arrived += read.size();
    std::size_t next = 0, row = 0;
    for (; row < rows.x.size() && (next < read.size() || error.empty()); ++row) {
      if (!size.contains(static_cast<int>(rows.x[row]), static_cast<int>(rows.y[row]))) continue;
      const Event& event = read.at(next++);
      const bool exact = std::abs(rows.t[row]) < std::int64_t{1} << 53;
      require_that(event.x == rows.x[row] && event.y == rows.y[row] && event.p == (rows.p[row] > 0 ? 1 : 0) &&
                       (!exact || event.t == rows.t[row] + rows.offset),
                   "the events are those of the file");
    }
    require_that(next == read.size(), "no other events are read");
    require_that(!error.empty() || triggers == rows.triggers(), "the triggers are those of the file");
  } catch (const io::RecordingError& error) {
    require_that(std::string_view(error.what()).find('\n') == std::string_view::npos, "errors are one line");
  }
}

#endif

inline std::vector<Target> recording_targets() {
  using namespace detail;
  return {
#ifdef EVMARKER_HAS_HDF5
      {"hdf5", fuzz_hdf5, hdf5_seeds, {13, 12, make_hdf5_part}, 512, 5'000, 9.5},
#endif
      {"dat", fuzz_dat, dat_seeds, {0, 1, make_dat_part}, 512, 50'000, 5},
      {"aedat2", fuzz_aedat2, aedat2_seeds, {0, 1, make_aedat2_part}, 512, 50'000, 6.5},
      {"aedat3", fuzz_aedat3, aedat3_seeds, {0, 1, make_aedat3_part}, 1024, 50'000, 4.4},
      {"aedat4", fuzz_aedat4, aedat4_seeds, {0, 1, make_aedat4_part}, 4096, 20'000, 2.4},
  };
}

}  // namespace evmarker::fuzz
