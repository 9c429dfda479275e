#pragma once
// A camera's intrinsics from views of a flat board, and how well they are known.
#include <ceres/ceres.h>

#include <Eigen/Core>
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

enum class LensModel { radtan, fisheye };

/// fx, fy, cx, cy [px], then k1, k2, p1, p2 (radtan) or k1, k2, k3, k4 (fisheye), then the scale of the distances
/// between the markers of the board, which is 1 unless it is estimated too.
using Intrinsics = std::array<double, 9>;

inline constexpr std::size_t kScale = 8;

inline evmarker::PinholeCamera camera_of(const Intrinsics& k, LensModel model, evmarker::SensorSize size) {
  const evmarker::Distortion lens =
      model == LensModel::fisheye ? evmarker::Distortion(evmarker::EquidistantDistortion{k[4], k[5], k[6], k[7]})
                                  : evmarker::Distortion(evmarker::BrownConradyDistortion{k[4], k[5], k[6], k[7], 0});
  return {size, k[0], k[1], k[2], k[3], lens};
}

namespace detail {

// A marker's corners by OpenCV's projection [px], with the derivatives by the intrinsics and by the board's pose. In
// the image the board's y axis points up; OpenCV's rotation vectors are at their best where it points down.
struct ProjectedMarker {
  Eigen::Matrix<double, 8, 1> px;
  Eigen::Matrix<double, 8, 9> by_intrinsics;
  Eigen::Matrix<double, 8, 6> by_pose;  // rotation vector, translation
};

inline std::vector<cv::Point3d> object_points(const evmarker::BoardMarker& marker, double scale) {
  const evmarker::Vec3 centre = evmarker::translation(marker.T_board_marker);
  std::vector<cv::Point3d> points;
  for (const evmarker::Vec3 corner : corners_of(marker)) {
    const evmarker::Vec3 P = corner + (scale - 1) * centre;
    points.emplace_back(P.x, -P.y, -P.z);
  }
  return points;
}

inline ProjectedMarker project_marker(const evmarker::BoardMarker& marker, const double* k, const double* pose,
                                      LensModel model) {
  const cv::Matx33d K(k[0], 0, k[2], 0, k[1], k[3], 0, 0, 1);
  const cv::Vec4d lens(k[4], k[5], k[6], k[7]);
  const cv::Vec3d r(pose[0], pose[1], pose[2]), t(pose[3], pose[4], pose[5]);
  std::vector<cv::Point2d> pixels;
  cv::Mat J;
  const bool fisheye = model == LensModel::fisheye;
  if (fisheye)
    cv::fisheye::projectPoints(object_points(marker, k[kScale]), pixels, r, t, K, lens, 0, J);
  else
    cv::projectPoints(object_points(marker, k[kScale]), r, t, K, lens, pixels, J);
  // Columns: OpenCV has r, t, f, c, k for pinholes; f, c, k, r, t, skew for fisheyes.
  const int at_f = fisheye ? 0 : 6, at_r = fisheye ? 8 : 0, at_t = at_r + 3;
  cv::Matx33d R;
  cv::Rodrigues(r, R);
  const evmarker::Vec3 centre = evmarker::translation(marker.T_board_marker);
  const cv::Vec3d moved = R * cv::Vec3d(centre.x, -centre.y, -centre.z);  // of the corners, by the scale
  ProjectedMarker projected;
  for (int row = 0; row < 8; ++row) {
    projected.px(row) = row % 2 == 0 ? pixels[std::size_t(row) / 2].x : pixels[std::size_t(row) / 2].y;
    for (int i = 0; i < 8; ++i) projected.by_intrinsics(row, i) = J.at<double>(row, at_f + i);
    projected.by_intrinsics(row, kScale) = 0;
    for (int i = 0; i < 3; ++i) {
      projected.by_pose(row, i) = J.at<double>(row, at_r + i);
      projected.by_pose(row, 3 + i) = J.at<double>(row, at_t + i);
      projected.by_intrinsics(row, kScale) += J.at<double>(row, at_t + i) * moved[i];
    }
  }
  return projected;
}

// The distances of a marker's corners from where they are seen [px].
class CornerDistances : public ceres::SizedCostFunction<8, 9, 6> {
 public:
  CornerDistances(const SeenMarker& seen, LensModel model) : seen_(seen), model_(model) {}

  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override {
    const ProjectedMarker projected = project_marker(*seen_.marker, parameters[0], parameters[1], model_);
    for (int row = 0; row < 8; ++row) {
      const evmarker::Vec2 corner = seen_.corners_px[std::size_t(row) / 2];
      residuals[row] = projected.px(row) - (row % 2 == 0 ? corner.x : corner.y);
    }
    if (jacobians == nullptr) return true;
    const auto give = [](double* to, const auto& J) {
      if (to == nullptr) return;
      for (Eigen::Index row = 0; row < J.rows(); ++row)
        for (Eigen::Index column = 0; column < J.cols(); ++column) *to++ = J(row, column);
    };
    give(jacobians[0], projected.by_intrinsics);
    give(jacobians[1], projected.by_pose);
    return true;
  }

