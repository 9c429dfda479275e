#pragma once
// Fit of a marker's pose to a frame of last polarities, and comparison of a marker's code with the frame.
#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <optional>

#include "evmarker/base/so3.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"

namespace evmarker::opencv {

/// A pose, and how well the edges of a model agree with a frame there.
struct FrameFit {
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
  double support = 0;          ///< share of the edges' length along which the frame steps from bright to dark
  double cost_px = 0;          ///< root mean square distance of the edges from these steps; missing ones count as 2 px
  int contradicted_edges = 0;  ///< number of edges that lie, for the most part, within areas of one brightness
  double offset_px = 0;        ///< distance of the steps from the edges into the dark areas, which look too small by it
};

namespace detail {

// The frame at a pixel: 1 bright, -1 dark, 0 unknown or outside the frame.
inline double brightness(const cv::Mat& frame, Vec2 pixel) {
  if (!(pixel.x > -0.5 && pixel.y > -0.5 && pixel.x < frame.cols - 0.5 && pixel.y < frame.rows - 0.5)) return 0;
  return (frame.at<uchar>(cvRound(pixel.y), cvRound(pixel.x)) - 128) / 128.0;
}

// Signed distance [px] along the normal from a point to the step that best separates bright pixels before from dark
// ones behind it. Empty unless the right samples outnumber the wrong ones by half of all samples, or if the step is at
// the end of the reach.
inline std::optional<double> find_step(const cv::Mat& frame, Vec2 at, Vec2 normal, double reach_px) {
  constexpr double kStride = 0.5;  // [px]
  const int reach = static_cast<int>(std::lround(reach_px / kStride));
  const auto brightness_at = [&](int i) { return brightness(frame, at + kStride * i * normal); };
  double score = 0;
  for (int i = -reach; i <= reach; ++i) score -= brightness_at(i);
  double best = reach + 0.5;  // least score: half of the 2 reach + 1 samples
  int ties = 0, sum = 0;
  // Here `score` is that of a step before sample i: bright samples before it, dark ones from it on.
  for (int i = -reach; i <= reach; ++i) {
    if (score > best) best = score, ties = sum = 0;
    if (score == best) ++ties, sum += i;
    score += 2 * brightness_at(i);
  }
  if (ties == 0) return std::nullopt;
  const double step = static_cast<double>(sum) / ties - 0.5;
  if (std::abs(step) > reach - 1) return std::nullopt;
  return kStride * step;
}

// True if nearly all pixels that `find_step` would search are bright, or nearly all are dark.
inline bool is_within_area(const cv::Mat& frame, Vec2 at, Vec2 normal, double reach_px) {
  constexpr double kNearlyAll = 0.8;  // share by which the ones outnumber the others
  const int reach = static_cast<int>(std::lround(reach_px));
  double sum = 0;
  for (int i = -reach; i <= reach; ++i) sum += brightness(frame, at + i * normal);
  return std::abs(sum) > kNearlyAll * (2 * reach + 1);
}

using Vector7 = cv::Vec<double, 7>;  // translation [m], rotation [rad], offset [px]
using Matrix77 = cv::Matx<double, 7, 7>;

template <CameraModel Camera>
Vec2 project(const Camera& camera, Vec3 point) {
  return Eigen::Vector2d(camera.project(point));
}

// A point of an edge, with its image and the derivative of that.
struct EdgePoint {
  Vec3 E;       // the point [m, camera frame]
  Vec2 e;       // its image [px]
  Vec2 normal;  // of the edge in the image, toward the dark side
  Vec3 g;       // d(normal . e) / dE [px/m]
};

// Projects a point E of an edge of direction S; all vectors are in the camera frame. Empty if the lens model has no
// image of it.
template <CameraModel Camera>
std::optional<EdgePoint> project_edge(const Camera& camera, Vec3 E, Vec3 S, Vec3 dark_side) {
  const Vec2 e = project(camera, E);
  const double h = 1e-6 * E.z;
  // Numerical derivatives of the image by the point.
  const Vec2 by_x = (project(camera, E + Vec3(h, 0, 0)) - e) / h, by_y = (project(camera, E + Vec3(0, h, 0)) - e) / h,
             by_z = (project(camera, E + Vec3(0, 0, h)) - e) / h;
  const auto image_of = [&](Vec3 v) { return v.x * by_x + v.y * by_y + v.z * by_z; };
  const Vec2 along = image_of(S) / norm(image_of(S));
  Vec2 normal{-along.y, along.x};
  if (dot(normal, image_of(dark_side)) < 0) normal = -1 * normal;
  if (!is_finite(normal) || !is_finite(e)) return std::nullopt;
  return EdgePoint{E, e, normal, {dot(normal, by_x), dot(normal, by_y), dot(normal, by_z)}};
}

// Calls `visit` with points along an edge of a model, 2 px apart in the image. Returns false if the edge is not wholly
// in front of the camera or has no image; it then may have visited some points.
template <CameraModel Camera, typename Visit>
bool for_each_edge_point(const Camera& camera, const MarkerModel& model, const MarkerSegment& edge,
                         const Eigen::Isometry3d& T, Visit&& visit) {
  constexpr double kDistancePx = 2;
  const Vec3 from = transform(T, model.vertices[static_cast<std::size_t>(edge.from)]);
  const Vec3 to = transform(T, model.vertices[static_cast<std::size_t>(edge.to)]);
  const Vec3 dark_side = rotate(T, edge.dark_side);
  if (!(from.z > 0 && to.z > 0)) return false;
  const double length_px = norm(project(camera, to) - project(camera, from));
  if (!(length_px < 1e4)) return false;
  const int count = std::max(1, static_cast<int>(length_px / kDistancePx));
  for (int i = 0; i < count; ++i) {
    const auto point = project_edge(camera, from + (i + 0.5) / count * (to - from), to - from, dark_side);
    if (!point) return false;
    visit(*point);
  }
  return true;
}

// Sums over the points of all edges: squared distances from their steps, and the normal equations of the fit.
class EdgeResiduals {
 public:
  // Adds a point without a step.
  void add_missing() { ++points_; }

