// Says what recordings are: format, sensor, rate of events, gaps, noise, hot pixels, faults.
#include <algorithm>
#include <cinttypes>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <evmarker/base/median.hpp>
#include <evmarker/events/event.hpp>
#include <evmarker/events/hot_pixels.hpp>
#include <evmarker/events/spatiotemporal_filter.hpp>
#include <evmarker/events/time_guard.hpp>
#include <evmarker/io/event_reader.hpp>
#include <exception>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "console.hpp"
#include "event_gaps.hpp"
#include "input_options.hpp"
#include "interruption.hpp"
#include "rate_curve.hpp"
#include "recorded_time.hpp"
#include "recording_checks.hpp"
#include "recording_faults.hpp"

using namespace evmarker;

namespace {

struct Options {
  std::vector<std::string> recordings;
  InputOptions input;
  bool quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("recordings", recordings,
                   "Prophesee RAW or DAT, AEDAT, HDF5, ROS or text (x, y, p and t in columns)")
        ->required();
    input.add_to(app);
    app.add_flag("--quiet", quiet, "no progress bar");
    app.footer(console::exit_codes());
  }
};

// What pixels do without a cause: noise, and those that are broken.
class PixelFaults {
 public:
  explicit PixelFaults(SensorSize size)
      : size_(size), filter_(size), hot_(size), events_(pixels(size)), is_hot_(pixels(size)) {}

  void add(const Event& event) {
    hot_.count(std::span(&event, 1));
    if (++added_ % HotPixels::kEventsPerUpdate == 0) hot_.update();
    ++events_[index(event)];
    if (hot_.is_hot(event)) {
      is_hot_[index(event)] = true;
      return;
    }
    filter_.accept(event);
    ++not_hot_;
    if (event.t >= next_sample_ || event.t < next_sample_ - kSample_us) {
      noise_.push_back(filter_.background_hz_per_px());
      next_sample_ = later(event.t, std::chrono::microseconds(kSample_us));
    }
  }

  /// True if there were enough events to measure the noise by.
  bool knows_noise(double seconds) const { return not_hot_ >= 1000 && seconds >= 0.05; }

  /// Noise events of the whole sensor [1/s], in the quietest tenth of the recording: edges may hide the noise
  /// elsewhere.
  double least_noise_hz() const {
    std::vector<double> sorted = noise_;
    std::ranges::sort(sorted);
    return sorted[sorted.size() / 10] * static_cast<double>(events_.size());
  }

  void print(double seconds) const {
    constexpr std::size_t kMostNamed = 5;
    if (knows_noise(seconds)) std::printf("noise      %.2g events per second and pixel\n", median(noise_));
    std::vector<std::pair<std::uint64_t, std::size_t>> hot;
    for (std::size_t i = 0; i < is_hot_.size(); ++i)
      if (is_hot_[i]) hot.emplace_back(events_[i], i);
    std::ranges::sort(hot, std::greater<>());
    std::printf("hot pixels %zu", hot.size());
    const auto width = static_cast<std::size_t>(size_.width);
    for (std::size_t i = 0; i < std::min(hot.size(), kMostNamed); ++i)
      std::printf("%s (%zu, %zu) %s", i == 0 ? ":" : ",", hot[i].second % width, hot[i].second / width,
                  RateCurve::text(static_cast<double>(hot[i].first) / seconds).c_str());
    std::puts(hot.size() > kMostNamed ? ", ..." : "");
  }

 private:
  static constexpr Timestamp kSample_us = 10000;

  static std::size_t pixels(SensorSize size) {
    return static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
  }
  std::size_t index(const Event& event) const {
    return static_cast<std::size_t>(event.y) * static_cast<std::size_t>(size_.width) + event.x;
  }

  SensorSize size_;
  SpatiotemporalFilter filter_;  // measures the noise that it is to remove
  HotPixels hot_;
  std::vector<std::uint64_t> events_;  // of each pixel
  std::vector<bool> is_hot_;
  std::vector<double> noise_;  // [Hz/px], every 10 ms
  Timestamp next_sample_ = 0;
  std::uint64_t added_ = 0, not_hot_ = 0;
};

class Profile {
 public:
  explicit Profile(SensorSize size) : pixels_(size) {}

  void add(std::span<const Event> events) {
    for (const Event& event : events) {
      ++events_;
      on_ += event.p > 0;
      TimeGuard::Verdict verdict = guard_.judge(event);
      for (; verdict == TimeGuard::Verdict::release; verdict = guard_.judge(event)) take(guard_.held());
      if (verdict == TimeGuard::Verdict::pass) take(event);
    }
  }

