#pragma once
// Reads poses: tables of many markers (CSV), trajectories of one marker (TUM), ground truth in either format.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/io/decimal.hpp"
#include "evmarker/io/line_reader.hpp"
#include "evmarker/io/pose_format.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/text_fields.hpp"
#include "evmarker/io/trajectory.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::io {

namespace detail {

inline RecordingError bad_field(const LineReader& lines, std::string_view name, std::string_view value) {
  return lines.error(std::string(name) + " is '" + std::string(value.substr(0, 40)) + "'");
}

template <typename Number>
Number parse_number(const LineReader& lines, std::string_view name, std::string_view text) {
  const auto value = parse_as<Number>(text);
  if (!value) throw bad_field(lines, name, text);
  return *value;
}

/// Pose from the fields `tx ty tz qx qy qz qw`.
inline Eigen::Isometry3d parse_pose(const LineReader& lines, const std::array<std::string_view, 7>& fields) {
  constexpr std::array<std::string_view, 7> names{"tx", "ty", "tz", "qx", "qy", "qz", "qw"};
  std::array<double, 7> v{};
  for (std::size_t i = 0; i < v.size(); ++i) {
    v[i] = parse_number<double>(lines, names[i], fields[i]);
    if (!std::isfinite(v[i])) throw bad_field(lines, names[i], fields[i]);
  }
  Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
  if (std::abs(q.norm() - 1) > 1e-2)
    throw lines.error("quaternion has length " + std::to_string(q.norm()) + ", must be 1");
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.translation() = Eigen::Vector3d(v[0], v[1], v[2]);
  pose.linear() = q.normalized().toRotationMatrix();
  return pose;
}

inline bool is_comment(std::string_view line) {
  const std::string_view text = trimmed(line);
  return text.empty() || text.front() == '#';
}

/// Other poses, as of the camera in a marker's frame, have the same numbers: only their name tells them apart.
inline void require_pose_transform(const LineReader& lines, std::string_view transform) {
  if (transform != kPoseTransform)
    throw lines.error("its poses are " + std::string(transform.substr(0, 40)) + ", not " + std::string(kPoseTransform) +
                      ": write them without --frame board and --relative");
}

/// Column names: the first line that is not a comment.
inline std::vector<std::string> read_column_names(LineReader& lines) {
  while (const auto line = lines.next()) {
    if (is_comment(*line)) continue;
    const auto names = split(*line, ',');
    return {names.begin(), names.end()};
  }
  throw RecordingError(lines.path(), "no poses: the file is empty");
}

inline TrackingState parse_state(const LineReader& lines, std::string_view text) {
  for (const auto state : {TrackingState::converging, TrackingState::tracking, TrackingState::lost})
    if (text == to_string(state)) return state;
  throw bad_field(lines, "state", text);
}

inline LossReason parse_loss_reason(const LineReader& lines, std::string_view text) {
  for (std::size_t i = 0; i < kLossReasons; ++i)
    if (const auto reason = static_cast<LossReason>(i); text == to_string(reason)) return reason;
  throw bad_field(lines, "loss_reason", text);
}

inline std::vector<TimedPose> parse_tum(LineReader lines) {
  std::vector<TimedPose> poses;
  while (const auto line = lines.next()) {
    const std::string_view text = trimmed(*line);
    if (text.starts_with("# T_") && text.find(' ', 2) == std::string_view::npos)
      require_pose_transform(lines, text.substr(2));
    if (is_comment(text)) continue;
    const auto fields = split(*line, ' ');
    if (fields.size() != 8)
      throw lines.error("has " + std::to_string(fields.size()) + " numbers, not the 8 of 't tx ty tz qx qy qz qw'");
    const auto t = parse_decimal(fields[0], 6);
    if (!t) throw bad_field(lines, "t", fields[0]);
    if (!poses.empty() && *t <= poses.back().t)
      throw lines.error("t is '" + std::string(fields[0]) + "', not after the line before");
    std::array<std::string_view, 7> pose;
    std::copy(fields.begin() + 1, fields.end(), pose.begin());
    poses.push_back({*t, parse_pose(lines, pose)});
  }
  return poses;
}

inline std::vector<PoseEstimate> parse_pose_csv(LineReader lines) {
  const std::vector<std::string> names = read_column_names(lines);
  const auto column = [&](std::string_view name) {
    return static_cast<std::size_t>(std::ranges::find(names, name) - names.begin());
  };
  constexpr std::array<std::string_view, 9> required{"t_us", "marker_id", "tx", "ty", "tz", "qx", "qy", "qz", "qw"};
  std::array<std::size_t, 9> at{};
  for (std::size_t i = 0; i < required.size(); ++i)
    if ((at[i] = column(required[i])) == names.size())
      throw lines.error("no column '" + std::string(required[i]) + "'");
  const std::size_t state = column("state"), matched = column("matched"), loss_reason = column("loss_reason"),
                    transform = column("transform");
  const std::array<std::string_view, 4> values{"residual_px", "backtrack_px", "backtrack_rad", "health"};

  std::vector<PoseEstimate> poses;
  while (const auto line = lines.next()) {
    if (is_comment(*line)) continue;
    const auto fields = split(*line, ',');
    if (fields.size() != names.size())
      throw lines.error("has " + std::to_string(fields.size()) + " columns, not " + std::to_string(names.size()));
    if (transform < names.size()) require_pose_transform(lines, fields[transform]);
    PoseEstimate pose;
    pose.t = parse_number<Timestamp>(lines, "t_us", fields[at[0]]);
    pose.id = parse_number<MarkerId>(lines, "marker_id", fields[at[1]]);
    std::array<std::string_view, 7> numbers;
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = fields[at[i + 2]];
    pose.T_camera_marker = parse_pose(lines, numbers);
    auto& quality = pose.quality;
    quality.state = state < names.size() ? parse_state(lines, fields[state]) : TrackingState::tracking;
    if (matched < names.size()) quality.matched = parse_number<int>(lines, "matched", fields[matched]);
    const std::array<double*, 4> targets{&quality.residual_px, &quality.backtrack_px, &quality.backtrack_rad,
                                         &quality.health};
    for (std::size_t i = 0; i < values.size(); ++i)
      if (const auto found = column(values[i]); found < names.size())
        *targets[i] = parse_number<double>(lines, values[i], fields[found]);
    if (loss_reason < names.size()) quality.loss_reason = parse_loss_reason(lines, fields[loss_reason]);
    poses.push_back(pose);
  }
  return poses;
}

}  // namespace detail