  void add_contradicted_edge() { ++contradicted_edges_; }

  // Adds a point at a signed distance from its step. `origin` is the marker's centre [m, camera frame].
  void add(const EdgePoint& point, Vec3 origin, double distance_px) {
    constexpr double kHuberPx = 1;
    const Vec3 g = point.g, turning = cross(point.E - origin, g);
    const double J[7] = {g.x, g.y, g.z, turning.x, turning.y, turning.z, 1};
    const double weight = kHuberPx / std::max(kHuberPx, std::abs(distance_px));
    for (int k = 0; k < 7; ++k) {
      for (int i = 0; i < 7; ++i) H_(i, k) += weight * J[i] * J[k];
      b_(k) += weight * distance_px * J[k];
    }
    squares_ += std::min(distance_px * distance_px, kMissingPx * kMissingPx);
    ++points_;
    ++found_;
  }

  int points() const { return points_; }
  int found() const { return found_; }
  int contradicted_edges() const { return contradicted_edges_; }
  double support() const { return static_cast<double>(found_) / points_; }
  double cost_px() const { return std::sqrt((squares_ + kMissingPx * kMissingPx * (points_ - found_)) / points_); }

  // The Gauss-Newton step, damped after scaling that makes translation, rotation and offset comparable.
  Vector7 step(double offset_px) const {
    // A weak prior keeps the offset near 0 where only an outline is seen: there it cannot be separated from the depth.
    constexpr double kOffsetWeight = 10, kDamping = 1e-4;
    Matrix77 H = H_;
    Vector7 b = b_;
    H(6, 6) += kOffsetWeight;
    b(6) -= kOffsetWeight * offset_px;
    double scale[7];
    for (int i = 0; i < 7; ++i) {
      scale[i] = 1 / std::sqrt(std::max(H(i, i), 1e-9));
      b(i) *= scale[i];
    }
    for (int k = 0; k < 7; ++k) {
      for (int i = 0; i < 7; ++i) H(i, k) = scale[i] * H(i, k) * scale[k];
      H(k, k) += kDamping;
    }
    Vector7 step = H.solve(b, cv::DECOMP_CHOLESKY);
    for (int i = 0; i < 7; ++i) step(i) *= scale[i];
    return step;
  }

  // Weighted root mean square motion of the edges by a step [px].
  double moved_px(const Vector7& step) const {
    double squares = 0;
    for (int k = 0; k < 7; ++k)
      for (int i = 0; i < 7; ++i) squares += step(i) * H_(i, k) * step(k);
    return std::sqrt(squares / found_);
  }

 private:
  static constexpr double kMissingPx = 2;

