#pragma once
// Floor 4. An event camera that looks at markers on known trajectories: events with their truth.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/event.hpp"
#include "evmarker/event_pixel.hpp"
#include "evmarker/random.hpp"
#include "evmarker/scene_renderer.hpp"

namespace evmarker {

/// The simulated sensor and how finely time is cut.
struct SimulatorSettings {
  double duration_s = 1;
  std::uint64_t seed = 1;               ///< of the pixels' thresholds, the noise and the latencies
  double contrast_threshold_on = 0.25;  ///< step of log intensity that makes an ON event
  double contrast_threshold_off = 0.25;
  double threshold_mismatch = 0.03;   ///< standard deviation of the thresholds from pixel to pixel
  double refractory_us = 50;          ///< a pixel is dead for so long after its event
  double pixel_time_constant_us = 0;  ///< of the pixel's first-order low-pass of log intensity; 0 is infinitely fast
  double point_spread_px = 0.6;       ///< sigma of the blur, lens and pixel area together
  double noise_hz_per_px = 1;         ///< events without a cause, of random polarity
  double latency_jitter_us = 0;  ///< mean of the (exponentially distributed) time an event waits to leave its pixel
  double max_step_px = 0.25;     ///< nothing moves farther within a time step
  double max_step_us = 1000;     ///< nor is a step longer
};

/// Simulates an event camera in front of a scene; an `EventSource` from time 0 to the set duration. The same scene,
/// settings and seed give the same events.
class Simulator {
 public:
  using event_type = Event;

  /// @throws std::invalid_argument naming the field of the settings or the scene that makes no sense
  Simulator(const PinholeCamera& camera, Scene scene, const SimulatorSettings& settings = {})
      : settings_(validated(settings)),
        renderer_(camera, std::move(scene), settings.point_spread_px),
        end_us_(settings.duration_s * 1e6),
        step_us_(settings.max_step_us),
        frame_(renderer_.at(0)),
        noise_(settings.seed, kNoiseStream) {
    const auto [width, height] = camera.sensor_size();
    wake_.assign(static_cast<std::size_t>(width * height), kNow);
    run_wake_.assign((wake_.size() + kRun - 1) / kRun, kNow);
    pixels_.reserve(wake_.size());
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) pixels_.push_back(make_pixel(x, y));
    next_noise_us_ = noise_interval_us();
  }

  Simulator(const PinholeCamera& camera, std::vector<SimulatedMarker> markers, const SimulatorSettings& settings = {})
      : Simulator(camera, Scene{std::move(markers), {}, {}}, settings) {}

  SensorSize sensor_size() const noexcept { return renderer_.camera().sensor_size(); }

  /// The next events, in order of time; empty at the end.
  std::span<const Event> next_batch() {
    batch_.clear();
    while (batch_.empty() && now_us_ < end_us_)
      for (int step = 0; step < kStepsPerBatch && now_us_ < end_us_; ++step) advance();
    return batch_;
  }

  /// True pose of the marker with that place in the scene.
  Eigen::Isometry3d T_camera_marker(std::size_t marker, Timestamp t) const {
    return scene().markers.at(marker).T_camera_marker(static_cast<double>(t) * 1e-6);
  }

  const Scene& scene() const noexcept { return renderer_.scene(); }
  const std::vector<SimulatedMarker>& markers() const noexcept { return scene().markers; }
  const PinholeCamera& camera() const noexcept { return renderer_.camera(); }
  const SimulatorSettings& settings() const noexcept { return settings_; }

  /// How far the simulation has come [us].
  Timestamp now() const noexcept { return static_cast<Timestamp>(now_us_); }
  /// Fastest motion in the image so far [px/s].
  double peak_speed_px_per_s() const noexcept { return peak_speed_px_per_s_; }

  /// Linear intensity of the image at any time, row by row, as a frame camera with an endlessly short exposure sees it.
  std::vector<float> render(Timestamp t) const { return renderer_.render(static_cast<double>(t) * 1e-6); }

