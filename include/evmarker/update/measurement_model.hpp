#pragma once
// What one matched event measures: the row of the Kalman filter, and how much it counts.
#include <array>
#include <cmath>
#include <cstddef>

#include "evmarker/base/vector.hpp"
#include "evmarker/matching/correspondence.hpp"
#include "evmarker/simd/lanes.hpp"
#include "evmarker/update/error_state.hpp"
#include "evmarker/update/kalman_measurements.hpp"

namespace evmarker {

/// Indices of the biases in ErrorState::b.
inline constexpr std::size_t kOffset = 0, kTrail = 1, kOffDelay = 2;

/// The measurement of one event.
struct EventMeasurement {
  MeasurementRow row;           ///< [J; d]
  double weight;                ///< Cauchy's, lowered near an edge's ends, for little contrast, and in noise
  double residual2;             ///< d squared [px^2]
  double lever2;                ///< squared distance of the matched edge point E from the marker's origin T [m^2]
  double gradient2;             ///< |g| squared, see `measure` [px^2/m^2]
  double toward_dark_px_per_s;  ///< speed of the edge along its normal, which points to the dark side if that is known
};

/// Where the events of an edge lie. Edge offset: how far [px] they lie on average toward the dark side of their edge.
/// Pixels fire at equal steps of the logarithm of light, and across a blurred edge most of these lie on the dark side.
/// Ignored, it makes the marker seem smaller and farther away. Trail: how far [px] events lie behind their moving edge,
/// as a pixel fires only after a whole contrast step. As ON events come from edges that move toward the dark, they lie
/// one trail toward the bright side, and OFF events one trail toward the dark side: the polarity alone tells. Ignored,
/// it makes the pose lag behind the marker. The offset is proportional to the logarithm of an edge's contrast, the
/// trail to the inverse of that logarithm; `contrast` below is that logarithm, divided by its mean over all edges, see
/// EdgeContrasts. OFF delay: how much later OFF events come than ON events; negative if they come earlier. Pixels
/// answer more slowly in the dark; and the polarity with the smaller threshold makes more events, each of which delays
/// the next by a dead time. ON events lie ahead of the mean of both polarities by the way that their edge makes in half
/// of that delay, and OFF events as far behind it, both toward the dark side. Ignored, it becomes part of the edge
/// offset, which then changes with the speed.
struct MeasurementModel {
  std::array<double, kBiases> bias{};  ///< edge offset [px], trail [px], OFF delay [ms]
  double robust_px = 1;                ///< scale of the Cauchy weights
  double spread_px2 = 1;               ///< mean squared residual [px^2]
  double response_s = 0;               ///< by which the sensor's events are spread in time, see ResponseTime
  Vec6 twist{};                        ///< of the marker [m/s, rad/s]
  /// Standard deviation of an edge's speed along its normal, by what is not known of `twist`; positive [px/s].
  double speed_deviation_px_per_s = 1e-3;
  double by_chance_px_per_s = 0;  ///< rate of chance matches, as the speed of an edge that makes as many events
  double time_direction = 1;      ///< -1 while events come in reverse

  /// Signed distance of an event from where its edge makes events [px].
  /// @param distance_px Eq. (1), positive along the normal
  /// @param s 1 if it is known on which side the edge is dark, to which the normal points then; else 0
  /// @param p polarity
  /// @param contrast of the edge, see above
  /// @param px_per_s speed of the edge along its normal
  [[gnu::always_inline]] double residual_px(double distance_px, double s, double p, double contrast,
                                            double px_per_s) const noexcept {
    return distance_px - s * contrast * bias[kOffset] + s * p / contrast * bias[kTrail] -
           by_off_delay(p, px_per_s) * bias[kOffDelay];
  }
  /// The same for an event with its edge.
  /// @param lever E - T [m]
  double residual_px(const Correspondence& c, Vec3 lever) const noexcept {
    return residual_px(c.distance_px, c.dark_side_known ? 1 : 0, c.polarity, c.contrast,
                       px_per_s(c.gradient, cross(lever, c.gradient)));
  }

