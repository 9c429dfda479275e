#pragma once
// The columns of poses, and how they are written as text.
#include <Eigen/Geometry>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <numbers>
#include <string>
#include <string_view>

#include "evmarker/events/event.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::io {

/// What the poses in a file are, unless it says otherwise: a table in its column `transform`, TUM in a line `# T_a_b`.
inline constexpr std::string_view kPoseTransform = "T_camera_marker";

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

/// `tx ty tz qx qy qz qw` of a pose, with a quaternion of length 1 and qw >= 0.
inline std::array<double, 7> pose_numbers(const Eigen::Isometry3d& pose) {
  Eigen::Quaterniond q(pose.linear());
  q.normalize();
  if (q.w() < 0) q.coeffs() = -q.coeffs();
  const Eigen::Vector3d& p = pose.translation();
  return {p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()};
}

/// The numbers of kPoseCsvMotionHeader; NaN where the rule does not estimate them.
inline std::array<double, 9> motion_numbers(const PoseEstimate& pose) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  const Vector6d twist = pose.twist.value_or(Vector6d::Constant(kUnknown));
  const Matrix6d P = pose.covariance.value_or(Matrix6d::Constant(kUnknown));
  return {twist[0],
          twist[1],
          twist[2],
          twist[3],
          twist[4],
          twist[5],
          pose.edge_offset_px.value_or(kUnknown),
          1e3 * std::sqrt(P.topLeftCorner<3, 3>().trace()),
          180 / std::numbers::pi * std::sqrt(P.bottomRightCorner<3, 3>().trace())};
}

/// Appends `tx ty tz qx qy qz qw`.
inline void append_pose(std::string& text, const Eigen::Isometry3d& pose, char separator) {
  const std::array values = pose_numbers(pose);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (i > 0) text += separator;
    append_number(text, values[i]);
  }
}

}  // namespace evmarker::io
