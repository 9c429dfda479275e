#pragma once
// An event and an edge: their distance in the image, Eq. (1), and their nearest points in space, Eqs. (3) to (5).
#include <cmath>
#include <limits>

#include "evmarker/base/vector.hpp"
#include "evmarker/simd/lanes.hpp"

namespace evmarker {

/// Eq. (1): how far a point m of the image is from the image of an edge, in the units of m, positive along the normal.
/// @param line (n; c), the points of the image with n m + c = 0, |n| = 1
[[gnu::always_inline]] constexpr double line_distance(Vec3 line, Vec2 m) noexcept {
  return line.x * m.x + line.y * m.y + line.z;
}

/// The point E of an edge and the point F of a line of sight that are nearest to each other, camera frame [m].
struct ClosestPoints {
  Vec3 E, F;
  bool valid = false;  ///< false if the edge is nearly parallel to the line of sight: Eq. (5) is singular
  double from_end;     ///< a2 of E from the edge's nearer end
};

/// Eqs. (3) to (5): E = V + a2 S on the edge, F = a1 M on the line of sight, E - F perpendicular to both.
/// @param begin,end the edge's range of a2; where a2 is clamped to it, E - F is perpendicular to M only
// Eq. (5) solved for a1 and a2. V is the vertex where S begins, a2 = 0; the paper prints V_j.
[[gnu::always_inline]] inline ClosestPoints closest_points(Vec3 V, Vec3 S, double begin, double end, Vec3 M) noexcept {
  const double MM = dot(M, M), MS = dot(M, S), SS = dot(S, S), MV = dot(M, V), SV = dot(S, V);
  const double determinant = MM * SS - MS * MS;
  // std::clamp without branches; a NaN becomes a bound.
  const double a2 = simd::smaller(simd::larger((MS * MV - MM * SV) / determinant, begin), end);
  const double a1 = (MV + a2 * MS) / MM;  // first row of Eq. (5): F is nearest to E also for a clamped a2
  return {V + a2 * S, a1 * M, determinant > 1e-6 * MM * SS, simd::smaller(a2 - begin, end - a2)};
}

/// How far the image of E is from that of the edge's nearer end, squared [px^2]; infinite in the middle half of an
/// edge.
/// @param S,begin,end as for `closest_points`
[[gnu::always_inline]] inline double from_end_px2(const ClosestPoints& points, Vec3 S, double begin, double end,
                                                  double focal_length) noexcept {
  const Vec3 E = points.E;
  const double by_z = 1 / E.z, x = by_z * E.x, y = by_z * E.y, way = focal_length * by_z * points.from_end;
  const double along_x = way * (S.x - x * S.z), along_y = way * (S.y - y * S.z);
  // Without a branch, which would keep the loop over a batch from being vectorised.
  const double most = std::copysign(std::numeric_limits<double>::infinity(), 4 * points.from_end - (end - begin));
  return simd::larger(along_x * along_x + along_y * along_y, most);
}

}  // namespace evmarker
