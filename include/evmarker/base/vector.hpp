#pragma once
// Small vectors for computations, and how rigid motions transform them.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <cstddef>

namespace evmarker {

// Public interfaces use Eigen types, computations use these. Each Eigen expression is a type of its own that has to be
// compiled, and a dozen calls without optimisation. Plain numbers compile ten times faster, and the compiler vectorises
// loops over them.

struct Vec2 {
  double x = 0, y = 0;

  constexpr Vec2() noexcept = default;
  constexpr Vec2(double x_, double y_) noexcept : x(x_), y(y_) {}
  Vec2(const Eigen::Vector2d& v) noexcept : x(v.x()), y(v.y()) {}
  template <typename Derived>
  Vec2(const Eigen::MatrixBase<Derived>& v) : Vec2(Eigen::Vector2d(v)) {}
  operator Eigen::Vector2d() const noexcept { return {x, y}; }
  friend constexpr bool operator==(const Vec2&, const Vec2&) = default;
};

struct Vec3 {
  double x = 0, y = 0, z = 0;

  constexpr Vec3() noexcept = default;
  constexpr Vec3(double x_, double y_, double z_) noexcept : x(x_), y(y_), z(z_) {}
  Vec3(const Eigen::Vector3d& v) noexcept : x(v.x()), y(v.y()), z(v.z()) {}
  template <typename Derived>
  Vec3(const Eigen::MatrixBase<Derived>& v) : Vec3(Eigen::Vector3d(v)) {}
  operator Eigen::Vector3d() const noexcept { return {x, y, z}; }
  friend constexpr bool operator==(const Vec3&, const Vec3&) = default;
};

constexpr Vec2 operator+(Vec2 a, Vec2 b) noexcept { return {a.x + b.x, a.y + b.y}; }
constexpr Vec2 operator-(Vec2 a, Vec2 b) noexcept { return {a.x - b.x, a.y - b.y}; }
constexpr Vec2 operator*(double s, Vec2 a) noexcept { return {s * a.x, s * a.y}; }
constexpr Vec2 operator/(Vec2 a, double s) noexcept { return {a.x / s, a.y / s}; }
constexpr double dot(Vec2 a, Vec2 b) noexcept { return a.x * b.x + a.y * b.y; }
constexpr double squared_norm(Vec2 a) noexcept { return dot(a, a); }
inline double norm(Vec2 a) noexcept { return std::sqrt(squared_norm(a)); }

constexpr Vec3 operator+(Vec3 a, Vec3 b) noexcept { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
constexpr Vec3 operator-(Vec3 a, Vec3 b) noexcept { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
constexpr Vec3 operator*(double s, Vec3 a) noexcept { return {s * a.x, s * a.y, s * a.z}; }
constexpr Vec3 operator/(Vec3 a, double s) noexcept { return {a.x / s, a.y / s, a.z / s}; }
constexpr double dot(Vec3 a, Vec3 b) noexcept { return a.x * b.x + a.y * b.y + a.z * b.z; }
constexpr double squared_norm(Vec3 a) noexcept { return dot(a, a); }
inline double norm(Vec3 a) noexcept { return std::sqrt(squared_norm(a)); }
constexpr Vec3 cross(Vec3 a, Vec3 b) noexcept {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// A small motion: translation t [m] and rotation r [rad] about the origin of what moves; or its rate [m/s; rad/s].
struct Vec6 {
  Vec3 t, r;

  constexpr Vec6() noexcept = default;
  constexpr Vec6(Vec3 t_, Vec3 r_) noexcept : t(t_), r(r_) {}
  constexpr Vec6(const std::array<double, 6>& v) noexcept : t(v[0], v[1], v[2]), r(v[3], v[4], v[5]) {}
  Vec6(const Eigen::Matrix<double, 6, 1>& v) noexcept : t(v(0), v(1), v(2)), r(v(3), v(4), v(5)) {}
  constexpr std::array<double, 6> array() const noexcept { return {t.x, t.y, t.z, r.x, r.y, r.z}; }
  operator Eigen::Matrix<double, 6, 1>() const noexcept {
    Eigen::Matrix<double, 6, 1> v;
    for (std::size_t i = 0; i < 6; ++i) v.data()[i] = array()[i];
    return v;
  }
};

constexpr Vec6 operator+(const Vec6& a, const Vec6& b) noexcept { return {a.t + b.t, a.r + b.r}; }
constexpr Vec6 operator-(const Vec6& a, const Vec6& b) noexcept { return {a.t - b.t, a.r - b.r}; }
constexpr Vec6 operator*(double s, const Vec6& a) noexcept { return {s * a.t, s * a.r}; }
/// Element by element.
constexpr Vec6 scaled(const std::array<double, 6>& s, const Vec6& a) noexcept {
  return {{s[0] * a.t.x, s[1] * a.t.y, s[2] * a.t.z}, {s[3] * a.r.x, s[4] * a.r.y, s[5] * a.r.z}};
}
/// The matrix product `A * a`.
inline Vec6 product(const Eigen::Matrix<double, 6, 6>& A, const Vec6& a) noexcept {
  std::array<double, 6> b{};
  for (std::size_t k = 0; k < 6; ++k)
    for (std::size_t i = 0; i < 6; ++i) b[i] += A.data()[6 * k + i] * a.array()[k];
  return b;
}
constexpr double squared_norm(const Vec6& a) noexcept { return squared_norm(a.t) + squared_norm(a.r); }

inline bool is_finite(Vec2 a) noexcept { return std::isfinite(a.x) && std::isfinite(a.y); }
inline bool is_finite(Vec3 a) noexcept { return std::isfinite(a.x) && std::isfinite(a.y) && std::isfinite(a.z); }

inline bool is_finite(const Vec6& a) noexcept { return is_finite(a.t) && is_finite(a.r); }
inline bool is_finite(const Eigen::Isometry3d& T) noexcept {
  for (int i = 0; i < 16; ++i)
    if (!std::isfinite(T.data()[i])) return false;
  return true;
}

inline Vec3 translation(const Eigen::Isometry3d& T) noexcept { return {T(0, 3), T(1, 3), T(2, 3)}; }
inline void set_translation(Eigen::Isometry3d& T, Vec3 t) noexcept {
  T(0, 3) = t.x;
  T(1, 3) = t.y;
  T(2, 3) = t.z;
}
/// Axis `i` of the frame that T maps from, as a vector in the frame that T maps to: column `i` of the rotation.
inline Vec3 axis(const Eigen::Isometry3d& T, Eigen::Index i) noexcept { return {T(0, i), T(1, i), T(2, i)}; }

inline void set_axis(Eigen::Isometry3d& T, Eigen::Index i, Vec3 v) noexcept {
  T(0, i) = v.x;
  T(1, i) = v.y;
  T(2, i) = v.z;
}

/// Transforms a direction: `T.linear() * v`.
inline Vec3 rotate(const Eigen::Isometry3d& T, Vec3 v) noexcept {
  return {T(0, 0) * v.x + T(0, 1) * v.y + T(0, 2) * v.z, T(1, 0) * v.x + T(1, 1) * v.y + T(1, 2) * v.z,
          T(2, 0) * v.x + T(2, 1) * v.y + T(2, 2) * v.z};
}
/// Transforms a point: `T * p`.
inline Vec3 transform(const Eigen::Isometry3d& T, Vec3 p) noexcept { return rotate(T, p) + translation(T); }

}  // namespace evmarker