 private:
  SeenMarker seen_;
  LensModel model_;
};

}  // namespace detail

/// The intrinsics with which a flat board explains what is seen of it best, by bundle adjustment over all views.
struct CameraFit {
  Intrinsics intrinsics{};
  std::vector<std::array<double, 6>> poses{};  ///< of the board in each view: rotation vector, translation
  double rms_px = 0;                           ///< of the corners' distances, per coordinate
};

/// Fits from a start: OpenCV's calibration from some views, then all views together, with Huber's weight for each
/// marker.
/// @param views without outliers, at least three of them
/// @param free_pitch whether the scale of the distances between the markers is estimated, too
/// @throws std::runtime_error where the views determine no camera
class CameraFitter {
 public:
  CameraFitter(LensModel model, evmarker::SensorSize size, bool free_pitch)
      : model_(model), size_(size), free_pitch_(free_pitch) {}

  /// From nothing but a focal length.
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
    fit.intrinsics[kScale] = 1;
    if (model_ == LensModel::radtan)
      for (int i = 0; i < 2; ++i) fit.intrinsics[4 + std::size_t(i)] = lens.at<double>(i);
    for (std::size_t i = 0; i < views.size(); ++i) {
      const cv::Mat_<double> r = rotations[i], t = translations[i];
      fit.poses.push_back({r(0), r(1), r(2), t(0), t(1), t(2)});
    }
    return adjusted(views, std::move(fit));
  }

  /// Of other views, with the intrinsics of a fit as the start.
  CameraFit refit(const std::vector<BoardCorners>& views, const Intrinsics& intrinsics) const {
    CameraFit fit{.intrinsics = intrinsics};
    const evmarker::PinholeCamera camera = camera_of(intrinsics, model_, size_);
    for (const BoardCorners& view : views) {
      std::vector<cv::Point3d> on_board;
      std::vector<cv::Point2d> undistorted;
      for (const SeenMarker& seen : view.markers) {
        for (const cv::Point3d& point : detail::object_points(*seen.marker, 1)) on_board.push_back(point);
        for (const evmarker::Vec2 corner : seen.corners_px) {
          const evmarker::Vec2 m = on_plane(evmarker::Vec3(camera.line_of_sight(corner)));
          undistorted.emplace_back(m.x, m.y);
        }
      }
      cv::Vec3d r, t;
      cv::solvePnP(on_board, undistorted, cv::Matx33d::eye(), cv::noArray(), r, t);
      fit.poses.push_back({r[0], r[1], r[2], t[0], t[1], t[2]});
    }
    return adjusted(views, std::move(fit));
  }

  evmarker::PinholeCamera camera(const Intrinsics& intrinsics) const { return camera_of(intrinsics, model_, size_); }
  LensModel model() const { return model_; }

 private:
  CameraFit adjusted(const std::vector<BoardCorners>& views, CameraFit fit) const {
    constexpr double kHuber_px = 2;  // of the 8 coordinates of a marker together
    ceres::Problem problem;
    for (std::size_t i = 0; i < views.size(); ++i)
      for (const SeenMarker& seen : views[i].markers)
        problem.AddResidualBlock(new detail::CornerDistances(seen, model_), new ceres::HuberLoss(kHuber_px),
                                 fit.intrinsics.data(), fit.poses[i].data());
    if (!free_pitch_)
      problem.SetManifold(fit.intrinsics.data(), new ceres::SubsetManifold(9, {static_cast<int>(kScale)}));
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.max_num_iterations = 100;
    options.function_tolerance = 1e-10;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    if (!summary.IsSolutionUsable()) throw std::runtime_error("the views determine no camera: " + summary.message);
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
    const double* const parameters[] = {fit.intrinsics.data(), fit.poses[view].data()};
    detail::CornerDistances(seen, model_).Evaluate(parameters, residuals.data(), nullptr);
    double squares = 0;
    for (const double r : residuals) squares += r * r;
    return squares;
  }

  LensModel model_;
  evmarker::SensorSize size_;
  bool free_pitch_;
};