/// Reads a trajectory in TUM format: lines `t tx ty tz qx qy qz qw`, t in seconds; lines that begin with `#` are
/// comments, but one that says that the poses are not `T_camera_marker`, as `# T_marker_camera`, is an error.
/// @throws RecordingError naming a line that is malformed or not later than the line before
inline std::vector<TimedPose> read_tum(const std::filesystem::path& path) {
  return detail::parse_tum(LineReader(path));
}

/// Reads a pose table as PoseCsvWriter writes it. Columns are found by name; of those in kPoseCsvHeader, `state` and
/// all behind `qw` are optional. Missing ones are read as `tracking` and the defaults of TrackingQuality.
/// @throws RecordingError naming line and value that are malformed, or a `transform` that is not `T_camera_marker`
inline std::vector<PoseEstimate> read_pose_csv(const std::filesystem::path& path) {
  return detail::parse_pose_csv(LineReader(path));
}

/// True poses of one marker or many, with which estimates are compared.
class GroundTruth {
 public:
  /// Reads a TUM trajectory, which then applies to a marker of any id, or a pose table, of which rows in state `lost`
  /// are ignored.
  /// @throws RecordingError where the file is malformed or empty, or times do not increase
  static GroundTruth read(const std::filesystem::path& path) {
    GroundTruth truth;
    LineReader lines(path);
    if (!holds_pose_table(lines)) {
      auto poses = detail::parse_tum(std::move(lines));
      if (poses.empty()) throw RecordingError(path, "no poses");
      truth.any_marker_ = Trajectory(std::move(poses));
      return truth;
    }
    std::map<MarkerId, std::vector<TimedPose>> poses;
    for (const PoseEstimate& pose : detail::parse_pose_csv(std::move(lines)))
      if (pose.quality.state != TrackingState::lost) poses[pose.id].push_back({pose.t, pose.T_camera_marker});
    if (poses.empty()) throw RecordingError(path, "no poses");
    for (auto& [id, samples] : poses) {
      try {
        truth.markers_.emplace(id, Trajectory(std::move(samples)));
      } catch (const std::invalid_argument& error) {
        throw RecordingError(path, "marker " + std::to_string(id) + ": " + error.what());
      }
    }
    return truth;
  }

  /// Pose of marker `id` at `t` [us]; nothing where the file has no poses of it before and after `t`.
  std::optional<Eigen::Isometry3d> at(MarkerId id, Timestamp t) const {
    if (any_marker_) return any_marker_->at(t);
    const auto found = markers_.find(id);
    return found == markers_.end() ? std::nullopt : found->second.at(t);
  }

  /// Ids of the markers in the file; none for TUM.
  std::vector<MarkerId> ids() const {
    std::vector<MarkerId> ids;
    for (const auto& [id, trajectory] : markers_) ids.push_back(id);
    return ids;
  }

  /// Times of its first and its last pose, of any marker [us].
  Timestamp first_t() const {
    Timestamp t = std::numeric_limits<Timestamp>::max();
    for_each([&](const Trajectory& trajectory) { t = std::min(t, trajectory.poses().front().t); });
    return t;
  }
  Timestamp last_t() const {
    Timestamp t = std::numeric_limits<Timestamp>::min();
    for_each([&](const Trajectory& trajectory) { t = std::max(t, trajectory.poses().back().t); });
    return t;
  }
  /// How many poses it has from one time to another, both included [us].
  std::size_t count_within(Timestamp first, Timestamp last) const {
    std::size_t count = 0;
    for_each([&](const Trajectory& trajectory) {
      count += static_cast<std::size_t>(std::ranges::count_if(
          trajectory.poses(), [&](const TimedPose& pose) { return first <= pose.t && pose.t <= last; }));
    });
    return count;
  }

 private:
  template <typename Use>
  void for_each(const Use& use) const {
    if (any_marker_) use(*any_marker_);
    for (const auto& [id, trajectory] : markers_) use(trajectory);
  }

  // By the first line that is no comment; none is consumed, since what comes from a pipe cannot be read again.
  static bool holds_pose_table(const LineReader& lines) {
    for (std::string_view text = lines.lookahead(); !text.empty();) {
      const std::string_view line = text.substr(0, text.find('\n'));
      if (!detail::is_comment(line)) return line.find(',') != std::string_view::npos;
      text.remove_prefix(std::min(line.size() + 1, text.size()));
    }
    throw RecordingError(lines.path(), "no poses: the file is empty");
  }

  std::map<MarkerId, Trajectory> markers_;
  std::optional<Trajectory> any_marker_;
};

}  // namespace evmarker::io