  /// The measurement of an event: one row [J; d] of d = J [pose; biases], of errors true minus estimated, with J =
  /// [g, (E - T) x g, s c, -s p / c, p v / 2], T the marker's origin, c the edge's
  /// `contrast`, v its speed along its normal [px/ms].
  /// @param g d(n.u) / dE, u the image of E, n the edge's normal [px/m]
  /// @param lever E - T [m]
  /// @param from_end_px2 squared distance from the edge's nearer end, as in Correspondence. Blur rounds the corners
  /// there: events lie up to half a pixel farther inside of a marker's corner. Counted like others, they would make
  /// the marker seem nearer than it is, as was measured.
  [[gnu::always_inline]] EventMeasurement measure(Vec3 g, Vec3 lever, double distance_px, double from_end_px2, double s,
                                                  double p, double contrast = 1) const noexcept {
    const Vec3 by_rotation = cross(lever, g);
    const double toward_dark_px_per_s = px_per_s(g, by_rotation);
    const double residual = residual_px(distance_px, s, p, contrast, toward_dark_px_per_s),
                 residual2 = residual * residual;
    const double smear_px = response_s * toward_dark_px_per_s, base2 = robust_px * robust_px;
    const double robust2 = base2 + smear_px * smear_px;
    const double weight =
        signal_share(toward_dark_px_per_s, s * p) * end_weight(from_end_px2) * robust2 / (robust2 + residual2);
    return {{g.x, g.y, g.z, by_rotation.x, by_rotation.y, by_rotation.z, s * contrast, -s * p / contrast,
             by_off_delay(p, toward_dark_px_per_s), residual},
            // Across an edge of little contrast, one step of light is a longer way, and where its events lie is less
            // certain: the standard deviation goes with 1 / contrast. More contrast than the mean earns no more weight.
            simd::smaller(contrast * contrast * weight, weight),
            residual2,
            squared_norm(lever),
            squared_norm(g),
            toward_dark_px_per_s};
  }

 private:
  // Speed of an edge along its normal.
  [[gnu::always_inline]] double px_per_s(Vec3 g, Vec3 by_rotation) const noexcept {
    return time_direction * (dot(g, twist.t) + dot(by_rotation, twist.r));
  }

  // By how much an OFF delay of 1 ms shifts an event along its edge's normal [px/ms].
  [[gnu::always_inline]] static double by_off_delay(double p, double px_per_s) noexcept {
    return 0.5e-3 * p * px_per_s;
  }

  // Probability that an event comes from its edge, and does not match it by chance. An edge makes ON events while it
  // moves toward the dark, and OFF events while it moves away from it, in number proportional to its speed.
  [[gnu::always_inline]] double signal_share(double toward_dark_px_per_s, double sp) const noexcept {
    const double absolute = std::abs(toward_dark_px_per_s);
    // Speed in the direction that makes events of this polarity, negative if the edge moves the other way; in either
    // direction where dark side or polarity is not known.
    const double x = sp * toward_dark_px_per_s + (1 - std::abs(sp)) * absolute;
    // The mean of max(x, 0), where x is uncertain by sigma = `speed_deviation_px_per_s`, is taken as max(x, 0) +
    // sigma^2 / b, b = 4 |x| + 2 sigma: sigma / 2 at x = 0, where a normal distribution gives 0.4 sigma, and a tail
    // that falls as 1 / |x|, so that no event is surely noise. All is multiplied by b: one division is enough.
    const double b = 4 * absolute + 2 * speed_deviation_px_per_s;
    const double speed_times_b = 0.5 * (x + absolute) * b + speed_deviation_px_per_s * speed_deviation_px_per_s;
    return speed_times_b / (speed_times_b + by_chance_px_per_s * b);
  }

  // Within three times the spread of the events a blurred corner is round. Where edges slide along themselves, only
  // their ends make events: with a weight of 0, nothing would tell the trail. A fifth is enough. Without a branch,
  // which would keep the loop over a batch from being vectorised.
  [[gnu::always_inline]] double end_weight(double from_end_px2) const noexcept {
    constexpr double kSpreads2 = 9, kAtEnds = 0.2;
    return 0.5 * (1 + kAtEnds) + std::copysign(0.5 * (1 - kAtEnds), from_end_px2 - kSpreads2 * spread_px2);
  }
};

}  // namespace evmarker