  void add(std::span<const TriggerEvent> triggers) {
    for (const TriggerEvent& trigger : triggers) {
      auto& [rising, falling] = triggers_[trigger.id];
      ++(trigger.rising ? rising : falling);
    }
  }

  double recorded_s() const { return recorded_.seconds(); }

  void print(const io::RecordingStatistics& statistics) const {
    std::printf("events     %" PRIu64, events_);
    if (events_ > 0) std::printf(", %.1f %% ON", 100 * static_cast<double>(on_) / static_cast<double>(events_));
    std::puts("");
    if (recorded_s() > 0) print_times();
    for (const auto& [id, counts] : triggers_)
      std::printf("triggers   input %d: %" PRIu64 " rising, %" PRIu64 " falling\n", id, counts.first, counts.second);
    recording_faults::print(guard_.faults(), "events whose time neither the one before nor the one after confirms");
    recording_faults::print(recorded_.stray(), recording_faults::kStray);
    recording_faults::print(statistics);
  }

 private:
  void take(const Event& event) {
    recorded_.add(event.t);
    rate_.add(event.t);
    pixels_.add(event);
  }

  void print_times() const {
    const auto seconds = [](Timestamp t) { return 1e-6 * static_cast<double>(t); };
    std::printf("time       %.6f s to %.6f s: %.2f s\n", seconds(recorded_.begin()), seconds(recorded_.end()),
                recorded_s());
    std::printf("rate       %s mean", RateCurve::text(static_cast<double>(events_) / recorded_s()).c_str());
    if (recorded_s() >= 1e-6 * RateCurve::kWindow_us)
      std::printf(", %s peak (in 10 ms)", RateCurve::text(rate_.peak_hz()).c_str());
    std::puts("");
    rate_.print(recorded_.begin(), recorded_.end());
    const EventGaps gaps = recorded_.gaps();
    std::printf("gaps       longest %.3f ms, after %.6f s", 1e-3 * static_cast<double>(gaps.longest_us()),
                seconds(gaps.longest_from()));
    if (pixels_.knows_noise(recorded_s())) {
      constexpr double kEnough = 20;  // noise events that did not come: by chance, in 2 of 10^9 such times
      const double gap_us = 1e6 * kEnough / pixels_.least_noise_hz();
      std::printf("; %" PRIu64 " of more than %.3g ms, in which %.0f noise events were due", gaps.count_from(gap_us),
                  1e-3 * gap_us, kEnough);
    }
    std::puts("");
    pixels_.print(recorded_s());
  }

  std::uint64_t events_ = 0, on_ = 0;
  TimeGuard guard_;
  RecordedTimeWith<EventGaps> recorded_;
  RateCurve rate_;
  PixelFaults pixels_;
  std::map<int, std::pair<std::uint64_t, std::uint64_t>> triggers_;  // rising and falling, of each input
};

// Also prints what there is before a fault that ends the recording.
void describe(const Options& options, const std::string& path) {
  io::EventReader recording = options.input.open(path);
  Profile profile(recording.sensor_size());
  std::exception_ptr fault;
  try {
    console::ProgressBar progress(options.quiet);
    for (bool more = true; more && !interruption::requested;) {
      const std::span<const Event> batch = recording.next_batch();
      profile.add(batch);
      profile.add(recording.triggers());
      more = !batch.empty();
      progress.update(recording.bytes_read(), recording.bytes_total());
    }
  } catch (const io::RecordingError&) {
    fault = std::current_exception();
  }
  std::printf("%s\nformat     %s\nsensor     %s\n", path.c_str(), recording.format().c_str(),
              recording_checks::show(recording.sensor_size()).c_str());
  io::RecordingStatistics statistics = recording.statistics();
  if (interruption::requested) statistics.truncated_bytes = 0;  // it is not the recording that ends there
  profile.print(statistics);
  if (interruption::requested) interruption::end(profile.recorded_s(), {});
  if (fault) std::rethrow_exception(fault);
}

void info(const Options& options) {
  interruption::watch();
  std::size_t faulty = 0;
  for (const std::string& path : options.recordings) {
    if (&path != &options.recordings.front()) std::puts("");
    try {
      describe(options, path);
    } catch (const io::RecordingError& error) {
      if (options.recordings.size() == 1) throw;
      std::fprintf(stderr, "info: %s\n", error.what());
      ++faulty;
    }
  }
  if (faulty > 0)
    throw std::runtime_error(std::to_string(faulty) + " of " + std::to_string(options.recordings.size()) +
                             " recordings cannot be read to the end");
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("info", "Says what recordings of event cameras are, and what is wrong with them.", argc,
                               argv, info);
}
