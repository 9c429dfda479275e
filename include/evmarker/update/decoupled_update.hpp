#pragma once
// The paper's rule: translation and rotation updates, Eqs. (6) to (12).
#include <algorithm>
#include <array>
#include <cmath>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/matched_background.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

/// Gains of the paper's rule. By default they are dimensionless, so that the same numbers serve every marker size.
struct DecoupledSettings {
  /// w0 of Eqs. (8), (9), (11): the weight of one event in the running averages. The default, 0, stands for
  /// min(0.1, 1 / events_per_update): the averages extend over the events of one update, and over ten at least.
  double averaging_weight = 0;
  double translation_gain = 1.4;  ///< lambda_T of Eq. (10)
  double rotation_gain = 3;       ///< lambda_r, of the torque divided by the mean squared lever arm
  /// Unit of length [m] in which the torque of Eq. (11), a length squared, is expressed, as in the paper. 0: the torque
  /// is divided by the mean squared lever arm instead.
  double torque_length_unit_m = 0;
  /// Corrects the trail: events lie a fraction of a pixel behind their moving edge, as a pixel fires only after a whole
  /// contrast step, see `expected_trail_px`. Not in the paper.
  bool correct_trail = true;
  /// Keeps the pose where it is while the events are background. Not in the paper.
  bool hold_at_rest = true;

  /// The paper's own numbers: w0 = 0.1, lambda_T = 1.4, lambda_r = 0.003. It does not say in which unit of length: with
  /// centimetres they work.
  static DecoupledSettings paper() {
    return {.averaging_weight = 0.1,
            .translation_gain = 1.4,
            .rotation_gain = 0.003,
            .torque_length_unit_m = 0.01,
            .correct_trail = false,
            .hold_at_rest = false};
  }
};

/// Translation that minimises the error in space (Lu, Hager and Mjolsness, 2000) over running averages, rotation by the
/// torque of virtual springs about the marker's origin (Loch, Haessig, Vincze; Reverter Valeiras et al.). Estimates
/// neither twist nor covariance.
class DecoupledUpdate {
 public:
  using Settings = DecoupledSettings;

  /// @throws std::invalid_argument naming the setting and its value
  DecoupledUpdate(const Settings& settings, int events_per_update) : settings_(settings) {
    const Require require("decoupled update");
    require(events_per_update >= 1, "events_per_update", events_per_update);
    set_events_per_update(events_per_update);
    require(weight_ > 0 && weight_ <= 1, "averaging_weight", weight_);
    require.positive(settings_.translation_gain, "translation_gain");
    require.positive(settings_.rotation_gain, "rotation_gain");
    require.not_negative(settings_.torque_length_unit_m, "torque_length_unit_m");
  }

  void set_events_per_update(int events) noexcept {
    weight_ = settings_.averaging_weight == 0 ? std::min(0.1, 1.0 / events) : settings_.averaging_weight;
    renewed_ = std::min(1.0, events * weight_);
    for (std::size_t i = 0; i <= simd::kLanes; ++i) kept_[i] = std::pow(1 - weight_, i);
    for (std::size_t i = 0; i < simd::kLanes; ++i) weights_[i] = weight_ * kept_[simd::kLanes - 1 - i];
  }

  /// Sets the trail that is corrected.
  /// @param events_per_passage events per area that edges sweep in the image [1/px^2]: as many as a pixel makes in a
  /// passage
  // The width of an edge in focus is assumed. Measured from the residuals, as KalmanUpdate does, it would contain this
  // rule's jitter: the trail would come out too long, and that would in turn increase the jitter.
  void set_trail_by_events_per_passage(double events_per_passage, double focal_length) noexcept {
    if (!settings_.correct_trail) return;
    constexpr double kFocusedEdge_px = 2.1;  // sqrt(12) times a point spread of 0.6 px
    constexpr double kMost_px = 0.5;         // a jittering pose overestimates the swept area, and so the trail
    trail_over_f2_ =
        std::min(expected_trail_px(kFocusedEdge_px, events_per_passage), kMost_px) / (focal_length * focal_length);
  }

