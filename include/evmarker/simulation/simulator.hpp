#pragma once
// An event camera that looks at markers on known trajectories: events with their truth.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/simulation/event_pixel.hpp"
#include "evmarker/simulation/event_queue.hpp"
#include "evmarker/simulation/leak_schedule.hpp"
#include "evmarker/simulation/pixel_noise.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene_renderer.hpp"
#include "evmarker/simulation/sensor_pixel.hpp"
#include "evmarker/simulation/simulator_settings.hpp"
#include "evmarker/simulation/tile_grid.hpp"

namespace evmarker {

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
        segment_us_(settings.max_step_us),
        leaks_(grid(), settings.leak_hz_per_px > 0),
        noise_(grid(), settings.noise_hz_per_px, Random(settings.seed, kNoiseStream)) {
    const auto start = renderer_.at(0);
    pixels_.reserve(grid().indices());
    for (std::size_t i = 0; i < grid().indices(); ++i) {
      const bool there = grid().on_sensor(i);
      const double light = there ? renderer_.sample(start, grid().x(i), grid().y(i)).intensity : 1;
      pixels_.push_back(make_pixel(settings_, pixel_key(i), std::log(light)));
      wake_.push_back(there ? kNow : kNever);
    }
    drifts_since_us_.assign(grid().indices(), kDriftsNot);
    tiles_.resize(grid().tiles());
  }

  Simulator(const PinholeCamera& camera, std::vector<SimulatedMarker> markers, const SimulatorSettings& settings = {})
      : Simulator(camera, Scene{std::move(markers), {}, {}}, settings) {}

  SensorSize sensor_size() const noexcept { return renderer_.camera().sensor_size(); }