 private:
  static constexpr std::size_t kRun = 64;
  static constexpr int kStepsPerBatch = 16;
  static constexpr double kShortestStepUs = 1;
  static constexpr float kNow = -1, kNoisy = -2;  // wake distances that are always reached
  static constexpr std::uint64_t kThresholdStream = 1, kNoiseStream = 2, kLatencyStream = 3;

  struct TimedEvent {
    double t;
    Event event;
  };
  struct NoiseEvent {
    std::size_t pixel;
    double t;
    bool on;
  };

  static const SimulatorSettings& validated(const SimulatorSettings& s) {
    const auto require = [](double value, const char* field, bool may_be_zero) {
      if (!std::isfinite(value) || value < 0 || (value == 0 && !may_be_zero))
        throw std::invalid_argument(std::string("simulator: ") + field + " is " + std::to_string(value));
    };
    require(s.duration_s, "duration_s", true);
    require(s.contrast_threshold_on, "contrast_threshold_on", false);
    require(s.contrast_threshold_off, "contrast_threshold_off", false);
    require(s.threshold_mismatch, "threshold_mismatch", true);
    require(s.refractory_us, "refractory_us", true);
    require(s.pixel_time_constant_us, "pixel_time_constant_us", true);
    require(s.point_spread_px, "point_spread_px", false);
    require(s.noise_hz_per_px, "noise_hz_per_px", true);
    require(s.latency_jitter_us, "latency_jitter_us", true);
    require(s.max_step_px, "max_step_px", false);
    require(s.max_step_us, "max_step_us", false);
    return s;
  }

  EventPixel make_pixel(int x, int y) const {
    Random random(settings_.seed, kThresholdStream, pixels_.size());
    const auto threshold = [&](double nominal) {  // a real comparator has no threshold near 0 or below
      return std::max(nominal / 4, nominal + settings_.threshold_mismatch * random.gaussian());
    };
    const double on = threshold(settings_.contrast_threshold_on);
    const double off = threshold(settings_.contrast_threshold_off);
    return {std::log(renderer_.sample(frame_, x, y).intensity), on, off};
  }

  double noise_interval_us() {
    const double rate_hz = settings_.noise_hz_per_px * static_cast<double>(wake_.size());
    return noise_.exponential() / rate_hz * 1e6;  // infinite without noise
  }

  // One time step: choose its length, draw its noise, advance the pixels that can have changed, let events out.
  void advance() {
    const auto next = choose_step();
    const double t0 = now_us_, t1 = step_us_ < end_us_ - t0 ? t0 + step_us_ : end_us_;
    draw_noise(t1);
    for (std::size_t run = 0; run < run_wake_.size(); ++run)
      if (run_wake_[run] < moved_px_) advance_run(run, next, t0, t1);
    frame_ = next;
    now_us_ = t1;
    release_events();
  }

  SceneRenderer::Frame choose_step() {
    for (double step = std::min({1.5 * step_us_, settings_.max_step_us, end_us_ - now_us_});;) {
      auto next = renderer_.at((now_us_ + step) * 1e-6);
      const double motion = renderer_.motion_px(frame_, next);
      if (motion > settings_.max_step_px && step > kShortestStepUs) {
        step = std::max(kShortestStepUs, step * std::clamp(0.95 * settings_.max_step_px / motion, 0.2, 0.95));
        continue;
      }
      step_us_ = step;
      moved_px_ += static_cast<float>(motion);
      peak_speed_px_per_s_ = std::max(peak_speed_px_per_s_, motion / step * 1e6);
      // Single precision is fine up to some ten thousand pixels: then count from 0 again.
      if (renderer_.appearance_changes(frame_, next) || moved_px_ > 1e4f) wake_all();
      return next;
    }
  }

  void wake_all() {
    moved_px_ = 0;
    std::fill(wake_.begin(), wake_.end(), kNow);
    std::fill(run_wake_.begin(), run_wake_.end(), kNow);
  }

