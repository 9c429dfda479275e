#pragma once
// Floor 4. The paper's rule: translation and rotation updates, Eqs. (6) to (12).
#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>

#include "evmarker/pose_update.hpp"
#include "evmarker/so3.hpp"

namespace evmarker {

/// Gains of the paper's rule. All are dimensionless, so the same numbers serve every marker size and unit.
struct DecoupledSettings {
  /// w0 of Eqs. (8), (9), (11): the weight of one event in the running averages; 0 stands for one over the number of
  /// events per update, at most 0.03, so that the averages remember one update's events or about thirty.
  double averaging_weight = 0;
  double translation_gain = 1.4;  ///< lambda_T of Eq. (10)
  double rotation_gain = 2;       ///< lambda_r, of the torque divided by the mean squared lever arm
  /// The paper leaves the torque of Eq. (11) in units of length squared. If set, it is not divided by the lever arm but
  /// measured in this unit [m].
  std::optional<double> torque_length_unit_m = std::nullopt;
  bool forget_after_update = true;  ///< correct the averages for the step just made; the paper keeps them as they are

  /// The paper's own numbers: w0 = 0.1, lambda_T = 1.4, lambda_r = 0.003 with lengths in centimetres.
  static DecoupledSettings paper() {
    return {.averaging_weight = 0.1,
            .translation_gain = 1.4,
            .rotation_gain = 0.003,
            .torque_length_unit_m = 0.01,
            .forget_after_update = false};
  }
};

/// Translation by Lu's optimal step over running averages, rotation by the torque of virtual springs about the marker's
/// origin (Loch, Haessig, Vincze; Reverter Valeiras et al.). Estimates neither twist nor information.
class DecoupledUpdate {
 public:
  using Settings = DecoupledSettings;

  DecoupledUpdate(const Settings& settings, int events_per_update) : settings_(settings) {
    if (settings_.averaging_weight == 0) settings_.averaging_weight = std::min(0.03, 1.0 / events_per_update);
    const auto require = [](bool good, const char* name, double value) {
      if (!good) throw std::invalid_argument(std::string("decoupled update: ") + name + " is " + std::to_string(value));
    };
    require(settings_.averaging_weight > 0 && settings_.averaging_weight <= 1, "averaging_weight",
            settings_.averaging_weight);
    require(settings_.translation_gain > 0, "translation_gain", settings_.translation_gain);
    require(settings_.rotation_gain > 0, "rotation_gain", settings_.rotation_gain);
    const double unit = settings_.torque_length_unit_m.value_or(1);
    require(std::isfinite(unit) && unit > 0, "torque_length_unit_m", unit);
  }

  void add(const Correspondence& c, const Eigen::Isometry3d& T_camera_marker) noexcept {
    const double w0 = settings_.averaging_weight;
    const Eigen::Vector3d lever = c.E - T_camera_marker.translation();
    const Eigen::Vector3d pull = c.F - c.E;
    const Eigen::Matrix3d L = c.M * (c.M / c.M.squaredNorm()).transpose();  // Eq. (6)
    A_ += w0 * (Eigen::Matrix3d::Identity() - L - A_);                      // Eq. (8)
    B_ += w0 * (pull - B_);                       // Eq. (9) with E for F, as an increment: (L - I) E = F - E
    Gamma_ += w0 * (lever.cross(pull) - Gamma_);  // Eq. (11) with E for F
    lever2_ += w0 * (lever.squaredNorm() - lever2_);
    weight_ += w0 * (1 - weight_);
  }

  bool update(Eigen::Isometry3d& T_camera_marker, Timestamp) noexcept {
    // Damped far below the weakest direction that a visible marker leaves (its depth: about (size / distance)^2 / 10),
    // so that a handful of events on one line of sight gives a step along that line of zero instead of a division by
    // it.
    const Eigen::Matrix3d damped = A_ + 1e-6 * weight_ * Eigen::Matrix3d::Identity();
    Eigen::Matrix3d inverse = Eigen::Matrix3d::Zero();
    bool invertible = false;
    damped.computeInverseWithCheck(inverse, invertible, 1e-12 * weight_ * weight_ * weight_);
    const double torque_scale = settings_.torque_length_unit_m
                                    ? 1 / (*settings_.torque_length_unit_m * *settings_.torque_length_unit_m)
                                    : 1 / lever2_;
    const Eigen::Vector3d dT = settings_.translation_gain * (inverse * B_);     // Eqs. (7), (10)
    const Eigen::Vector3d r = settings_.rotation_gain * torque_scale * Gamma_;  // r = lambda_r Gamma
    if (!invertible || !dT.allFinite() || !r.allFinite()) return false;
    T_camera_marker.translation() += dT;
    T_camera_marker.linear() = orthonormalized(so3_exp(r) * T_camera_marker.linear());  // Eq. (12)
    if (settings_.forget_after_update) {
      B_ -= A_ * dT;  // what the old residuals would be at the new pose
      Gamma_.setZero();
    }
    return true;
  }

  void reverse() noexcept {
    A_.setZero();
    B_.setZero();
    Gamma_.setZero();
    lever2_ = weight_ = 0;
  }

  Matrix6d information() const noexcept { return Matrix6d::Zero(); }
  std::optional<Vector6d> twist() const noexcept { return std::nullopt; }

 private:
  Settings settings_;
  Eigen::Matrix3d A_ = Eigen::Matrix3d::Zero();
  Eigen::Vector3d B_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d Gamma_ = Eigen::Vector3d::Zero();
  double lever2_ = 0;  // running mean of |E - T|^2 [m^2]
  double weight_ = 0;  // 1 once the averages are filled
};

static_assert(PoseUpdateRule<DecoupledUpdate>);

}  // namespace evmarker