  /// The next events, in order of time; empty at the end.
  std::span<const Event> next_batch() {
    batch_.clear();
    while (batch_.empty() && now_us_ < end_us_) advance();
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
  static constexpr std::size_t kSegmentsPerBatch = 16;
  static constexpr int kTicksPerStep = 8;      // so finely a step's length can be chosen
  static constexpr int kStepsPerSegment = 64;  // at most, of the fastest thing
  static constexpr double kShortestSegmentUs = 10;
  static constexpr float kNow = -1, kNever = std::numeric_limits<float>::infinity();  // wake distances
  static constexpr double kDriftsNot = std::numeric_limits<double>::infinity();
  static constexpr std::uint64_t kNoiseStream = 2, kLatencyStream = 3;  // 1 and 4: of make_pixel

  // A stretch of time in which things move in good order, cut into ticks. Frames are rendered on demand.
  struct Segment {
    double begin_us, end_us;
    SceneRenderer::Motion motion;
    std::size_t ticks;
    std::vector<std::optional<SceneRenderer::Frame>> frames;  // at the ends of the ticks

    double us(std::size_t tick) const {
      return tick == ticks ? end_us
                           : begin_us + (end_us - begin_us) * static_cast<double>(tick) / static_cast<double>(ticks);
    }
  };

  struct Tile {
    double moved_px = 0;     // sum of its steps' motions
    float wake_px = kNow;    // the least of its pixels: nothing to do before that motion
    std::uint64_t cast = 0;  // of what was there last
    bool drifts = false;     // some of its pixels see a moving background
  };

  // What one tile has come to within a batch.
  struct Progress {
    std::size_t tile;
    double t;                           // up to where its pixels have been advanced
    double moved_px;                    // since then
    std::span<const NoiseEvent> noise;  // not yet dealt with
  };

  const TileGrid& grid() const noexcept { return renderer_.grid(); }
  // What a pixel draws shall not depend on how the pixels are stored.
  std::uint64_t pixel_key(std::size_t index) const {
    return static_cast<std::uint64_t>(grid().y(index) * sensor_size().width + grid().x(index));
  }

  // One batch: predict the motion, draw the noise, advance every tile in steps of its own, release the events.
  void advance() {
    segments_.clear();
    double t = now_us_, drift_px = 0;  // the background takes one step a batch
    while (segments_.size() < kSegmentsPerBatch && t < end_us_ && drift_px < 0.9 * settings_.max_step_px) {
      segments_.push_back(next_segment(t, settings_.max_step_px - drift_px));
      t = segments_.back().end_us;
      drift_px += segments_.back().motion.background;
    }
    const auto& noise = noise_.draw(t);
    auto begin = noise.begin();
    for (std::size_t tile = 0; tile < tiles_.size(); ++tile) {
      const auto end = std::find_if(begin, noise.end(),
                                    [&](const NoiseEvent& event) { return TileGrid::tile(event.pixel) != tile; });
      advance_tile(tile, {begin, end});
      begin = end;
    }
    now_us_ = t;
    waiting_.release(now_us_, batch_);
  }

  Segment next_segment(double begin_us, double drift_limit_px) {
    auto from = renderer_.at(begin_us * 1e-6);
    const double rest = end_us_ - begin_us, limit_px = kStepsPerSegment * settings_.max_step_px;
    for (segment_us_ = std::min(1.5 * segment_us_, settings_.max_step_us);;) {
      const double end_us = segment_us_ < rest ? begin_us + segment_us_ : end_us_, length = end_us - begin_us;
      auto to = renderer_.at(end_us * 1e-6);
      auto motion = renderer_.motion(from, to);
      const double excess = std::max(motion.largest / limit_px, motion.background / drift_limit_px);
      if (excess > 1 && length > kShortestSegmentUs) {
        segment_us_ = std::max(kShortestSegmentUs, length * std::clamp(0.95 / excess, 0.2, 0.95));
        continue;
      }
      peak_speed_px_per_s_ = std::max(peak_speed_px_per_s_, motion.largest / length * 1e6);
      const double steps = std::min<double>(std::ceil(motion.largest / settings_.max_step_px), kStepsPerSegment);
      const auto ticks = kTicksPerStep * static_cast<std::size_t>(std::max(1.0, steps));
      Segment segment{begin_us, end_us, std::move(motion), ticks, {}};
      segment.frames.resize(ticks + 1);
      segment.frames.front() = std::move(from);
      segment.frames.back() = std::move(to);
      return segment;
    }
  }

  // Takes a tile through the segments: a step ends when something in the tile has moved by the longest step, where
  // something comes or goes, and at the end.
  void advance_tile(std::size_t index, std::span<const NoiseEvent> noise) {
    Tile& tile = tiles_[index];
    Progress progress{index, segments_.front().begin_us, 0, noise};

    for (Segment& segment : segments_) {
      renderer_.observe(index, *segment.frames.front(), *segment.frames.back(), segment.motion, next_activity_);
      const bool recast = next_activity_.cast != tile.cast;
      if (recast) {
        if (progress.t < segment.begin_us) step_to(segment, 0, progress);
        wake(index);
        tile.cast = next_activity_.cast;
      }
      std::swap(activity_, next_activity_);
      const double motion = activity_.motion_px, moved = tile.moved_px + progress.moved_px;
      const bool noisy =
          (!progress.noise.empty() && progress.noise.front().t < segment.end_us) || leaks_.due(index, segment.end_us);
      if (!noisy && static_cast<double>(tile.wake_px) >= moved + motion) {
        tile.moved_px = moved + motion;
        progress.t = segment.end_us;
        progress.moved_px = 0;
        continue;
      }
      const double tick_px = motion / static_cast<double>(segment.ticks);
      for (std::size_t tick = 0;;) {
        const auto left = static_cast<double>(segment.ticks - tick);
        const double ticks = std::max(1.0, std::floor((settings_.max_step_px - progress.moved_px) / tick_px));
        if (!(ticks < left)) {
          progress.moved_px += left * tick_px;
          break;
        }
        tick += static_cast<std::size_t>(ticks);
        progress.moved_px += ticks * tick_px;
        step_to(segment, tick, progress);
      }
      if (recast) step_to(segment, segment.ticks, progress);
    }
    Segment& last = segments_.back();
    const bool awake = static_cast<double>(tile.wake_px) < tile.moved_px + progress.moved_px;
    if (awake || leaks_.due(index, last.end_us) || !progress.noise.empty() || tile.drifts)
      step_to(last, last.ticks, progress);
    if (tile.moved_px > 1e4) wake(index);  // single precision is fine up to there
  }

  void wake(std::size_t tile) {
    const std::size_t first = tile * TileGrid::kPixelsPerTile;
    for (std::size_t i = first; i < first + TileGrid::kPixelsPerTile; ++i)
      if (grid().on_sensor(i)) wake_[i] = kNow;
    tiles_[tile].moved_px = 0;
    tiles_[tile].wake_px = kNow;
  }

  // One step of those pixels of a tile that can have changed.
  void step_to(Segment& segment, std::size_t tick, Progress& progress) {
    const double t = segment.us(tick);
    auto& frame = segment.frames[tick];
    if (!frame) frame = renderer_.at(t * 1e-6);
    std::size_t noise_count = 0;
    for (; noise_count < progress.noise.size() && progress.noise[noise_count].t < t; ++noise_count)
      wake_[progress.noise[noise_count].pixel] = kNow;
    leaks_.for_each_due(progress.tile, t, [&](std::size_t i) { wake_[i] = kNow; });

    Tile& tile = tiles_[progress.tile];
    tile.moved_px += progress.moved_px;
    const auto moved = static_cast<float>(tile.moved_px);
    const std::size_t first = progress.tile * TileGrid::kPixelsPerTile;
    tile.wake_px = kNever;
    tile.drifts = false;
    const bool drift = t == segments_.back().end_us;
    for (std::size_t i = first; i < first + TileGrid::kPixelsPerTile; ++i) {
      if (wake_[i] < moved || (drift && drifts_since_us_[i] < t))
        wake_[i] =
            advance_pixel(i, *frame, std::min(progress.t, drifts_since_us_[i]), t, progress.noise.first(noise_count));
      tile.wake_px = std::min(tile.wake_px, wake_[i]);
      tile.drifts = tile.drifts || drifts_since_us_[i] != kDriftsNot;
    }
    progress = {progress.tile, t, 0, progress.noise.subspan(noise_count)};
    leaks_.update(progress.tile);
  }

  // Returns the distance moved at which the pixel is due again.
  float advance_pixel(std::size_t index, const SceneRenderer::Frame& next, double t0, double t1,
                      std::span<const NoiseEvent> step_noise) {
    EventPixel& pixel = pixels_[index];
    const auto sample = renderer_.sample(next, index, activity_);
    const double end = std::log(static_cast<float>(sample.intensity)), start = pixel.log_intensity();
    const auto emit = [&](double t, bool on) { return send(index, t, on); };
    double t = t0;
    for (const auto& noise : step_noise) {
      if (noise.pixel != index || noise.t <= t) continue;
      follow_light(pixel, settings_, t, noise.t, start + (end - start) * (noise.t - t0) / (t1 - t0), emit);
      pixel.fire(noise.t, noise.on, {0, settings_.refractory_us}, emit);
      t = noise.t;
    }
    if (t < t1) follow_light(pixel, settings_, t, t1, end, emit);
    drifts_since_us_[index] = sample.drifts ? t1 : kDriftsNot;
    const double moved = tiles_[TileGrid::tile(index)].moved_px;
    leaks_.set(index, pixel.leak_event_us());
    return pixel.settle() ? static_cast<float>(moved + sample.clearance_px) : kNow;
  }

  // Returns the time at which the event leaves its pixel.
  double send(std::size_t index, double t, bool on) {
    if (settings_.latency_jitter_us > 0) {
      Random random(settings_.seed ^ kLatencyStream << 32, pixel_key(index), std::bit_cast<std::uint64_t>(t));
      t += settings_.latency_jitter_us * random.exponential();
    }
    waiting_.push(t, {static_cast<std::uint16_t>(grid().x(index)), static_cast<std::uint16_t>(grid().y(index)),
                      static_cast<std::int16_t>(on), static_cast<Timestamp>(t)});
    return t;
  }

  SimulatorSettings settings_;
  SceneRenderer renderer_;
  double now_us_ = 0;
  double end_us_, segment_us_;
  double peak_speed_px_per_s_ = 0;
  std::vector<Segment> segments_;
  std::vector<Tile> tiles_;
  std::vector<EventPixel> pixels_;       // in the order of the grid
  std::vector<float> wake_;              // per pixel: asleep before that motion in its tile
  std::vector<double> drifts_since_us_;  // per pixel that sees a moving background: up to where it has been advanced
  SceneRenderer::Activity activity_, next_activity_;
  LeakSchedule leaks_;
  PixelNoise noise_;
  EventQueue waiting_;
  std::vector<Event> batch_;
};

}  // namespace evmarker
