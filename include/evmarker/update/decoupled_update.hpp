#pragma once
// The paper's rule: translation and rotation updates, Eqs. (6) to (12).
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/update/pose_update.hpp"

namespace evmarker {

/// Gains of the paper's rule. All are dimensionless, so the same numbers serve every marker size and unit.
struct DecoupledSettings {
  /// w0 of Eqs. (8), (9), (11): the weight of one event in the running averages. 0 stands for one over the number of
  /// events per update, at most 0.1: the averages remember the events of one update, or ten.
  double averaging_weight = 0;
  double translation_gain = 1.4;  ///< lambda_T of Eq. (10)
  double rotation_gain = 3;       ///< lambda_r, of the torque divided by the mean squared lever arm
  /// The paper leaves the torque of Eq. (11) in units of length squared: measured in this unit [m]. 0 has it divided by
  /// the mean squared lever arm.
  double torque_length_unit_m = 0;
  /// Whether events are taken to lie behind their moving edges, see `expect_events_per_px2`. Not in the paper.
  bool correct_trail = true;
  /// Whether the pose stays where it is while the events are background. Not in the paper.
  bool rest = true;

  /// The paper's own numbers: w0 = 0.1, lambda_T = 1.4, lambda_r = 0.003 with lengths in centimetres.
  static DecoupledSettings paper() {
    return {.averaging_weight = 0.1,
            .translation_gain = 1.4,
            .rotation_gain = 0.003,
            .torque_length_unit_m = 0.01,
            .correct_trail = false,
            .rest = false};
  }
};

/// Translation by Lu's optimal step over running averages, rotation by the torque of virtual springs about the marker's
/// origin (Loch, Haessig, Vincze; Reverter Valeiras et al.). Estimates neither twist nor covariance.
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
    for (std::size_t i = 0; i <= kLanes; ++i) kept_[i] = std::pow(1 - weight_, i);
    for (std::size_t i = 0; i < kLanes; ++i) weights_[i] = weight_ * kept_[kLanes - 1 - i];
  }

  /// From here on, events lie as far behind their moving edges as follows from how many a pixel makes in a passage.
  // Of an edge in focus: measured by the residuals its width would grow with this rule's own jitter, and that with it.
  void expect_events_per_px2(double events, double focal_length) noexcept {
    if (!settings_.correct_trail) return;
    constexpr double kFocusedEdge_px = 2.1;  // at a point spread of 0.6 px
    constexpr double kMost_px = 0.5;         // a pose that jitters seems to sweep more, and events seem fewer
    trail_ = std::min(expected_trail_px(kFocusedEdge_px, events), kMost_px) / focal_length;
    trail_by_px_ = trail_ / focal_length;
  }

  /// @param share of the events that tells of the marker; 0 at rest
  void expect_signal(double share) noexcept { signal_ = settings_.rest ? share : 1; }

  // By scalars, of which the compiler makes pairs, and inline: see EdgeFollower::push.
  [[gnu::always_inline]] void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const double w0 = weight_;
    const auto average = [w0](double& mean, double value) { mean += w0 * (value - mean); };
    const Eigen::Vector3d &M = c.M, &E = c.E, &F = c.F;
    const double by_MM = 1 / (M.x() * M.x() + M.y() * M.y() + M.z() * M.z());
    const double x = by_MM * M.x(), y = by_MM * M.y(), z = by_MM * M.z();
    average(L_[0], x * M.x());  // Eqs. (6), (8): A = I - mean L
    average(L_[1], x * M.y());
    average(L_[2], y * M.y());
    average(L_[3], x * M.z());
    average(L_[4], y * M.z());
    average(L_[5], z * M.z());
    // (L - I) E, and on by the trail: along the edge's image normal, across the line of sight.
    const double trail = c.dark_side_known ? trail_ * c.polarity * F.z() : 0;
    const double sideways = x * c.normal.x() + y * c.normal.y();
    const double pull_x = F.x() - E.x() + trail * (c.normal.x() - sideways * M.x()),
                 pull_y = F.y() - E.y() + trail * (c.normal.y() - sideways * M.y()),
                 pull_z = F.z() - E.z() - trail * sideways * M.z();
    average(B_.x(), pull_x);  // Eq. (9) with E for F, see below
    average(B_.y(), pull_y);
    average(B_.z(), pull_z);
    const auto& T = T_camera_marker.translation();
    const double lever_x = E.x() - T.x(), lever_y = E.y() - T.y(), lever_z = E.z() - T.z();
    average(lever2_, lever_x * lever_x + lever_y * lever_y + lever_z * lever_z);
    average(Gamma_.x(), lever_y * pull_z - lever_z * pull_y);  // Eq. (11) with E for F
    average(Gamma_.y(), lever_z * pull_x - lever_x * pull_z);
    average(Gamma_.z(), lever_x * pull_y - lever_y * pull_x);
    // The paper writes F where (L - I) F is always zero: nothing would ever move. The averages are not corrected for
    // the steps made since; measured, that memory of the last steps is what lets the pose keep up with a fast motion.
  }

  /// The same for up to eight events: those before them fade, and they by those after them.
  [[gnu::always_inline]] void add(const Correspondences& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const std::size_t n = c.count;
    const double kept = summing_ ? kept_[n] : 0, T_x = T_camera_marker.translation().x(),
                 T_y = T_camera_marker.translation().y(), T_z = T_camera_marker.translation().z();
    alignas(64) Lanes weights;
    for (std::size_t i = 0; i < kLanes; ++i) weights[i] = weights_[kLanes - n + i];
    for (std::size_t i = 0; i < kLanes; ++i) {
      const double x = c.M_x[i], y = c.M_y[i], by_MM = 1 / (x * x + y * y + 1);
      // The normal by its gradient, which is so many pixels per metre.
      const double trail = trail_by_px_ * c.polarity[i] * c.F_z[i] * c.E_z[i];
      const double sideways = by_MM * (x * c.g_x[i] + y * c.g_y[i]);
      const double pull_x = c.F_x[i] - c.E_x[i] + trail * (c.g_x[i] - sideways * x),
                   pull_y = c.F_y[i] - c.E_y[i] + trail * (c.g_y[i] - sideways * y),
                   pull_z = c.F_z[i] - c.E_z[i] - trail * sideways;
      const double lever_x = c.E_x[i] - T_x, lever_y = c.E_y[i] - T_y, lever_z = c.E_z[i] - T_z;
      const double weight = weights[i];
      const auto average = [&](std::size_t k, double value) __attribute__((always_inline)) {
        sums_[k][i] = kept * sums_[k][i] + weight * value;
      };
      average(0, by_MM * x * x);
      average(1, by_MM * x * y);
      average(2, by_MM * y * y);
      average(3, by_MM * x);
      average(4, by_MM * y);
      average(5, by_MM);
      average(6, pull_x);
      average(7, pull_y);
      average(8, pull_z);
      average(9, lever_x * lever_x + lever_y * lever_y + lever_z * lever_z);
      average(10, lever_y * pull_z - lever_z * pull_y);
      average(11, lever_z * pull_x - lever_x * pull_z);
      average(12, lever_x * pull_y - lever_y * pull_x);
    }
    faded_ *= kept_[n];
    summing_ = true;
  }

  bool update(Eigen::Isometry3d& T_camera_marker, Timestamp) noexcept {
    if (summing_) add_sums();
    // A x = B by Cramer's rule, the six elements of A = I - mean L by hand: as matrices they would go through memory.
    const double xx = 1 - L_[0], xy = -L_[1], yy = 1 - L_[2], xz = -L_[3], yz = -L_[4], zz = 1 - L_[5];
    const double c_xx = yy * zz - yz * yz, c_xy = xz * yz - xy * zz, c_xz = xy * yz - yy * xz;
    const double c_yy = xx * zz - xz * xz, c_yz = xy * xz - xx * yz, c_zz = xx * yy - xy * xy;
    const double determinant = xx * c_xx + xy * c_xy + xz * c_xz;
    const double unit = settings_.torque_length_unit_m, unit2 = unit > 0 ? unit * unit : lever2_;
    // Fewer events than the averages remember renew only a share of them, and get only that share of the gain.
    const double share = signal_ * renewed_, step = share * settings_.translation_gain / determinant;
    const Eigen::Vector3d dT(step * (c_xx * B_.x() + c_xy * B_.y() + c_xz * B_.z()),  // Eqs. (7), (10)
                             step * (c_xy * B_.x() + c_yy * B_.y() + c_yz * B_.z()),
                             step * (c_xz * B_.x() + c_yz * B_.y() + c_zz * B_.z()));
    const Eigen::Vector3d r = share * settings_.rotation_gain / unit2 * Gamma_;  // r = lambda_r Gamma
    const Eigen::Vector3d T = T_camera_marker.translation() + dT;
    if (!(std::abs(determinant) > 1e-9 && std::isfinite(T.sum() + r.squaredNorm()))) return false;
    T_camera_marker.translation() = T;
    T_camera_marker.linear() = rotated(T_camera_marker.linear(), r);  // Eq. (12)
    return true;
  }

  void reverse() noexcept {  // L and the lever arm are geometry, the same in both directions of time
    forget_sums();
    B_.setZero();
    Gamma_.setZero();
  }

 private:
  [[gnu::noinline]] void add_sums() noexcept {
    in_wide_vectors([&]() __attribute__((always_inline)) {
      for (std::size_t k = 0; k < 6; ++k) L_[k] = faded_ * L_[k] + sum(sums_[k]);
      for (std::size_t k = 0; k < 3; ++k) {
        const auto axis = static_cast<Eigen::Index>(k);
        B_(axis) = faded_ * B_(axis) + sum(sums_[6 + k]);
        Gamma_(axis) = faded_ * Gamma_(axis) + sum(sums_[10 + k]);
      }
      lever2_ = faded_ * lever2_ + sum(sums_[9]);
    });
    forget_sums();
  }

  void forget_sums() noexcept {
    faded_ = 1;
    summing_ = false;
  }

  Settings settings_;
  double trail_ = 0, trail_by_px_ = 0;  // over the focal length [px], and over its square
  double weight_ = 0;                   // w0
  double signal_ = 1;                   // see expect_signal
  double renewed_ = 1;                  // share of the averages that the events of one update make up
  // Until events have shown in which directions the marker can be seen to move, every direction resists alike: a few
  // events on nearly one line of sight must not be turned into a step along it.
  std::array<double, 6> L_{};  // mean of L, symmetric: xx, xy, yy, xz, yz, zz
  Eigen::Vector3d B_ = Eigen::Vector3d::Zero();
  double lever2_ = 0;  // running mean of |E - T|^2 [m^2]; makes a pair with B_.z(), so that none is across two vectors
  Eigen::Vector3d Gamma_ = Eigen::Vector3d::Zero();
  alignas(64) std::array<Lanes, 13> sums_{};  // what the averages gain by the events since the last update
  bool summing_ = false;                      // else there are none, and the numbers mean nothing
  double faded_ = 1;                          // what they keep of what they were before
  std::array<double, kLanes + 1> kept_{};     // by so many events
  std::array<double, 2 * kLanes> weights_{};  // of eight events one after the other, and of none
};

static_assert(GroupUpdateRule<DecoupledUpdate>);

}  // namespace evmarker
