#pragma once
// Poses in NumPy arrays: the columns of `track_file`'s poses.csv, and the matrices.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <evmarker/io/pose_format.hpp>
#include <evmarker/model/pose_estimate.hpp>
#include <initializer_list>
#include <limits>
#include <string_view>
#include <vector>

namespace python {

namespace py = pybind11;

/// A pose as it lies in an array. Numbers that NumPy names one by one are together here.
struct PoseRow {
  std::int64_t t_us, marker_id, matched;
  std::array<char32_t, 10> state;
  std::array<char32_t, 14> loss_reason;
  std::array<double, 7> pose;              // tx to qw
  std::array<double, 4> quality;           // residual_px to health
  std::array<double, 9> motion;            // vx to sigma_r_deg
  std::array<double, 16> T_camera_marker;  // row by row, as covariance
  std::array<double, 36> covariance;
};

inline py::dtype pose_dtype() {
  py::list names, formats, offsets;
  const auto add = [&](const char* name, const char* format, std::size_t offset) {
    names.append(name);
    formats.append(format);
    offsets.append(offset);
  };
  const auto add_numbers = [&](std::initializer_list<const char*> columns, std::size_t offset) {
    for (const char* name : columns) {
      add(name, "f8", offset);
      offset += sizeof(double);
    }
  };
  add("t_us", "i8", offsetof(PoseRow, t_us));
  add("marker_id", "i8", offsetof(PoseRow, marker_id));
  add("state", "U10", offsetof(PoseRow, state));
  add_numbers({"tx", "ty", "tz", "qx", "qy", "qz", "qw"}, offsetof(PoseRow, pose));
  add("matched", "i8", offsetof(PoseRow, matched));
  add_numbers({"residual_px", "backtrack_px", "backtrack_rad", "health"}, offsetof(PoseRow, quality));
  add("loss_reason", "U14", offsetof(PoseRow, loss_reason));
  add_numbers({"vx", "vy", "vz", "wx", "wy", "wz", "edge_offset_px", "sigma_t_mm", "sigma_r_deg"},
              offsetof(PoseRow, motion));
  add("T_camera_marker", "(4,4)f8", offsetof(PoseRow, T_camera_marker));
  add("covariance", "(6,6)f8", offsetof(PoseRow, covariance));
  return {names, formats, offsets, static_cast<py::ssize_t>(sizeof(PoseRow))};
}

/// A word in NumPy's form: a character in four bytes, zeros behind the last one.
template <std::size_t size>
std::array<char32_t, size> wide_text(std::string_view text) {
  std::array<char32_t, size> wide{};
  std::copy_n(text.begin(), std::min(size, text.size()), wide.begin());
  return wide;
}

inline PoseRow pose_row(const evmarker::PoseEstimate& pose) {
  const evmarker::TrackingQuality& q = pose.quality;
  PoseRow row{.t_us = pose.t,
              .marker_id = pose.id,
              .matched = q.matched,
              .state = wide_text<10>(to_string(q.state)),
              .loss_reason = wide_text<14>(to_string(q.loss_reason)),
              .pose = evmarker::io::pose_numbers(pose.T_camera_marker),
              .quality = {q.residual_px, q.backtrack_px, q.backtrack_rad, q.health},
              .motion = evmarker::io::motion_numbers(pose),
              .T_camera_marker = {},
              .covariance = {}};
  Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(row.T_camera_marker.data()) = pose.T_camera_marker.matrix();
  row.covariance.fill(std::numeric_limits<double>::quiet_NaN());
  if (pose.covariance)
    Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(row.covariance.data()) = *pose.covariance;
  return row;
}

/// @param dtype that of pose_dtype(), which takes NumPy a while to make
inline py::array pose_array(const py::dtype& dtype, const std::vector<PoseRow>& rows) {
  return {dtype, {static_cast<py::ssize_t>(rows.size())}, {}, rows.data()};
}

}  // namespace python
