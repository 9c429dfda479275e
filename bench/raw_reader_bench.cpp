#include <benchmark/benchmark.h>

#include <chrono>
#include <filesystem>
#include <random>
#include <string>

#include "evmarker/io/raw_reader.hpp"
#include "evmarker/io/raw_writer.hpp"
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

// Ten seconds of EVT3 from the system's file cache to events. The reader reads ahead on another thread, so that this
// thread's processor time would be too little: the rate is by the wall clock.
void read_evt3(benchmark::State& state) {
  constexpr Timestamp kRepeats = 10;
  const auto& recording = bench::recording();
  const TemporaryFile file(".raw");
  io::RawWriter writer(file.path(), bench::camera().sensor_size());
  for (Timestamp repeat = 0; repeat < kRepeats; ++repeat) {
    auto events = recording.events;
    for (Event& event : events) event.t += repeat * 1000000;
    writer.write(events);
  }
  writer.close();

  std::size_t events = 0;
  std::chrono::duration<double> elapsed{0};
  for (auto _ : state) {
    const auto begin = std::chrono::steady_clock::now();
    io::RawReader reader(file.path());
    for (auto batch = reader.next_batch(); !batch.empty(); batch = reader.next_batch()) {
      benchmark::DoNotOptimize(batch.data());
      events += batch.size();
    }
    elapsed += std::chrono::steady_clock::now() - begin;
  }
  if (events != static_cast<std::size_t>(state.iterations() * kRepeats) * recording.events.size())
    return state.SkipWithError("not all events came back");
  state.counters["events_per_second"] = static_cast<double>(events) / elapsed.count();
  state.counters["bytes_per_event"] = static_cast<double>(std::filesystem::file_size(file.path())) /
                                      static_cast<double>(kRepeats * static_cast<Timestamp>(recording.events.size()));
}
BENCHMARK(read_evt3)->Name("read/evt3")->Unit(benchmark::kMillisecond);

}  // namespace
