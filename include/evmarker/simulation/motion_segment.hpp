#pragma once
// Pieces of time in which all motions of a scene are nearly uniform.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/simulation/scene_renderer.hpp"
#include "evmarker/simulation/simulator_settings.hpp"

namespace evmarker {

/// A piece of time, divided into ticks. Its inner frames are computed on demand.
struct MotionSegment {
  double begin_us, end_us;
  SceneRenderer::Motion motion;  ///< from its begin to its end
  std::size_t ticks;
  std::vector<std::optional<SceneRenderer::Frame>> frames;  ///< at the ends of the ticks

  /// Time of the start of a tick; of the end of the segment for `ticks`.
  double us(std::size_t tick) const {
    return tick == ticks ? end_us
                         : begin_us + (end_us - begin_us) * static_cast<double>(tick) / static_cast<double>(ticks);
  }
};

/// Divides a simulation into segments, one after the other. Each begins with a guess by the length of the one before.
class MotionSegmenter {
 public:
  explicit MotionSegmenter(const SimulatorSettings& settings)
      : max_us_(settings.max_step_us),
        max_step_px_(settings.max_step_px),
        end_us_(settings.duration_s * 1e6),
        length_us_(settings.max_step_us) {}

  /// The segment from a time on, as long as allowed by max_step_us, by kStepsPerSegment steps of the fastest thing, and
  /// by a motion of the background of `drift_limit_px`, but at least of kShortestUs (up to the end of the simulation).
  MotionSegment next(const SceneRenderer& renderer, double begin_us, double drift_limit_px) {
    auto from = renderer.at(begin_us * 1e-6);
    const double rest = end_us_ - begin_us, limit_px = kStepsPerSegment * max_step_px_;
    for (length_us_ = std::min(1.5 * length_us_, max_us_);;) {
      const double end_us = length_us_ < rest ? begin_us + length_us_ : end_us_, length = end_us - begin_us;
      auto to = renderer.at(end_us * 1e-6);
      auto motion = renderer.motion(from, to);
      const double excess = std::max(motion.largest / limit_px, motion.background / drift_limit_px);
      if (excess > 1 && length > kShortestUs) {
        length_us_ = std::max(kShortestUs, length * std::clamp(0.95 / excess, 0.2, 0.95));
        continue;
      }
      peak_speed_px_per_s_ = std::max(peak_speed_px_per_s_, motion.largest / length * 1e6);
      const double steps = std::min<double>(std::ceil(motion.largest / max_step_px_), kStepsPerSegment);
      const auto ticks = kTicksPerStep * static_cast<std::size_t>(std::max(1.0, steps));
      MotionSegment segment{begin_us, end_us, std::move(motion), ticks, {}};
      segment.frames.resize(ticks + 1);
      segment.frames.front() = std::move(from);
      segment.frames.back() = std::move(to);
      return segment;
    }
  }

  /// Fastest motion in the image so far [px/s].
  double peak_speed_px_per_s() const noexcept { return peak_speed_px_per_s_; }

 private:
  static constexpr int kTicksPerStep = 8;      // resolution of a step's length
  static constexpr int kStepsPerSegment = 64;  // largest number of steps of the fastest thing
  static constexpr double kShortestUs = 10;

  double max_us_, max_step_px_, end_us_;
  double length_us_;  // of the last segment
  double peak_speed_px_per_s_ = 0;
};

}  // namespace evmarker