  /// None that it knows of: it estimates no motion that polarities could fit.
  static constexpr MovingShare moving_share() noexcept { return {}; }
  /// Of the background, only the weight of the events is used.
  void set_background(const MatchedBackground& background) noexcept {
    signal_weight_ = settings_.hold_at_rest ? background.signal_weight : 1;
  }

  /// Adds one event to the running averages.
  [[gnu::always_inline]] void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const Terms of_event = terms({c.M.x(), c.M.y()}, c.E, c.F, c.gradient, c.dark_side_known ? c.polarity : 0,
                                 translation(T_camera_marker));
    for (std::size_t k = 0; k < kTerms; ++k) means_[k] += weight_ * (of_event[k] - means_[k]);
  }

  /// Batch version. Adds to `sums_`, lane by lane, instead of `means_`; `update` then forms means = faded_ * means +
  /// sum of the lanes. While not `summing_`, `sums_` is void, and its numbers get the weight 0.
  [[gnu::always_inline]] void add(const Correspondences& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const std::size_t n = c.count;
    const double kept = summing_ ? kept_[n] : 0;
    const Vec3 T = translation(T_camera_marker);
    alignas(64) simd::Lanes weights;
    // w0 (1 - w0)^(n - 1 - i) for event i of n, then zeros.
    for (std::size_t i = 0; i < simd::kLanes; ++i) weights[i] = weights_[simd::kLanes - n + i];
    simd::for_each_lane([&](std::size_t i) __attribute__((always_inline)) {
      const Terms of_event = terms({c.M_x[i], c.M_y[i]}, {c.E_x[i], c.E_y[i], c.E_z[i]}, {c.F_x[i], c.F_y[i], c.F_z[i]},
                                   {c.g_x[i], c.g_y[i], c.g_z[i]}, c.polarity[i], T);
#pragma GCC unroll 13
      for (std::size_t k = 0; k < kTerms; ++k) sums_[k][i] = kept * sums_[k][i] + weights[i] * of_event[k];
    });
    faded_ *= kept_[n];
    summing_ = true;
  }

  bool update(Eigen::Isometry3d& T_camera_marker, Timestamp) noexcept {
    if (summing_) add_sums();
    // A x = B by Cramer's rule, the six elements of A = I - mean L by hand: as matrices they would go through memory.
    const double xx = 1 - means_[kL], xy = -means_[kL + 1], yy = 1 - means_[kL + 2], xz = -means_[kL + 3],
                 yz = -means_[kL + 4], zz = 1 - means_[kL + 5];
    const Vec3 B{means_[kB], means_[kB + 1], means_[kB + 2]},
        Gamma{means_[kGamma], means_[kGamma + 1], means_[kGamma + 2]};
    const double c_xx = yy * zz - yz * yz, c_xy = xz * yz - xy * zz, c_xz = xy * yz - yy * xz;
    const double c_yy = xx * zz - xz * xz, c_yz = xy * xz - xx * yz, c_zz = xx * yy - xy * xy;
    const double determinant = xx * c_xx + xy * c_xy + xz * c_xz;
    const double unit = settings_.torque_length_unit_m, unit2 = unit > 0 ? unit * unit : means_[kLever2];
    // If an update has fewer events than the averages extend over, only about the share `renewed_` of the averages is
    // new. The step is reduced to it, so that old events, which are still in them, are not applied again in full.
    const double share = signal_weight_ * renewed_, step = share * settings_.translation_gain / determinant;
    const Vec3 dT(step * (c_xx * B.x + c_xy * B.y + c_xz * B.z),  // Eqs. (7), (10)
                  step * (c_xy * B.x + c_yy * B.y + c_yz * B.z), step * (c_xz * B.x + c_yz * B.y + c_zz * B.z));
    const Vec3 r = share * settings_.rotation_gain / unit2 * Gamma;  // r = lambda_r Gamma
    const Vec3 T = translation(T_camera_marker) + dT;
    if (!(std::abs(determinant) > 1e-9 && is_finite(T) && std::isfinite(squared_norm(r)))) return false;
    set_translation(T_camera_marker, T);
    orthonormalize(T_camera_marker);  // before the turn, while the processor still divides for r
    turn(T_camera_marker, r);         // Eq. (12)
    return true;
  }

  void reverse() noexcept {  // L and the lever arm are geometry, the same in both directions of time
    forget_sums();
    std::fill_n(means_.begin() + kB, 3, 0.0);
    std::fill_n(means_.begin() + kGamma, 3, 0.0);
  }

 private:
  // What one event adds to the running averages: L = M M^T / M^T M, symmetric (xx, xy, yy, xz, yz, zz); B; |E - T|^2;
  // Gamma.
  static constexpr std::size_t kL = 0, kB = 6, kLever2 = 9, kGamma = 10, kTerms = 13;
  using Terms = std::array<double, kTerms>;

  /// Eqs. (6), (8), (9), (11) for one event. The paper's (L - I) F is always zero, as F lies on the line of sight, and
  /// the pose would never move: here it is (L - I) E. R* F_i of Eq. (11), the lever arm from the marker's
  /// origin, is E - T. After a step, the averages are not recomputed for the new pose: old pulls act again, weaker, in
  /// later steps. In our experiments it is this that lets the pose keep up with fast motion.
  /// @param m line of sight M = (m; 1)
  /// @param gradient d(n.u) / dE [px/m]: u the image of E, n the edge's unit normal toward its dark side
  /// @param polarity of the event, 0 if not known on which side the edge is dark
  [[gnu::always_inline]] Terms terms(Vec2 m, Vec3 E, Vec3 F, Vec3 gradient, double polarity, Vec3 T) const noexcept {
    const double inverse_MM = 1 / (m.x * m.x + m.y * m.y + 1);
    // (L - I) E = F - E. The correction of a trail of d pixels shifts F by d along the image normal n, to the dark
    // side for ON events, which lie on the bright side, and back for OFF events. In space that is d F.z / f (n; 0), and
    // that is d F.z E.z / f^2 (g.x, g.y, 0), as the gradient's g.xy = f / E.z n. Of this v, the part across the line of
    // sight counts: v - (M.v / M.M) M.
    const double v_per_gradient = trail_over_f2_ * polarity * F.z * E.z;  // [m^2/px]
    const double along_sight = inverse_MM * (m.x * gradient.x + m.y * gradient.y);
    const Vec3 pull{F.x - E.x + v_per_gradient * (gradient.x - along_sight * m.x),
                    F.y - E.y + v_per_gradient * (gradient.y - along_sight * m.y),
                    F.z - E.z - v_per_gradient * along_sight};
    const Vec3 lever = E - T, torque = cross(lever, pull);
    return {inverse_MM * m.x * m.x,
            inverse_MM * m.x * m.y,
            inverse_MM * m.y * m.y,
            inverse_MM * m.x,
            inverse_MM * m.y,
            inverse_MM,
            pull.x,
            pull.y,
            pull.z,
            squared_norm(lever),
            torque.x,
            torque.y,
            torque.z};
  }

  [[gnu::noinline]] void add_sums() noexcept {
    simd::in_wide_vectors([&]() __attribute__((always_inline)) {
      for (std::size_t k = 0; k < kTerms; ++k) means_[k] = faded_ * means_[k] + simd::sum(sums_[k]);
    });
    forget_sums();
  }

  void forget_sums() noexcept {
    faded_ = 1;
    summing_ = false;
  }

  Settings settings_;
  double trail_over_f2_ = 0;  // trail / f^2 [1/px]
  double weight_ = 0;         // w0
  double signal_weight_ = 1;  // see MatchedBackground
  double renewed_ = 1;        // min(1, n w0), about the share of the averages that is new after n events
  // Zero at first, so that A = I. As the mean of only the first few events, on nearly one line of sight, A would be
  // almost singular along it, and the step in depth huge.
  alignas(16) Terms means_{};
  alignas(64) std::array<simd::Lanes, kTerms> sums_{};  // see the batch version of `add`
  bool summing_ = false;                                // events have been added to them since the last update
  double faded_ = 1;                                    // what these events leave of the averages
  std::array<double, simd::kLanes + 1> kept_{};         // kept_[n] = (1 - w0)^n: what n events leave of the averages
  std::array<double, 2 * simd::kLanes> weights_{};      // w0 (1 - w0)^(7 - i), then zeros
};

static_assert(BatchUpdateRule<DecoupledUpdate> && NoiseAwareRule<DecoupledUpdate> && TrailTakingRule<DecoupledUpdate>);

}  // namespace evmarker
