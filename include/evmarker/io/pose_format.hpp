#pragma once
// Text format of poses: columns, numbers, times.
#include <Eigen/Geometry>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "evmarker/events/event.hpp"

namespace evmarker::io {

/// First line of a pose table. Position [m] and unit quaternion are those of `T_camera_marker`.
inline constexpr std::string_view kPoseCsvHeader =
    "t_us,marker_id,state,tx,ty,tz,qx,qy,qz,qw,matched,residual_px,backtrack_px,backtrack_rad,health,loss_reason";

/// Columns added for a rule that estimates velocity and covariance: twist [m/s; rad/s], edge offset, and the standard
/// deviations of position and rotation (the root of the trace of each covariance).
inline constexpr std::string_view kPoseCsvMotionHeader = ",vx,vy,vz,wx,wy,wz,edge_offset_px,sigma_t_mm,sigma_r_deg";

/// Appends the shortest text that reads back as the same number; every NaN is `nan`.
inline void append_number(std::string& text, double value) {
  if (std::isnan(value)) {
    text += "nan";
    return;
  }
  std::array<char, 32> digits{};
  text.append(digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr);
}

/// Appends a time [us] in seconds with six decimal places, exactly.
inline void append_seconds(std::string& text, Timestamp t) {
  const std::uint64_t magnitude = t < 0 ? ~static_cast<std::uint64_t>(t) + 1 : static_cast<std::uint64_t>(t);
  const std::string fraction = std::to_string(magnitude % 1000000);
  if (t < 0) text += '-';
  text += std::to_string(magnitude / 1000000) + '.' + std::string(6 - fraction.size(), '0') + fraction;
}

/// Appends `tx ty tz qx qy qz qw`, with qw >= 0.
inline void append_pose(std::string& text, const Eigen::Isometry3d& pose, char separator) {
  Eigen::Quaterniond q(pose.linear());
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d& p = pose.translation();
  const std::array values{p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()};
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (i > 0) text += separator;
    append_number(text, values[i]);
  }
}

}  // namespace evmarker::io
