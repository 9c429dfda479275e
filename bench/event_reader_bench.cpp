#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <random>
#include <span>
#include <string>
#include <vector>

#include "evmarker/io/event_reader.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "io/hdf5_bytes.hpp"
#include "io/recording_bytes.hpp"
#include "io/ros_bytes.hpp"
#include "io/rosbag2_file.hpp"
#include "recording.hpp"

using namespace evmarker;

namespace {

/// A file that is gone when the benchmark is done.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& suffix)
      : path_(std::filesystem::temp_directory_path() /
              ("evmarker_bench_" + std::to_string(std::random_device{}()) + suffix)) {}
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove(path_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// Ten seconds of events.
const std::vector<Event>& events() {
  static const std::vector<Event> events = [] {
    constexpr Timestamp kRepeats = 10;
    std::vector<Event> repeated;
    for (Timestamp repeat = 0; repeat < kRepeats; ++repeat)
      for (Event event : bench::recording().events) {
        event.t += repeat * 1000000;
        repeated.push_back(event);
      }
    return repeated;
  }();
  return events;
}

// From the system's file cache to events. The reader reads ahead on another thread, so that this thread's processor
// time would be too little: the rate is by the wall clock.
void read(benchmark::State& state, const std::filesystem::path& path) {
  std::size_t count = 0;
  std::chrono::duration<double> elapsed{0};
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    io::EventReader reader(path);
    for (auto batch = reader.next_batch(); !batch.empty(); batch = reader.next_batch()) {
      benchmark::DoNotOptimize(batch.data());
      count += batch.size();
    }
    elapsed += std::chrono::steady_clock::now() - begin;
  }
  if (count != static_cast<std::size_t>(state.iterations()) * events().size())
    return state.SkipWithError("not all events came back");
  state.counters["events_per_second"] = static_cast<double>(count) / elapsed.count();
  state.counters["bytes_per_event"] =
      static_cast<double>(std::filesystem::file_size(path)) / static_cast<double>(events().size());
}

void read_evt3(benchmark::State& state) {
  const TemporaryFile file(".raw");
  io::RawWriter writer(file.path(), bench::camera().sensor_size());
  writer.write(events());
  writer.close();
  read(state, file.path());
}
BENCHMARK(read_evt3)->Name("read/evt3")->Unit(benchmark::kMillisecond);

// Of the formats that the library does not write, by the makers of the tests' recordings.
void read_bytes(benchmark::State& state, std::string (*make)(std::span<const Event>, SensorSize)) {
  const TemporaryFile file("");
  std::ofstream(file.path(), std::ios::binary) << make(events(), bench::camera().sensor_size());
  read(state, file.path());
}

std::string make_dat(std::span<const Event> events, SensorSize size) { return io::test::make_dat(events, size); }
template <io::Compression Compression>
std::string make_aedat4(std::span<const Event> events, SensorSize size) {
  return io::test::make_aedat4(events, size, Compression);
}
BENCHMARK_CAPTURE(read_bytes, dat, make_dat)->Name("read/dat")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_bytes, aedat2, io::test::make_aedat2)->Name("read/aedat2")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_bytes, aedat3, io::test::make_aedat3)->Name("read/aedat3")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_bytes, aedat4, make_aedat4<io::Compression::none>)
    ->Name("read/aedat4/none")
    ->Unit(benchmark::kMillisecond);
#ifdef EVMARKER_HAS_LZ4
BENCHMARK_CAPTURE(read_bytes, lz4, make_aedat4<io::Compression::lz4>)
    ->Name("read/aedat4/lz4")
    ->Unit(benchmark::kMillisecond);
#endif
#ifdef EVMARKER_HAS_ZSTD
BENCHMARK_CAPTURE(read_bytes, zstd, make_aedat4<io::Compression::zstd>)
    ->Name("read/aedat4/zstd")
    ->Unit(benchmark::kMillisecond);
#endif

// What the libraries alone take for the same bytes: with these, the share of their rate that reading reaches.
void report_rate(benchmark::State& state, std::chrono::duration<double> elapsed) {
  state.counters["events_per_second"] =
      static_cast<double>(state.iterations()) * static_cast<double>(events().size()) / elapsed.count();
}

/// The frames that `make_aedat4` makes of the events.
std::vector<std::string> frames(io::Compression compression) {
  constexpr std::size_t kEvents = io::test::kAedat4PacketEvents;
  std::vector<std::string> frames;
  for (std::span<const Event> rest = events(); !rest.empty(); rest = rest.subspan(std::min(kEvents, rest.size())))
    frames.push_back(
        io::test::compress(io::test::aedat4_events(rest.first(std::min(kEvents, rest.size()))), compression));
  return frames;
}

/// @param decompress takes a frame and where its content is written
template <typename Decompress>
void decompress_alone(benchmark::State& state, io::Compression compression, const Decompress& decompress) {
  const std::vector<std::string> compressed = frames(compression);
  std::vector<char> content(1 << 16);
  std::chrono::duration<double> elapsed{0};
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    for (const std::string& frame : compressed) {
      decompress(frame, content);
      benchmark::DoNotOptimize(content.data());
    }
    elapsed += std::chrono::steady_clock::now() - begin;
  }
  report_rate(state, elapsed);
}

