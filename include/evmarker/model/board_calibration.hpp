#pragma once
// Calibration of a board: the places of single markers that were tracked together become one rigid body.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/base/jackknife.hpp"
#include "evmarker/base/median.hpp"
#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/model/board_adjustment.hpp"
#include "evmarker/model/board_start.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/pose_perturbation.hpp"

namespace evmarker {

/// Where a marker is on a board, and how certain that is.
struct CalibratedMarker {
  MarkerId id = 0;
  Eigen::Isometry3d T_board_marker = Eigen::Isometry3d::Identity();
  double sigma_m = 0, sigma_rad = 0;  ///< standard deviations: roots of the traces of both covariances
  std::size_t views = 0;              ///< in which it was seen together with others
};

struct BoardCalibration {
  std::vector<CalibratedMarker> markers;  ///< in the order in which they were named
  std::size_t views = 0;
  double residual_px = 0;  ///< root mean square distance between corners as tracked and as the board places them
};

/// Collects poses of single markers at many times and finds the board on which they are, see BoardAdjustment. A pose
/// counts by its covariance, and less at a flat angle: depth and tilt, which the image hardly shows, then have no more
/// weight than they deserve.
class BoardCalibrator {
 public:
  /// @param ids of the markers; the frame of the first is that of the board
  /// @param length of each [m]
  /// @param focal_length [px]
  /// @throws std::invalid_argument for fewer than two markers, one that is named twice, or a length out of range
  BoardCalibrator(std::vector<MarkerId> ids, double length, double focal_length)
      : ids_(std::move(ids)), image_{length, focal_length} {
    const Require require("board calibrator");
    require.positive(length, "length");
    require.positive(focal_length, "focal_length");
    if (ids_.size() < 2) throw std::invalid_argument("board: needs two markers or more");
    for (auto id = ids_.begin(); id != ids_.end(); ++id)
      if (std::find(ids_.begin(), id, *id) != id)
        throw std::invalid_argument("board: marker " + std::to_string(*id) + " is there twice");
  }

  /// Takes the poses of all markers at one time. Those in other states than `tracking` are ignored, and so is a time at
  /// which nothing has moved since the last one that was kept.
  void add(std::span<const PoseEstimate> poses) {
    View view;
    std::vector<double> trails_px;
    for (std::size_t m = 0; m < ids_.size(); ++m)
      for (const PoseEstimate& pose : poses)
        if (pose.id == ids_[m] && usable(pose)) {
          tracked_[m] = true;
          view.push_back({m, pose.T_camera_marker, whitening(pose)});
          if (pose.trail_px) trails_px.push_back(*pose.trail_px);
        }
    if (view.size() < 2 || (!views_.empty() && alike(views_.back(), view))) return;
    views_.push_back(std::move(view));
    trails_px_.insert(trails_px_.end(), trails_px.begin(), trails_px.end());
  }

  /// How far events lie behind their moving edges, the median over all poses; 0 without any. It is a property of sensor
  /// and print. The estimates of single markers err by as much as it is, which turns and shifts their poses: tracked
  /// again with this as `KalmanSettings::initial_trail_px`, they make the board more accurate.
  double trail_px() const { return trails_px_.empty() ? 0 : median(trails_px_); }

  /// The markers of which no pose counted, alone or with others: they may not be on the body.
  std::vector<MarkerId> never_tracked() const {
    std::vector<MarkerId> ids;
    for (std::size_t m = 0; m < ids_.size(); ++m)
      if (!tracked_[m]) ids.push_back(ids_[m]);
    return ids;
  }

  /// Finds the board.
  /// @throws std::runtime_error in one sentence if a marker was not seen together with others, or the board not from
  /// different sides
  BoardCalibration solve() const {
    if (views_.size() < kLeastViews)
      throw std::runtime_error("two of the markers or more were tracked together at only " +
                               std::to_string(views_.size()) + " places, of the " + std::to_string(kLeastViews) +
                               " that are needed: move them longer");
    const std::vector<View> views = thinned();
    const BoardStart start(ids_, image_, views);
    std::vector<BoardView> located;
    for (const View& view : views) located.push_back({view, start.locate(view)});
    BoardAdjustment adjustment(start.markers(), std::move(located));
    adjustment.solve();
    require_variety(adjustment);
    return result(adjustment);
  }

 private:
  using View = BoardStart::View;

  static constexpr std::size_t kLeastViews = BoardStart::kLeastViews, kMostViews = 1000;
  static constexpr double kMoved_px = 1;  // between two views
  static constexpr double kLeastTurn_rad = 10 * std::numbers::pi / 180;

  // A pose that may count: seen well enough that its covariance can be relied on.
  static bool usable(const PoseEstimate& pose) {
    return pose.quality.state == TrackingState::tracking && pose.covariance &&
           Eigen::LLT<Matrix6d>(*pose.covariance).info() == Eigen::Success;
  }

