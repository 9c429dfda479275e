#pragma once
// Which share of the events comes from moving edges, as their polarities fit the estimated motion.
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "evmarker/simd/lanes.hpp"
#include "evmarker/update/matched_background.hpp"

namespace evmarker {

/// Measures which share of the events come from moving edges, by their polarity: an edge makes ON events while it moves
/// toward the dark and OFF events while it moves away from it, but noise does not know of the motion, and a lamp that
/// flickers brightens all edges alike. So the share is by how much more often events are ON where they should be than
/// where they should not, known as Youden's J or informedness. It says nothing of the time
/// after these events.
class PolarityAgreement {
 public:
  /// Adds an event.
  /// @param toward_dark_px_per_s speed of its edge, see MeasurementModel
  /// @param polarity 1 for ON, -1 for OFF, 0 where it or the dark side of the edge is not known
  void add(double toward_dark_px_per_s, double polarity) noexcept { add(0, toward_dark_px_per_s, polarity); }
  /// Batch version.
  /// @param is_event 1 where there is an event, else 0
  [[gnu::always_inline]] void add(const simd::Lanes& toward_dark_px_per_s, const simd::Lanes& polarity,
                                  const simd::Lanes& is_event) noexcept {
    for (std::size_t i = 0; i < simd::kLanes; ++i) add(i, toward_dark_px_per_s[i], is_event[i] * polarity[i]);
  }

  /// Forgets all events.
  void clear() noexcept { counts_ = {}; }

  /// Share of the events since `clear` that come from moving edges.
  MovingShare moving_share() const noexcept {
    const double all = simd::sum(counts_.all), on = simd::sum(counts_.on);
    const double all_toward = simd::sum(counts_.all_toward), on_toward = simd::sum(counts_.on_toward);
    const Share toward(on_toward, all_toward), from(on - on_toward, all - all_toward);
    const double share = toward.mean - from.mean, deviation = std::sqrt(toward.variance + from.variance);
    return {std::clamp(share, 0.0, 1.0), std::clamp(share - kSurely * deviation, 0.0, 1.0)};
  }

 private:
  // Share of ON among the events, with one event more of each polarity (Laplace's rule).
  struct Share {
    Share(double on, double all) noexcept : mean((on + 1) / (all + 2)), variance(mean * (1 - mean) / (all + 2)) {}
    double mean, variance;
  };
  // Of the events of known polarity, lane by lane: all and ON, and those of edges that move toward the dark.
  struct Counts {
    alignas(64) simd::Lanes all{}, on{}, all_toward{}, on_toward{};
  };
  static constexpr double kSurely = 2.5;  // standard deviations

  [[gnu::always_inline]] void add(std::size_t lane, double toward_dark_px_per_s, double polarity) noexcept {
    const double known = std::abs(polarity), on = 0.5 * (known + polarity);
    const double toward = 0.5 + std::copysign(0.5, toward_dark_px_per_s);  // 1 or 0, without a branch
    counts_.all[lane] += known;
    counts_.on[lane] += on;
    counts_.all_toward[lane] += toward * known;
    counts_.on_toward[lane] += toward * on;
  }

  Counts counts_;
};

}  // namespace evmarker
