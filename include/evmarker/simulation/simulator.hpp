#pragma once
// A simulated event camera in front of moving markers: events with ground truth.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/simulation/event_pixel.hpp"
#include "evmarker/simulation/event_queue.hpp"
#include "evmarker/simulation/leak_schedule.hpp"
#include "evmarker/simulation/motion_segment.hpp"
#include "evmarker/simulation/pixel_noise.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene_renderer.hpp"
#include "evmarker/simulation/sensor_pixel.hpp"
#include "evmarker/simulation/simulator_settings.hpp"
#include "evmarker/simulation/tile_grid.hpp"

namespace evmarker {

/// Simulates an event camera in front of a scene, from time 0 to the set duration; an `EventSource`. The same camera,
/// scene and settings give the same events.
class Simulator {
 public:
  using event_type = Event;

  /// @throws std::invalid_argument naming the field of the settings or the scene that makes no sense
  Simulator(const PinholeCamera& camera, Scene scene, const SimulatorSettings& settings = {})
      : settings_(validated(settings)),
        renderer_(camera, std::move(scene), settings.point_spread_px),
        end_us_(settings.duration_s * 1e6),
        segmenter_(settings),
        leaks_(grid(), settings.leak_hz_per_px > 0),
        noise_(grid(), settings.noise_hz_per_px, Random(settings.seed, kNoiseStream)) {
    const auto start = renderer_.at(0);
    pixels_.reserve(grid().indices());
    for (std::size_t i = 0; i < grid().indices(); ++i) {
      const bool there = grid().on_sensor(i);
      const double light = there ? renderer_.sample(start, grid().x(i), grid().y(i)).intensity : 1;
      pixels_.push_back(make_pixel(settings_, pixel_key(i), std::log(light)));
      wake_px_.push_back(there ? kNow : kNever);
    }
    drift_advanced_us_.assign(grid().indices(), kNoDrift);
    tiles_.resize(grid().tiles());
  }

  Simulator(const PinholeCamera& camera, std::vector<SimulatedMarker> markers, const SimulatorSettings& settings = {})
      : Simulator(camera, Scene{std::move(markers), {}, {}}, settings) {}

  SensorSize sensor_size() const noexcept { return renderer_.camera().sensor_size(); }

  /// The next events, in order of time; empty at the end. Valid until the next call.
  std::span<const Event> next_batch() {
    batch_.clear();
    while (batch_.empty() && now_us_ < end_us_) advance();
    return batch_;
  }

  /// True pose of a marker at a time.
  /// @param marker index in the scene
  /// @throws std::out_of_range for an index that the scene does not have
  Eigen::Isometry3d T_camera_marker(std::size_t marker, Timestamp t) const {
    return scene().markers.at(marker).T_camera_marker(static_cast<double>(t) * 1e-6);
  }

  const Scene& scene() const noexcept { return renderer_.scene(); }
  const std::vector<SimulatedMarker>& markers() const noexcept { return scene().markers; }
  const PinholeCamera& camera() const noexcept { return renderer_.camera(); }
  const SimulatorSettings& settings() const noexcept { return settings_; }

  /// Time up to which the simulation has come [us].
  Timestamp now() const noexcept { return static_cast<Timestamp>(now_us_); }
  /// Fastest motion in the image so far [px/s].
  double peak_speed_px_per_s() const noexcept { return segmenter_.peak_speed_px_per_s(); }

  /// Linear intensity of the image at any time, row by row, as seen by a frame camera with an infinitely short
  /// exposure.
  std::vector<float> render(Timestamp t) const { return renderer_.render(static_cast<double>(t) * 1e-6); }

 private:
  static constexpr std::size_t kSegmentsPerBatch = 16;
  static constexpr float kNow = -1, kNever = std::numeric_limits<float>::infinity();  // values of wake_px_
  static constexpr double kNoDrift = std::numeric_limits<double>::infinity();
  static constexpr std::uint64_t kNoiseStream = 2, kLatencyStream = 3;  // make_pixel uses 1 and 4

  struct Tile {
    double moved_px = 0;         // sum of the motions of its steps
    float wake_px = kNow;        // the least wake_px_ of its pixels: no pixel is due before moved_px exceeds it
    std::uint64_t contents = 0;  // SceneRenderer::Activity::contents of the last segment
    bool drifts = false;         // true if some of its pixels see a moving background
  };