#ifdef EVMARKER_HAS_LZ4
void lz4_alone(benchmark::State& state) {
  LZ4F_dctx* context = nullptr;
  LZ4F_createDecompressionContext(&context, LZ4F_VERSION);
  decompress_alone(state, io::Compression::lz4, [&](const std::string& frame, std::vector<char>& content) {
    std::size_t produced = content.size(), consumed = frame.size();
    if (LZ4F_decompress(context, content.data(), &produced, frame.data(), &consumed, nullptr) != 0)
      state.SkipWithError("a frame is not whole");
  });
  LZ4F_freeDecompressionContext(context);
}
BENCHMARK(lz4_alone)->Name("read/aedat4/lz4/library_alone")->Unit(benchmark::kMillisecond);
#endif
#ifdef EVMARKER_HAS_ZSTD
void zstd_alone(benchmark::State& state) {
  ZSTD_DCtx* const context = ZSTD_createDCtx();
  decompress_alone(state, io::Compression::zstd, [&](const std::string& frame, std::vector<char>& content) {
    if (ZSTD_isError(ZSTD_decompressDCtx(context, content.data(), content.size(), frame.data(), frame.size())) != 0)
      state.SkipWithError("a frame is not whole");
  });
  ZSTD_freeDCtx(context);
}
BENCHMARK(zstd_alone)->Name("read/aedat4/zstd/library_alone")->Unit(benchmark::kMillisecond);
#endif

template <io::test::RosEvents Kind>
std::string make_mcap(std::span<const Event> events, SensorSize size) {
  return io::test::make_mcap(events, size, Kind);
}
BENCHMARK_CAPTURE(read_bytes, mcap_evt3, make_mcap<io::test::RosEvents::evt3>)
    ->Name("read/mcap/evt3")
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_bytes, mcap_libcaer_cmp, make_mcap<io::test::RosEvents::libcaer_cmp>)
    ->Name("read/mcap/libcaer_cmp")
    ->Unit(benchmark::kMillisecond);
std::string make_rosbag(std::span<const Event> events, SensorSize size) {
  return io::test::make_rosbag(events, size, io::test::RosEvents::array);
}
BENCHMARK_CAPTURE(read_bytes, rosbag, make_rosbag)->Name("read/rosbag/dvs_msgs")->Unit(benchmark::kMillisecond);

#ifdef EVMARKER_HAS_SQLITE3
void read_rosbag2(benchmark::State& state) {
  const TemporaryFile file("");
  io::test::write_rosbag2(file.path(), events(), bench::camera().sensor_size(), io::test::RosEvents::libcaer);
  read(state, file.path());
}
BENCHMARK(read_rosbag2)->Name("read/rosbag2/libcaer")->Unit(benchmark::kMillisecond);
#endif

#ifdef EVMARKER_HAS_HDF5
constexpr hsize_t kHdf5ChunkRows = 16384;

template <unsigned DeflateLevel>
std::string make_hdf5(std::span<const Event> events, SensorSize) {
  io::test::Hdf5Bytes file;
  file.add_compounds("CD/events", events, {.chunk_rows = kHdf5ChunkRows, .deflate_level = DeflateLevel});
  file.add_attribute("geometry", "640x480");
  return file.bytes();
}
BENCHMARK_CAPTURE(read_bytes, hdf5, make_hdf5<0>)->Name("read/hdf5/none")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_bytes, gzip, make_hdf5<1>)->Name("read/hdf5/gzip")->Unit(benchmark::kMillisecond);

// All rows, a chunk at a time, as they are in the file.
template <unsigned DeflateLevel>
void hdf5_alone(benchmark::State& state) {
  const TemporaryFile path("");
  std::ofstream(path.path(), std::ios::binary) << make_hdf5<DeflateLevel>(events(), bench::camera().sensor_size());
  std::chrono::duration<double> elapsed{0};
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    const io::Hdf5Handle file(H5Fopen(path.path().c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    const io::Hdf5Handle dataset(H5Dopen2(file.get(), "CD/events", H5P_DEFAULT), H5Dclose);
    const io::Hdf5Handle type(H5Dget_type(dataset.get()), H5Tclose), space(H5Dget_space(dataset.get()), H5Sclose);
    std::vector<char> rows(kHdf5ChunkRows * H5Tget_size(type.get()));
    for (hsize_t row = 0; row < events().size(); row += kHdf5ChunkRows) {
      const hsize_t count = std::min<hsize_t>(kHdf5ChunkRows, events().size() - row);
      const io::Hdf5Handle memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
      H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, &row, nullptr, &count, nullptr);
      if (H5Dread(dataset.get(), type.get(), memory.get(), space.get(), H5P_DEFAULT, rows.data()) < 0)
        return state.SkipWithError("libhdf5 cannot read it");
      benchmark::DoNotOptimize(rows.data());
    }
    elapsed += std::chrono::steady_clock::now() - begin;
  }
  report_rate(state, elapsed);
}
BENCHMARK(hdf5_alone<0>)->Name("read/hdf5/none/library_alone")->Unit(benchmark::kMillisecond);
BENCHMARK(hdf5_alone<1>)->Name("read/hdf5/gzip/library_alone")->Unit(benchmark::kMillisecond);
#endif

}  // namespace