  Matrix77 H_;
  Vector7 b_;
  double squares_ = 0;
  int points_ = 0, found_ = 0, contradicted_edges_ = 0;
};

// Searches the steps of all edges at a pose and an offset. Empty if not all of the model has an image.
template <CameraModel Camera>
std::optional<EdgeResiduals> compare(const Camera& camera, const cv::Mat& frame, const MarkerModel& model,
                                     const FrameFit& fit, double reach_px) {
  EdgeResiduals residuals;
  const Eigen::Isometry3d& T = fit.T_camera_marker;
  for (const MarkerSegment& edge : model.segments) {
    int points = 0, within_area = 0;
    const bool seen = for_each_edge_point(camera, model, edge, T, [&](const EdgePoint& point) {
      ++points;
      if (const auto step = find_step(frame, point.e, point.normal, reach_px)) {
        residuals.add(point, translation(T), *step - fit.offset_px);
      } else {
        residuals.add_missing();
        within_area += is_within_area(frame, point.e, point.normal, reach_px);
      }
    });
    if (!seen) return std::nullopt;
    if (2 * within_area > points) residuals.add_contradicted_edge();
  }
  if (residuals.points() == 0) return std::nullopt;
  return residuals;
}

}  // namespace detail

/// Fits a pose so that the model's edges lie on the steps from bright to dark in a frame: Gauss-Newton with Huber
/// weights over the pose and one offset. By this offset all dark areas look too small, because pixels that sense the
/// logarithm of light fire on the dark side of a blurred edge.
/// @param frame 8 bit: 0 dark, 255 bright, 128 unknown
/// @param T_camera_marker pose to start from
/// @param reach_px distance to each side of an edge within which its step is searched
/// @return the fit, which ends early, possibly at the first pose, where the frame shows hardly a step (see `support`);
/// empty if the model is not in front of the camera, the lens model has no image of it, or a step is not finite
template <CameraModel Camera>
std::optional<FrameFit> fit_to_frame(const Camera& camera, const cv::Mat& frame, const MarkerModel& model,
                                     const Eigen::Isometry3d& T_camera_marker, double reach_px, int iterations = 10) {
  constexpr int kFewestSteps = 12;
  constexpr double kConverged_px = 0.02;
  FrameFit fit{.T_camera_marker = T_camera_marker};
  for (int iteration = 0;; ++iteration) {
    const auto residuals = detail::compare(camera, frame, model, fit, reach_px);
    if (!residuals) return std::nullopt;
    fit.support = residuals->support();
    fit.cost_px = residuals->cost_px();
    fit.contradicted_edges = residuals->contradicted_edges();
    if (iteration >= iterations || residuals->found() < kFewestSteps) return fit;

    const detail::Vector7 dx = residuals->step(fit.offset_px);
    const Vec6 step{{dx(0), dx(1), dx(2)}, {dx(3), dx(4), dx(5)}};
    if (!is_finite(step) || !std::isfinite(dx(6))) return std::nullopt;
    if (residuals->moved_px(dx) < kConverged_px) return fit;
    set_translation(fit.T_camera_marker, translation(fit.T_camera_marker) + step.t);
    turn(fit.T_camera_marker, step.r);
    orthonormalize(fit.T_camera_marker);
    fit.offset_px += dx(6);
  }
}

/// How well a frame agrees with a marker's code at a pose.
struct CodeReading {
  double agreement = 0;  ///< share of the samples, border included, that are black or white as in the code
  int contradicted = 0;  ///< number of cells with more wrong than right samples
};

/// Compares samples from the middle of every cell of a code marker with its code. Unknown pixels are neither right nor
/// wrong.
/// @param frame 8 bit: 0 dark, 255 bright, 128 unknown
/// @param length side of the black square [m]
template <CameraModel Camera>
CodeReading read_code(const Camera& camera, const cv::Mat& frame, const CodeBits& bits, double length,
                      const Eigen::Isometry3d& T_camera_marker) {
  constexpr int kSide = 5, kSamples = kSide * kSide;
  const int cells = static_cast<int>(bits.rows()) + 2;
  const double cell = length / cells;
  CodeReading reading;
  int agreeing = 0;
  for (int row = 0; row < cells; ++row)
    for (int column = 0; column < cells; ++column) {
      const bool border = row == 0 || column == 0 || row == cells - 1 || column == cells - 1;
      const bool white = !border && bits(row - 1, column - 1) != 0;
      int right = 0, wrong = 0;
      for (int i = 0; i < kSide; ++i)
        for (int j = 0; j < kSide; ++j) {
          const double u = 0.2 + 0.6 * (i + 0.5) / kSide, v = 0.2 + 0.6 * (j + 0.5) / kSide;
          const Vec3 point((column + u) * cell - length / 2, length / 2 - (row + v) * cell, 0);
          const Vec3 P = transform(T_camera_marker, point);
          const double seen = P.z > 0 ? detail::brightness(frame, detail::project(camera, P)) : 0;
          right += white ? seen > 0.5 : seen < -0.5;
          wrong += white ? seen < -0.5 : seen > 0.5;
        }
      agreeing += right;
      reading.contradicted += wrong > right;
    }
  reading.agreement = agreeing / static_cast<double>(cells * cells * kSamples);
  return reading;
}

}  // namespace evmarker::opencv