  // The progress of one tile within a batch.
  struct Progress {
    std::size_t tile;
    double t;                           // time of its last step, or end of the segments skipped since
    double moved_px;                    // motion since then
    std::span<const NoiseEvent> noise;  // the tile's noise events of this batch that have not fired yet
  };

  const TileGrid& grid() const noexcept { return renderer_.grid(); }
  // A pixel's key for random numbers, which does not depend on the tiles.
  std::uint64_t pixel_key(std::size_t index) const {
    return static_cast<std::uint64_t>(grid().y(index) * sensor_size().width + grid().x(index));
  }

  // Simulates a batch: computes the motion, draws the noise, advances every tile in steps of its own and releases the
  // events.
  void advance() {
    segments_.clear();
    double t = now_us_, drift_px = 0;  // the background moves by at most one step per batch
    while (segments_.size() < kSegmentsPerBatch && t < end_us_ && drift_px < 0.9 * settings_.max_step_px) {
      segments_.push_back(segmenter_.next(renderer_, t, settings_.max_step_px - drift_px));
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
    queue_.release(now_us_, batch_);
  }

  // Advances a tile through the segments of a batch. A step ends when something in the tile has moved by max_step_px,
  // at both ends of a segment whose contents differ from those of the segment before, and at the end of the batch.
  // Steps in which no pixel of the tile is due are left out.
  void advance_tile(std::size_t index, std::span<const NoiseEvent> noise) {
    Tile& tile = tiles_[index];
    Progress progress{index, segments_.front().begin_us, 0, noise};

    for (MotionSegment& segment : segments_) {
      renderer_.compute_activity(index, *segment.frames.front(), *segment.frames.back(), segment.motion,
                                 next_activity_);
      const bool contents_change = next_activity_.contents != tile.contents;
      if (contents_change) {
        // With the activity of the segment before. At the first segment, progress.t is its begin.
        if (progress.t < segment.begin_us) advance_due_pixels(segment, 0, progress);
        wake_tile(index);
        tile.contents = next_activity_.contents;
      }
      std::swap(activity_, next_activity_);
      const double motion = activity_.motion_px, moved = tile.moved_px + progress.moved_px;
      const bool fires_by_itself =
          (!progress.noise.empty() && progress.noise.front().t < segment.end_us) || leaks_.due(index, segment.end_us);
      if (!fires_by_itself && static_cast<double>(tile.wake_px) >= moved + motion) {
        tile.moved_px = moved + motion;
        progress.t = segment.end_us;
        progress.moved_px = 0;
        continue;
      }
      const double tick_px = motion / static_cast<double>(segment.ticks);  // 0 without motion: then no step ends here
      for (std::size_t tick = 0;;) {
        const auto left = static_cast<double>(segment.ticks - tick);
        const double ticks = std::max(1.0, std::floor((settings_.max_step_px - progress.moved_px) / tick_px));
        if (!(ticks < left)) {
          progress.moved_px += left * tick_px;
          break;
        }
        tick += static_cast<std::size_t>(ticks);
        progress.moved_px += ticks * tick_px;
        advance_due_pixels(segment, tick, progress);
      }
      if (contents_change) advance_due_pixels(segment, segment.ticks, progress);
    }
    MotionSegment& last = segments_.back();
    const bool awake = static_cast<double>(tile.wake_px) < tile.moved_px + progress.moved_px;
    if (awake || leaks_.due(index, last.end_us) || !progress.noise.empty() || tile.drifts)
      advance_due_pixels(last, last.ticks, progress);
    if (tile.moved_px > 1e4) wake_tile(index);  // restarts the sum before its rounding in single precision matters
  }

  // Makes all pixels of a tile due now.
  void wake_tile(std::size_t tile) {
    const std::size_t first = tile * TileGrid::kPixelsPerTile;
    for (std::size_t i = first; i < first + TileGrid::kPixelsPerTile; ++i)
      if (grid().on_sensor(i)) wake_px_[i] = kNow;
    tiles_[tile].moved_px = 0;
    tiles_[tile].wake_px = kNow;
  }

  // Advances the due pixels of a tile to the start of a tick. At the end of the batch, those that see a moving
  // background are due too.
  void advance_due_pixels(MotionSegment& segment, std::size_t tick, Progress& progress) {
    const double t = segment.us(tick);
    auto& frame = segment.frames[tick];
    if (!frame) frame = renderer_.at(t * 1e-6);
    std::size_t noise_count = 0;
    for (; noise_count < progress.noise.size() && progress.noise[noise_count].t < t; ++noise_count)
      wake_px_[progress.noise[noise_count].pixel] = kNow;
    leaks_.for_each_due(progress.tile, t, [&](std::size_t i) { wake_px_[i] = kNow; });

    Tile& tile = tiles_[progress.tile];
    tile.moved_px += progress.moved_px;
    const auto moved = static_cast<float>(tile.moved_px);
    const std::size_t first = progress.tile * TileGrid::kPixelsPerTile;
    tile.wake_px = kNever;
    tile.drifts = false;
    const bool at_batch_end = t == segments_.back().end_us;
    for (std::size_t i = first; i < first + TileGrid::kPixelsPerTile; ++i) {
      if (wake_px_[i] < moved || (at_batch_end && drift_advanced_us_[i] < t))
        wake_px_[i] =
            advance_pixel(i, *frame, std::min(progress.t, drift_advanced_us_[i]), t, progress.noise.first(noise_count));
      tile.wake_px = std::min(tile.wake_px, wake_px_[i]);
      tile.drifts = tile.drifts || drift_advanced_us_[i] != kNoDrift;
    }
    progress = {progress.tile, t, 0, progress.noise.subspan(noise_count)};
    leaks_.update(progress.tile);
  }

  // Advances a pixel from t0 to t1, the time of the frame `next`, with its noise. Returns its new wake_px_.
  float advance_pixel(std::size_t index, const SceneRenderer::Frame& next, double t0, double t1,
                      std::span<const NoiseEvent> step_noise) {
    EventPixel& pixel = pixels_[index];
    const auto sample = renderer_.sample(next, index, activity_);
    const double end = std::log(static_cast<float>(sample.intensity)), start = pixel.log_intensity();
    const auto emit = [&](double t, bool on) { return queue_event(index, t, on); };
    double t = t0;
    for (const auto& noise : step_noise) {
      if (noise.pixel != index || noise.t <= t) continue;
      follow_light(pixel, settings_, t, noise.t, start + (end - start) * (noise.t - t0) / (t1 - t0), emit);
      pixel.fire(noise.t, noise.on, {0, settings_.refractory_us}, emit);
      t = noise.t;
    }
    if (t < t1) follow_light(pixel, settings_, t, t1, end, emit);
    drift_advanced_us_[index] = sample.drifts ? t1 : kNoDrift;
    const double moved = tiles_[TileGrid::tile(index)].moved_px;
    leaks_.set(index, pixel.leak_event_us());
    return pixel.settle() ? static_cast<float>(moved + sample.clearance_px) : kNow;
  }

  // Queues an event with a random latency. Returns the time at which it leaves its pixel.
  double queue_event(std::size_t index, double t, bool on) {
    if (settings_.latency_jitter_us > 0) {
      Random random(settings_.seed ^ kLatencyStream << 32, pixel_key(index), std::bit_cast<std::uint64_t>(t));
      t += settings_.latency_jitter_us * random.exponential();
    }
    queue_.push(t, {static_cast<std::uint16_t>(grid().x(index)), static_cast<std::uint16_t>(grid().y(index)),
                    static_cast<std::int16_t>(on), static_cast<Timestamp>(t)});
    return t;
  }

  SimulatorSettings settings_;
  SceneRenderer renderer_;
  double now_us_ = 0;
  double end_us_;
  MotionSegmenter segmenter_;
  std::vector<MotionSegment> segments_;
  std::vector<Tile> tiles_;
  std::vector<EventPixel> pixels_;         // in the order of the grid
  std::vector<float> wake_px_;             // per pixel: due when moved_px of its tile exceeds it
  std::vector<double> drift_advanced_us_;  // per pixel that sees a moving background: time of its last step
  SceneRenderer::Activity activity_, next_activity_;
  LeakSchedule leaks_;
  PixelNoise noise_;
  EventQueue queue_;
  std::vector<Event> batch_;
};

}  // namespace evmarker
