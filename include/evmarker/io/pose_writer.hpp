#pragma once
// Writes poses: a table of many markers (CSV), or the trajectory of one marker (TUM).
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "evmarker/io/output_file.hpp"
#include "evmarker/io/pose_format.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::io {

/// Columns of a pose table: those of kPoseCsvHeader, or those of kPoseCsvMotionHeader too.
enum class PoseColumns { pose, pose_and_motion };

/// Writes a header and a row for each pose; numbers read back exactly, NaN is `nan`. The file appears under its name in
/// `close()`; a writer that is destroyed before that leaves no file.
class PoseCsvWriter {
 public:
  /// @param transform what the poses are, as `T_marker_camera`: if not kPoseTransform, a last column says so
  /// @throws RecordingError where the file cannot be created
  explicit PoseCsvWriter(std::filesystem::path path, PoseColumns columns = PoseColumns::pose,
                         const std::string& transform = std::string(kPoseTransform))
      : output_(std::move(path)), columns_(columns), end_(transform == kPoseTransform ? "\n" : ',' + transform + '\n') {
    std::string& text = output_.buffer();
    text = kPoseCsvHeader;
    if (columns == PoseColumns::pose_and_motion) text += kPoseCsvMotionHeader;
    if (transform != kPoseTransform) text += ",transform";
    text += '\n';
  }

  /// @throws RecordingError where the disk is full
  void write(const PoseEstimate& pose) {
    std::string& text = output_.buffer();
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
    if (columns_ == PoseColumns::pose_and_motion)
      for (const double value : motion_numbers(pose)) {
        text += ',';
        append_number(text, value);
      }
    text += end_;
    ++poses_written_;
    output_.flush_if_large();
  }

  /// Completes the file; calling it again does nothing.
  /// @throws RecordingError where the disk is full
  void close() { output_.close(); }
  std::uint64_t poses_written() const noexcept { return poses_written_; }

 private:
  BufferedOutput<std::string> output_;
  PoseColumns columns_;
  std::string end_;  // of each row
  std::uint64_t poses_written_ = 0;
};

/// Writes the trajectory of one marker: for each pose a line `t tx ty tz qx qy qz qw`, t in seconds exact to the
/// microsecond, whatever the state of the track. The file appears under its name in `close()`.
class TumWriter {
 public:
  /// @param transform what the poses are, as `T_marker_camera`: if not kPoseTransform, a comment says so
  /// @throws RecordingError where the file cannot be created
  explicit TumWriter(std::filesystem::path path, const std::string& transform = std::string(kPoseTransform))
      : output_(std::move(path)) {
    if (transform != kPoseTransform) output_.buffer() = "# " + transform + '\n';
  }

  /// @throws RecordingError where the disk is full
  void write(Timestamp t, const Eigen::Isometry3d& T_camera_marker) {
    std::string& text = output_.buffer();
    append_seconds(text, t);
    text += ' ';
    append_pose(text, T_camera_marker, ' ');
    text += '\n';
    ++poses_written_;
    output_.flush_if_large();
  }

  /// @throws std::invalid_argument where the pose is of another marker than the poses before
  /// @throws RecordingError where the disk is full
  void write(const PoseEstimate& pose) {
    if (id_.value_or(pose.id) != pose.id)
      throw std::invalid_argument("TUM: marker_id is " + std::to_string(pose.id) + ", but the file is of marker " +
                                  std::to_string(*id_));
    id_ = pose.id;
    write(pose.t, pose.T_camera_marker);
  }

  /// Completes the file; calling it again does nothing.
  /// @throws RecordingError where the disk is full
  void close() { output_.close(); }
  std::uint64_t poses_written() const noexcept { return poses_written_; }

 private:
  BufferedOutput<std::string> output_;
  std::optional<MarkerId> id_;
  std::uint64_t poses_written_ = 0;
};

}  // namespace evmarker::io
