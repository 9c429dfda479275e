#pragma once
// Accuracy and coverage of estimated poses against the truth.
#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/information.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/pose_perturbation.hpp"

namespace evmarker {

/// Error of an estimated pose: distance of the origins [mm], and angle between the orientations [deg].
struct PoseError {
  double translation_mm = 0;
  double rotation_deg = 0;  ///< geodesic angle
};

inline PoseError pose_error(const Eigen::Isometry3d& estimate, const Eigen::Isometry3d& truth) {
  return {1e3 * norm(translation(estimate) - translation(truth)),
          180 / std::numbers::pi * geodesic_angle(estimate.linear(), truth.linear())};
}

/// Squared error of an estimated pose in units of its own covariance, per degree of freedom (the normalised estimation
/// error squared, NEES): 1 on average where the covariance is right, NaN where none is stated.
inline double nees(const PoseEstimate& estimate, const Eigen::Isometry3d& truth) {
  const Matrix6d information = evmarker::information(estimate);
  if (!(information.diagonal().minCoeff() > 0)) return std::numeric_limits<double>::quiet_NaN();
  const Vector6d error = pose_difference(estimate.T_camera_marker, truth);
  return error.dot(information * error) / 6;
}

/// Mean, median, 95th percentile and maximum of a sample; all zero for an empty one.
struct Spread {
  double mean = 0, median = 0, p95 = 0, max = 0;

  static Spread of(std::vector<double> values) {
    if (values.empty()) return {};
    std::ranges::sort(values);
    const auto quantile = [&](double q) {
      return values[static_cast<std::size_t>(std::lround(q * static_cast<double>(values.size() - 1)))];
    };
    return {std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size()), quantile(0.5),
            quantile(0.95), values.back()};
  }
};

/// Compares the poses of one marker with the true ones. Errors and coverage are those of the poses in state `tracking`,
/// on which users rely; coverage counts those, too, whose true pose is not known.
class AccuracyMeter {
 public:
  /// @param slot coverage is the share of slots of this length that contain a `tracking` pose
  /// @throws std::invalid_argument if it is under 1 us
  explicit AccuracyMeter(std::chrono::microseconds slot = std::chrono::milliseconds(10)) : slot_us_(slot.count()) {
    if (slot_us_ < 1) throw std::invalid_argument("accuracy: slot is " + std::to_string(slot_us_) + " us");
  }

  /// Adds a pose and, where it is known, the true T_camera_marker at its time.
  void add(const PoseEstimate& estimate, const std::optional<Eigen::Isometry3d>& truth) {
    if (all_ == 0) first_t_ = estimate.t;
    ++all_;
    if (estimate.quality.state == TrackingState::lost) ++lost_;
    if (estimate.quality.state != TrackingState::tracking) return;
    ++tracking_;
    if (truth) add_error(estimate, *truth);
    if (estimate.t < first_t_) return;
    const Timestamp slot = (estimate.t - first_t_) / slot_us_;
    if (slots_.empty() || slots_.back() != slot) slots_.push_back(slot);
  }

  std::size_t poses() const noexcept { return all_; }                       ///< in any state
  std::size_t tracking() const noexcept { return tracking_; }               ///< poses in state `tracking`
  std::size_t compared() const noexcept { return translation_mm_.size(); }  ///< those of them whose true pose is known
  std::size_t lost() const noexcept { return lost_; }                       ///< how often the marker was lost
  std::size_t wild() const noexcept { return wild_; }      ///< compared ones with errors above 50 mm or 20 deg
  Timestamp first_t() const noexcept { return first_t_; }  ///< of the first pose in any state [us]
  Spread translation_mm() const { return Spread::of(translation_mm_); }
  Spread rotation_deg() const { return Spread::of(rotation_deg_); }
  Spread nees() const { return Spread::of(nees_); }  ///< of the poses that state a covariance

  /// Number of whole slots from the first pose to `end` [us].
  Timestamp slots(Timestamp end) const noexcept {
    return all_ == 0 || end < first_t_ ? 0 : (end - first_t_) / slot_us_;
  }
  /// Share of those slots that contain a `tracking` pose; 0 if there is no slot.
  double coverage(Timestamp end) const {
    const Timestamp whole = slots(end);
    if (whole == 0) return 0;
    std::vector<Timestamp> covered = slots_;
    std::ranges::sort(covered);
    covered.erase(std::unique(covered.begin(), covered.end()), covered.end());  // clang 14 refuses ranges::unique
    const auto within = std::ranges::lower_bound(covered, whole) - covered.begin();
    return static_cast<double>(within) / static_cast<double>(whole);
  }

 private:
  void add_error(const PoseEstimate& estimate, const Eigen::Isometry3d& truth) {
    PoseError error = pose_error(estimate.T_camera_marker, truth);
    for (double* value : {&error.translation_mm, &error.rotation_deg})  // NaN cannot be sorted
      if (std::isnan(*value)) *value = std::numeric_limits<double>::infinity();
    translation_mm_.push_back(error.translation_mm);
    rotation_deg_.push_back(error.rotation_deg);
    if (const double normalised = evmarker::nees(estimate, truth); std::isfinite(normalised))
      nees_.push_back(normalised);
    wild_ += error.translation_mm > 50 || error.rotation_deg > 20;
  }

  Timestamp slot_us_;
  Timestamp first_t_ = 0;
  std::size_t all_ = 0, tracking_ = 0, lost_ = 0, wild_ = 0;
  std::vector<double> translation_mm_, rotation_deg_, nees_;
  std::vector<Timestamp> slots_;  // numbers of those with `tracking` poses, in their order
};

}  // namespace evmarker
