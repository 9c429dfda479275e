#pragma once
// Camera models: projection of points to pixels, and lines of sight of pixels.
#include <Eigen/Core>
#include <array>
#include <cmath>
#include <concepts>
#include <initializer_list>
#include <limits>
#include <numbers>
#include <utility>
#include <variant>

#include "evmarker/base/require.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// A calibrated camera. Its frame has x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel.
template <typename C>
concept CameraModel = requires(const C& camera, const Eigen::Vector3d& point, const Eigen::Vector2d& pixel) {
  { camera.sensor_size() } -> std::same_as<SensorSize>;
  /// Focal length [px]: pixels per unit of tangent near the optical axis.
  { camera.focal_length() } -> std::convertible_to<double>;
  /// Distorted pixel of a point [m, camera frame] in front of the camera.
  { camera.project(point) } -> std::convertible_to<Eigen::Vector2d>;
  /// Line of sight M of a distorted pixel, with z = 1, Eq. (2); NaN where the lens model has no inverse.
  { camera.line_of_sight(pixel) } -> std::convertible_to<Eigen::Vector3d>;
};

/// No lens distortion.
struct NoDistortion {
  /// Distorted point of an undistorted one, both on the plane z = 1; so in the other models.
  Vec2 distort(Vec2 m) const noexcept { return m; }
};

/// OpenCV's radial-tangential model with `k1 k2 p1 p2 k3`.
struct BrownConradyDistortion {
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;

  Vec2 distort(Vec2 m) const noexcept {
    const auto [x, y] = m;
    const double r2 = squared_norm(m), radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
    return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  }
};

/// OpenCV's and Kalibr's fisheye model with `k1 k2 k3 k4`.
struct EquidistantDistortion {
  double k1 = 0, k2 = 0, k3 = 0, k4 = 0;

  Vec2 distort(Vec2 m) const noexcept {
    const double r = norm(m);
    if (r < 1e-12) return m;
    const double theta = std::atan(r), t2 = theta * theta;
    return theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))) / r * m;
  }
};

using Distortion = std::variant<NoDistortion, BrownConradyDistortion, EquidistantDistortion>;

/// A pinhole camera behind a lens: `u = K distort(X/Z, Y/Z)`.
class PinholeCamera {
 public:
  /// @param size sensor size [px]
  /// @param fx,fy focal lengths [px]
  /// @param cx,cy principal point [px]
  /// @throws std::invalid_argument naming the parameter that is not finite, or not positive where it must be
  PinholeCamera(SensorSize size, double fx, double fy, double cx, double cy, Distortion distortion = {})
      : size_(size), fx_(fx), fy_(fy), cx_(cx), cy_(cy), distortion_(distortion) {
    const Require require("camera");
    require(size.width > 0, "image width", size.width);
    require(size.height > 0, "image height", size.height);
    require.positive(fx, "fx");
    require.positive(fy, "fy");
    require(std::isfinite(cx), "cx", cx);
    require(std::isfinite(cy), "cy", cy);
    using Coefficients = std::initializer_list<std::pair<const char*, double>>;
    const auto require_finite = [&](Coefficients coefficients) {
      for (const auto& [name, value] : coefficients) require(std::isfinite(value), name, value);
    };
    if (const auto* d = std::get_if<BrownConradyDistortion>(&distortion_))
      require_finite({{"k1", d->k1}, {"k2", d->k2}, {"p1", d->p1}, {"p2", d->p2}, {"k3", d->k3}});
    if (const auto* d = std::get_if<EquidistantDistortion>(&distortion_))
      require_finite({{"k1", d->k1}, {"k2", d->k2}, {"k3", d->k3}, {"k4", d->k4}});
    fold_ = fold_radius();
  }

  SensorSize sensor_size() const noexcept { return size_; }
  /// Geometric mean of fx and fy [px].
  double focal_length() const noexcept { return std::sqrt(fx_ * fy_); }
  double fx() const noexcept { return fx_; }
  double fy() const noexcept { return fy_; }
  double cx() const noexcept { return cx_; }
  double cy() const noexcept { return cy_; }
  const Distortion& distortion() const noexcept { return distortion_; }

  Eigen::Vector2d project(const Eigen::Vector3d& point) const noexcept {
    const Vec2 m = distort(on_plane(point));
    return {fx_ * m.x + cx_, fy_ * m.y + cy_};
  }

  Eigen::Vector3d line_of_sight(const Eigen::Vector2d& pixel) const noexcept {
    const Vec2 m = undistort({(pixel.x() - cx_) / fx_, (pixel.y() - cy_) / fy_});
    return {m.x, m.y, 1};
  }

 private:
  Vec2 distort(Vec2 m) const noexcept {
    return std::visit([&](const auto& d) { return d.distort(m); }, distortion_);
  }

  // Tangent of the angle from the optical axis at which the radial distortion stops growing; infinite if it never does.
  // Beyond it the polynomial maps rays to pixels that other rays have already: solutions found there would be wrong.
  double fold_radius() const noexcept {
    Distortion radial = distortion_;
    if (auto* d = std::get_if<BrownConradyDistortion>(&radial)) d->p1 = d->p2 = 0;
    double fold = 0, outermost = 0;
    for (double angle = 1e-3; angle < std::numbers::pi / 2; angle += 1e-3) {
      const double r = std::tan(angle);
      const double image = std::visit([&](const auto& d) { return d.distort({r, 0}).x; }, radial);
      if (!(image > outermost)) return fold;
      fold = r;
      outermost = image;
    }
    return std::numeric_limits<double>::infinity();
  }

  // Inverts `distort` by Newton's method with a numerical Jacobian, its steps limited so that strong distortion
  // converges too. NaN where there is no inverse within the fold.
  Vec2 undistort(Vec2 distorted) const noexcept {
    if (std::holds_alternative<NoDistortion>(distortion_)) return distorted;
    constexpr double kStep = 1e-6, kTolerance = 1e-12, kNone = std::numeric_limits<double>::quiet_NaN();
    Vec2 m = distorted;
    if (norm(m) > 0.9 * fold_) m = 0.9 * fold_ / norm(m) * m;
    for (int iteration = 0; iteration < 50; ++iteration) {
      const Vec2 error = distorted - distort(m);
      if (norm(error) < kTolerance) break;
      const Vec2 by_x = (distort(m + Vec2(kStep, 0)) - distort(m - Vec2(kStep, 0))) / (2 * kStep);
      const Vec2 by_y = (distort(m + Vec2(0, kStep)) - distort(m - Vec2(0, kStep))) / (2 * kStep);
      const double determinant = by_x.x * by_y.y - by_x.y * by_y.x;
      if (!(determinant > 1e-6)) break;  // beyond the fold of the lens model
      const double inverse = 1 / determinant;
      Vec2 step = {by_y.y * inverse * error.x - by_y.x * inverse * error.y,
                   by_x.x * inverse * error.y - by_x.y * inverse * error.x};
      const double limit = 0.5 * (1 + norm(m));
      if (norm(step) > limit) step = limit / norm(step) * step;
      m = m + step;
    }
    return norm(distorted - distort(m)) < 1e-9 && norm(m) <= fold_ ? m : Vec2{kNone, kNone};
  }

  SensorSize size_;
  double fx_, fy_, cx_, cy_;
  Distortion distortion_;
  double fold_ = 0;  // [tangent], see fold_radius
};

}  // namespace evmarker
