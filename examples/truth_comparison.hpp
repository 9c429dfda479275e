#pragma once
// Poses compared with true ones: errors and coverage of each marker, and whether the truth fits the poses at all.
#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <evmarker/evaluation/accuracy.hpp>
#include <evmarker/io/pose_reader.hpp>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

class TruthComparison {
 public:
  /// @param path of the true poses; empty where there are none: then coverage alone is measured
  explicit TruthComparison(const std::string& path) : path_(path) {
    if (!path.empty()) truth_ = evmarker::io::GroundTruth::read(path);
  }

  /// Returns the true pose, if it is known.
  std::optional<Eigen::Isometry3d> add(const evmarker::PoseEstimate& pose) {
    const auto truth = truth_ ? truth_->at(pose.id, pose.t) : std::nullopt;
    markers_[pose.id].add(pose, truth);
    first_t_ = std::min(first_t_, pose.t);
    last_t_ = std::max(last_t_, pose.t);
    ++poses_;
    compared_ += truth.has_value();
    return truth;
  }

  const std::map<evmarker::MarkerId, evmarker::AccuracyMeter>& markers() const { return markers_; }
  std::uint64_t poses() const { return poses_; }
  std::uint64_t compared() const { return compared_; }
  evmarker::Timestamp last_t() const { return last_t_; }

  /// @param source file that the poses are from
  /// @throws std::runtime_error where the truth is of other markers or times than all poses, or of one marker where
  /// there are several
  void require_comparable(const std::string& source) const {
    if (!truth_ || poses_ == 0) return;
    const auto true_ids = truth_->ids(), ids = this->ids();
    if (true_ids.empty() && ids.size() > 1)
      throw std::runtime_error(path_ + ": a trajectory in TUM format is of one marker, but the poses of " + source +
                               " are of " + text(ids) + ": give a table of true poses with marker ids");
    if (compared_ > 0) return;
    const std::string poses = "the " + std::to_string(poses_) + " poses of " + source + " are ";
    const auto known = [&](evmarker::MarkerId id) { return true_ids.empty() || std::ranges::count(true_ids, id) > 0; };
    if (std::ranges::none_of(ids, known))
      throw std::runtime_error(path_ + ": true poses of marker " + text(true_ids) + ", but " + poses + "of marker " +
                               text(ids));
    throw std::runtime_error(path_ + ": true poses from " + seconds(truth_->first_t()) + " to " +
                             seconds(truth_->last_t()) + " s, but " + poses + "from " + seconds(first_t_) + " to " +
                             seconds(last_t_) + " s; times are " + kUnits);
  }

  /// What to say of the truth where it can hardly be right: its poses are farther apart than the whole comparison is
  /// long, as where times are not in the unit of its format. Empty where nothing is to be said.
  std::string doubt() const {
    if (!truth_ || compared_ == 0) return {};
    const std::size_t within = truth_->count_within(first_t_, last_t_);
    if (within >= 2) return {};
    return path_ + ": only " + std::to_string(within) + " of its poses are from " + seconds(first_t_) + " to " +
           seconds(last_t_) + " s, the time of those compared; between its poses, it is interpolated; times are " +
           kUnits;
  }

 private:
  static constexpr const char* kUnits = "seconds in TUM format, t_us in a table";

  std::vector<evmarker::MarkerId> ids() const {
    std::vector<evmarker::MarkerId> ids;
    for (const auto& [id, meter] : markers_) ids.push_back(id);
    return ids;
  }
  static std::string text(const std::vector<evmarker::MarkerId>& ids) {
    std::string text;
    for (const evmarker::MarkerId id : ids) text += (text.empty() ? "" : ", ") + std::to_string(id);
    return text;
  }
  static std::string seconds(evmarker::Timestamp t) {
    char text[40];
    std::snprintf(text, sizeof text, "%.3f", static_cast<double>(t) * 1e-6);
    return text;
  }

  std::string path_;
  std::optional<evmarker::io::GroundTruth> truth_;
  std::map<evmarker::MarkerId, evmarker::AccuracyMeter> markers_;
  std::uint64_t poses_ = 0, compared_ = 0;
  evmarker::Timestamp first_t_ = std::numeric_limits<evmarker::Timestamp>::max();
  evmarker::Timestamp last_t_ = std::numeric_limits<evmarker::Timestamp>::min();
};