  // With the cosine of the tilt as a factor: the errors that successive poses have in common, which the covariance does
  // not know, grow as a marker is seen at a flatter angle.
  static Matrix6d whitening(const PoseEstimate& pose) {
    const double cos_tilt = direction(pose.T_camera_marker, Eigen::Isometry3d::Identity()).z;
    return cos_tilt * Eigen::LLT<Matrix6d>(*pose.covariance).matrixL().solve(Matrix6d::Identity());
  }

  bool alike(const View& a, const View& b) const {
    return std::ranges::equal(a, b, [&](const MarkerSighting& x, const MarkerSighting& y) {
      return x.marker == y.marker && image_.distance_px(x.T_camera_marker, y.T_camera_marker) < kMoved_px;
    });
  }

  std::vector<View> thinned() const {
    const std::size_t every = (views_.size() + kMostViews - 1) / kMostViews;
    std::vector<View> kept;
    for (std::size_t i = 0; i < views_.size(); i += every) kept.push_back(views_[i]);
    return kept;
  }

  // Every marker must have been seen from directions that differ: from one direction, a wrong depth or tilt is the same
  // in all views.
  void require_variety(const BoardAdjustment& adjustment) const {
    for (std::size_t m = 0; m < ids_.size(); ++m) {
      std::vector<Vec3> directions;
      for (const BoardView& view : adjustment.views())
        for (const MarkerSighting& sighting : view.sightings)
          if (sighting.marker == m) directions.push_back(direction(view.T_camera_board, adjustment.markers()[m]));
      Vec3 mean;
      for (const Vec3& d : directions) mean = mean + d;
      double farthest = 0;
      for (const Vec3& d : directions)
        farthest = std::max(farthest, std::acos(std::min(1.0, dot(d, mean) / norm(mean))));
      if (farthest < kLeastTurn_rad)
        throw std::runtime_error("marker " + std::to_string(ids_[m]) +
                                 " was seen together with others from one side only, all within " +
                                 std::to_string(std::lround(farthest * 180 / std::numbers::pi)) +
                                 " deg of the mean direction: turn the body by " +
                                 std::to_string(std::lround(kLeastTurn_rad * 180 / std::numbers::pi)) + " deg or more");
    }
  }

  // Unit vector from a square to the camera, in the square's frame.
  static Vec3 direction(const Eigen::Isometry3d& T_camera_board, const Eigen::Isometry3d& T_board_marker) {
    const Vec3 camera = translation((T_camera_board * T_board_marker).inverse());
    return camera / norm(camera);
  }

  double residual_px(const BoardAdjustment& adjustment) const {
    double sum = 0, weights = 0;
    for (const BoardView& view : adjustment.views())
      for (const MarkerSighting& sighting : view.sightings) {
        const auto seen = image_.corners(sighting.T_camera_marker),
                   expected = image_.corners(view.T_camera_board * adjustment.markers()[sighting.marker]);
        const double weight = adjustment.weight(view, sighting);
        for (std::size_t i = 0; i < 4; ++i) sum += weight * squared_norm(seen[i] - expected[i]);
        weights += 4 * weight;
      }
    return std::sqrt(sum / weights);
  }

  BoardCalibration result(const BoardAdjustment& adjustment) const {
    BoardCalibration result{{}, adjustment.views().size(), residual_px(adjustment)};
    const std::vector<Vector6d> variances = variances_of(adjustment);
    for (std::size_t m = 0; m < ids_.size(); ++m) {
      CalibratedMarker marker{ids_[m], adjustment.markers()[m], std::sqrt(variances[m].head<3>().sum()),
                              std::sqrt(variances[m].tail<3>().sum()), 0};
      for (const BoardView& view : adjustment.views())
        marker.views += std::ranges::any_of(view.sightings, [&](const auto& s) { return s.marker == m; });
      result.markers.push_back(marker);
    }
    return result;
  }

  // Variances of each marker's pose on the board, by the jackknife; but not less than those from the scatter of the
  // residuals, as the jackknife sees no deviation of a marker whose views all lie in one tenth.
  static std::vector<Vector6d> variances_of(const BoardAdjustment& adjustment) {
    std::vector<Vector6d> variances(adjustment.markers().size(), Vector6d::Zero());
    leave_out_tenths(adjustment.views(), [&](std::vector<BoardView> others) {
      BoardAdjustment without(adjustment.markers(), std::move(others));
      without.solve();
      for (std::size_t m = 1; m < variances.size(); ++m)
        variances[m] += kJackknifeWeight * pose_difference(adjustment.markers()[m], without.markers()[m]).cwiseAbs2();
    });
    const Eigen::VectorXd scatter = adjustment.covariance().diagonal();
    for (std::size_t m = 1; m < variances.size(); ++m)
      variances[m] = variances[m].cwiseMax(scatter.segment<6>(6 * static_cast<Eigen::Index>(m - 1)));
    return variances;
  }

  std::vector<MarkerId> ids_;
  std::vector<bool> tracked_ = std::vector<bool>(ids_.size());
  MarkerImage image_;
  std::vector<View> views_;
  std::vector<double> trails_px_;
};

}  // namespace evmarker