  void draw_noise(double until_us) {
    step_noise_.clear();
    for (; next_noise_us_ < until_us; next_noise_us_ += noise_interval_us()) {
      const auto pixel = static_cast<std::size_t>(noise_.uniform() * static_cast<double>(wake_.size()));
      step_noise_.push_back({pixel, next_noise_us_, noise_.bits() >> 63 != 0});
      wake_[pixel] = kNoisy;
      run_wake_[pixel / kRun] = kNoisy;
    }
  }

  void advance_run(std::size_t run, const SceneRenderer::Frame& next, double t0, double t1) {
    float run_wake = std::numeric_limits<float>::infinity();
    for (std::size_t i = run * kRun; i < std::min((run + 1) * kRun, wake_.size()); ++i) {
      if (wake_[i] < moved_px_) wake_[i] = advance_pixel(i, next, t0, t1);
      run_wake = std::min(run_wake, wake_[i]);
    }
    run_wake_[run] = run_wake;
  }

  // Returns the distance moved at which the pixel must be looked at again.
  float advance_pixel(std::size_t index, const SceneRenderer::Frame& next, double t0, double t1) {
    const int width = sensor_size().width;
    const int x = static_cast<int>(index) % width, y = static_cast<int>(index) / width;
    EventPixel& pixel = pixels_[index];
    const EventPixelDynamics dynamics{settings_.pixel_time_constant_us, settings_.refractory_us};
    const auto emit = [&](double t, bool on) {
      const double latency =
          settings_.latency_jitter_us > 0
              ? settings_.latency_jitter_us *
                    Random(settings_.seed ^ kLatencyStream << 32, index, std::bit_cast<std::uint64_t>(t)).exponential()
              : 0;
      waiting_.push_back({t + latency,
                          {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::int16_t>(on),
                           static_cast<Timestamp>(t + latency)}});
      return t + latency;
    };
    const auto sample = renderer_.sample(next, x, y);
    const double end = std::log(sample.intensity), start = pixel.log_intensity();
    double t = t0;
    if (wake_[index] == kNoisy)
      for (const auto& noise : step_noise_) {
        if (noise.pixel != index || noise.t <= t) continue;
        pixel.advance(t, noise.t, start + (end - start) * (noise.t - t0) / (t1 - t0), dynamics, emit);
        pixel.fire(noise.t, noise.on, dynamics, emit);
        t = noise.t;
      }
    if (t < t1) pixel.advance(t, t1, end, dynamics, emit);
    return sample.clearance_px > 0 && pixel.settle() ? moved_px_ + static_cast<float>(sample.clearance_px) : kNow;
  }

  // Events that leave their pixels by now; later steps make none that is earlier.
  void release_events() {
    const auto order = [](const TimedEvent& a, const TimedEvent& b) {
      if (a.t != b.t) return a.t < b.t;
      return a.event.y != b.event.y ? a.event.y < b.event.y : a.event.x < b.event.x;
    };
    std::sort(waiting_.begin(), waiting_.end(), order);
    const auto out = std::find_if(waiting_.begin(), waiting_.end(), [&](const auto& w) { return w.t >= now_us_; });
    for (auto it = waiting_.begin(); it != out; ++it) batch_.push_back(it->event);
    waiting_.erase(waiting_.begin(), out);
  }

  SimulatorSettings settings_;
  SceneRenderer renderer_;
  double now_us_ = 0;
  double end_us_;
  double step_us_;
  SceneRenderer::Frame frame_;  // at now
  float moved_px_ = 0;          // sum of the steps' motions
  double peak_speed_px_per_s_ = 0;

  std::vector<EventPixel> pixels_;
  std::vector<float> wake_;      // per pixel: asleep until so much has moved
  std::vector<float> run_wake_;  // the least of each run of pixels

  Random noise_;
  double next_noise_us_ = 0;
  std::vector<NoiseEvent> step_noise_;

  std::vector<TimedEvent> waiting_;
  std::vector<Event> batch_;
};

}  // namespace evmarker
