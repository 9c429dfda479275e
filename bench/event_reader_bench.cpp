#include <benchmark/benchmark.h>

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
template <unsigned DeflateLevel>
std::string make_hdf5(std::span<const Event> events, SensorSize) {
  io::test::Hdf5Bytes file;
  file.add_compounds("CD/events", events, {.chunk_rows = 16384, .deflate_level = DeflateLevel});
  file.add_attribute("geometry", "640x480");
  return file.bytes();
}
BENCHMARK_CAPTURE(read_bytes, hdf5, make_hdf5<0>)->Name("read/hdf5/none")->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(read_bytes, gzip, make_hdf5<1>)->Name("read/hdf5/gzip")->Unit(benchmark::kMillisecond);
#endif

}  // namespace
