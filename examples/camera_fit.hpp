#pragma once
// A camera's intrinsics from views of a flat board, and how well they are known.
#include <ceres/ceres.h>
#include <ceres/normal_prior.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <evmarker/evmarker.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

#include "board_corners.hpp"
#include "marker_projection.hpp"

inline evmarker::PinholeCamera camera_of(const Intrinsics& k, LensModel model, evmarker::SensorSize size) {
  const evmarker::Distortion lens =
      model == LensModel::fisheye ? evmarker::Distortion(evmarker::EquidistantDistortion{k[4], k[5], k[6], k[7]})
                                  : evmarker::Distortion(evmarker::BrownConradyDistortion{k[4], k[5], k[6], k[7], 0});
  return {size, k[0], k[1], k[2], k[3], lens};
}

/// The intrinsics with which a flat board explains what is seen of it best, by bundle adjustment over all views.
struct CameraFit {
  Intrinsics intrinsics{};
  std::vector<std::array<double, 6>> poses{};  ///< of the board in each view: rotation vector, translation
  CornerErrors errors{};                       ///< of what is seen
  double rms_px = 0;                           ///< of the corners' distances, per coordinate
};

/// Fits a camera to views without outliers: by bundle adjustment over all of them, with Huber's weight for each marker.
class CameraFitter {
 public:
  /// @param free_pitch whether the scale of the distances between the markers is estimated, too
  CameraFitter(LensModel model, evmarker::SensorSize size, bool free_pitch)
      : model_(model), size_(size), free_pitch_(free_pitch) {}

  /// From a guess of the focal length, by OpenCV's calibration.
  /// @param views three or more
  /// @throws std::runtime_error where they determine no camera
  CameraFit start(const std::vector<BoardCorners>& views, double focal_px) const {
    cv::Matx33d K(focal_px, 0, 0.5 * (size_.width - 1), 0, focal_px, 0.5 * (size_.height - 1), 0, 0, 1);
    std::vector<std::vector<cv::Point3f>> on_board;
    std::vector<std::vector<cv::Point2f>> in_image;
    for (const BoardCorners& view : views) {
      on_board.emplace_back();
      in_image.emplace_back();
      for (const SeenMarker& seen : view.markers) {
        for (const cv::Point3d& point : detail::object_points(*seen.marker, 1)) on_board.back().emplace_back(point);
        for (const evmarker::Vec2 corner : seen.corners_px) in_image.back().emplace_back(corner.x, corner.y);
      }
    }
    cv::Mat lens;
    std::vector<cv::Mat> rotations, translations;
    const int flags = cv::CALIB_USE_INTRINSIC_GUESS | cv::CALIB_FIX_ASPECT_RATIO | cv::CALIB_FIX_K3 |
                      cv::CALIB_ZERO_TANGENT_DIST | cv::CALIB_FIX_PRINCIPAL_POINT;
    cv::calibrateCamera(on_board, in_image, {size_.width, size_.height}, K, lens, rotations, translations, flags);
    CameraFit fit{.intrinsics = {K(0, 0), K(1, 1), K(0, 2), K(1, 2)}};
    fit.intrinsics[kPitch] = 1;
    if (model_ == LensModel::radtan)
      for (int i = 0; i < 2; ++i) fit.intrinsics[4 + std::size_t(i)] = lens.at<double>(i);
    for (std::size_t i = 0; i < views.size(); ++i) {
      const cv::Mat_<double> r = rotations[i], t = translations[i];
      fit.poses.push_back({r(0), r(1), r(2), t(0), t(1), t(2)});
    }
    return adjusted(views, std::move(fit));
  }

  /// From the intrinsics of a fit to other views.
  /// @param estimate_errors whether errors that all corners share are estimated, too
  /// @throws std::runtime_error where the views determine no camera
  CameraFit refit(const std::vector<BoardCorners>& views, const Intrinsics& intrinsics,
                  bool estimate_errors = true) const {
    CameraFit fit{.intrinsics = intrinsics};
    const evmarker::PinholeCamera camera = camera_of(intrinsics, model_, size_);
    for (const BoardCorners& view : views) {
      std::vector<cv::Point3d> on_board;
      std::vector<cv::Point2d> undistorted;
      for (const SeenMarker& seen : view.markers) {
        for (const cv::Point3d& point : detail::object_points(*seen.marker, intrinsics[kPitch]))
          on_board.push_back(point);
        for (const evmarker::Vec2 corner : seen.corners_px) {
          const evmarker::Vec2 m = on_plane(evmarker::Vec3(camera.line_of_sight(corner)));
          undistorted.emplace_back(m.x, m.y);
        }
      }
      cv::Vec3d r, t;
      cv::solvePnP(on_board, undistorted, cv::Matx33d::eye(), cv::noArray(), r, t);
      fit.poses.push_back({r[0], r[1], r[2], t[0], t[1], t[2]});
    }
    return adjusted(views, std::move(fit), estimate_errors);
  }

  evmarker::PinholeCamera camera(const Intrinsics& intrinsics) const { return camera_of(intrinsics, model_, size_); }
  LensModel model() const { return model_; }

 private:
  CameraFit adjusted(const std::vector<BoardCorners>& views, CameraFit fit, bool estimate_errors = true) const {
    constexpr double kHuber_px = 2;  // of the 8 coordinates of a marker together
    ceres::Problem problem;
    fit.errors = CornerErrors::none(views);
    for (std::size_t i = 0; i < views.size(); ++i)
      for (const SeenMarker& seen : views[i].markers)
        problem.AddResidualBlock(new detail::CornerDistances(seen, model_, fit.errors), new ceres::HuberLoss(kHuber_px),
                                 fit.intrinsics.data(), fit.poses[i].data(), fit.errors.px.data());
    // A weak prior, 0 +- 1 px: of speeds that do not occur, the lag stays 0.
    constexpr int kErrors = CornerErrors::kCount;
    problem.AddResidualBlock(
        new ceres::NormalPrior(ceres::Matrix::Identity(kErrors, kErrors), ceres::Vector::Zero(kErrors)), nullptr,
        fit.errors.px.data());
    if (!estimate_errors) problem.SetParameterBlockConstant(fit.errors.px.data());
    if (!free_pitch_)
      problem.SetManifold(fit.intrinsics.data(), new ceres::SubsetManifold(9, {static_cast<int>(kPitch)}));
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-10;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    const Intrinsics& k = fit.intrinsics;
    if (!summary.IsSolutionUsable() || !(k[0] > 0 && k[1] > 0) ||
        !std::ranges::all_of(k, [](double x) { return std::isfinite(x); }))
      throw std::runtime_error("the views of the board determine no camera: move it more, and tilt it");
    double squares = 0, count = 0;
    for (std::size_t i = 0; i < views.size(); ++i)
      for (const SeenMarker& seen : views[i].markers) {
        squares += squared_distance(fit, i, seen);
        count += 8;
      }
    fit.rms_px = std::sqrt(squares / count);
    return fit;
  }

  double squared_distance(const CameraFit& fit, std::size_t view, const SeenMarker& seen) const {
    std::array<double, 8> residuals{};
    const double* const parameters[] = {fit.intrinsics.data(), fit.poses[view].data(), fit.errors.px.data()};
    detail::CornerDistances(seen, model_, fit.errors).Evaluate(parameters, residuals.data(), nullptr);
    double squares = 0;
    for (const double r : residuals) squares += r * r;
    return squares;
  }

  LensModel model_;
  evmarker::SensorSize size_;
  bool free_pitch_;
};
