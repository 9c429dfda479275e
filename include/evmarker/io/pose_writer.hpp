#pragma once
// Writes poses: a table of all markers (CSV), or the trajectory of one (TUM).
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "evmarker/io/output_file.hpp"
#include "evmarker/io/pose_format.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::io {

namespace detail {

/// Text that is gathered to larger pieces on its way into a file.
class TextFile {
 public:
  explicit TextFile(std::filesystem::path path) : file_(std::move(path)) {}

  std::string& text() noexcept { return text_; }
  void end_line() {
    text_ += '\n';
    ++lines_;
    if (text_.size() >= kFlushBytes) flush();
  }
  void close() {
    if (!file_.is_open()) return;
    flush();
    file_.close();
  }
  std::uint64_t lines() const noexcept { return lines_; }

 private:
  static constexpr std::size_t kFlushBytes = std::size_t{1} << 16;

  void flush() {
    file_.write(text_);
    text_.clear();
  }

  OutputFile file_;
  std::string text_;
  std::uint64_t lines_ = 0;
};

}  // namespace detail

/// Which columns a pose table has: those of every rule, or kPoseCsvMotionHeader's too.
enum class PoseColumns { pose, pose_and_motion };

/// Writes a header and a row for each pose; numbers read back exactly, NaN is `nan`. The file appears under its name in
/// `close()`; a writer that is destroyed before leaves nothing.
class PoseCsvWriter {
 public:
  /// @throws RecordingError where the file cannot be created
  explicit PoseCsvWriter(std::filesystem::path path, PoseColumns columns = PoseColumns::pose)
      : file_(std::move(path)), columns_(columns) {
    file_.text() = kPoseCsvHeader;
    if (columns == PoseColumns::pose_and_motion) file_.text() += kPoseCsvMotionHeader;
    file_.text() += '\n';
  }

  /// @throws RecordingError where the disk is full
  void write(const PoseEstimate& pose) {
    std::string& text = file_.text();
    text += std::to_string(pose.t) + ',' + std::to_string(pose.id) + ',' + to_string(pose.quality.state) + ',';
    append_pose(text, pose.T_camera_marker, ',');
    text += ',' + std::to_string(pose.quality.matched);
    const TrackingQuality& q = pose.quality;
    for (const double value : {q.residual_px, q.backtrack_px, q.backtrack_rad, q.health}) {
      text += ',';
      append_number(text, value);
    }
    text += ',';
    text += to_string(q.loss_reason);
    if (columns_ == PoseColumns::pose_and_motion) append_motion(text, pose);
    file_.end_line();
  }

  /// Completes the file. Calling it again does nothing. @throws RecordingError where the disk is full
  void close() { file_.close(); }
  std::uint64_t poses_written() const noexcept { return file_.lines(); }

 private:
  static void append_motion(std::string& text, const PoseEstimate& pose) {
    constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
    const Vector6d twist = pose.twist.value_or(Vector6d::Constant(kUnknown));
    const Matrix6d P = pose.covariance.value_or(Matrix6d::Constant(kUnknown));
    const auto append = [&](double value) {
      text += ',';
      append_number(text, value);
    };
    for (const double rate : twist) append(rate);
    append(pose.edge_offset_px.value_or(kUnknown));
    append(1e3 * std::sqrt(P.topLeftCorner<3, 3>().trace()));
    append(180 / std::numbers::pi * std::sqrt(P.bottomRightCorner<3, 3>().trace()));
  }

  detail::TextFile file_;
  PoseColumns columns_;
};

/// Writes the trajectory of one marker, a line `t tx ty tz qx qy qz qw` for each pose, t in seconds exact to the
/// microsecond. Which states are worth writing is the caller's choice. The file appears under its name in `close()`.
class TumWriter {
 public:
  /// @throws RecordingError where the file cannot be created
  explicit TumWriter(std::filesystem::path path) : file_(std::move(path)) {}

  /// @throws RecordingError where the disk is full
  void write(Timestamp t, const Eigen::Isometry3d& T_camera_marker) {
    append_seconds(file_.text(), t);
    file_.text() += ' ';
    append_pose(file_.text(), T_camera_marker, ' ');
    file_.end_line();
  }

  /// @throws std::invalid_argument where the pose is of another marker than those before
  void write(const PoseEstimate& pose) {
    if (id_.value_or(pose.id) != pose.id)
      throw std::invalid_argument("TUM: marker_id is " + std::to_string(pose.id) + ", but the file is of marker " +
                                  std::to_string(*id_));
    id_ = pose.id;
    write(pose.t, pose.T_camera_marker);
  }

  /// Completes the file. Calling it again does nothing. @throws RecordingError where the disk is full
  void close() { file_.close(); }
  std::uint64_t poses_written() const noexcept { return file_.lines(); }

 private:
  detail::TextFile file_;
  std::optional<MarkerId> id_;
};

}  // namespace evmarker::io
