#pragma once
// Where the poses of a tracking program go: which, in whose frame, in what format.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <evmarker/base/so3.hpp>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/model/mean_pose.hpp>
#include <evmarker/model/relative_pose.hpp>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

struct PoseOutputOptions {
  std::string output, format = "csv", frame = "camera";
  double rate_hz = 0;  // 0: a pose for each update
  std::vector<int> relative;

  void add_to(CLI::App& app) {
    app.add_option("--output", output, "poses of every marker");
    app.add_option("--format", format,
                   "csv: a table of all markers; tum: t tx ty tz qx qy qz qw, only poses in state tracking, and where "
                   "there may be several markers a file for each, as poses_7.txt")
        ->check(CLI::IsMember({"csv", "tum"}))
        ->capture_default_str();
    app.add_option("--frame", frame,
                   "camera: of the marker in the camera's frame; board: of the camera in the marker's or board's frame")
        ->check(CLI::IsMember({"camera", "board"}))
        ->capture_default_str();
    app.add_option("--rate", rate_hz,
                   "write poses at multiples of 1/rate of recorded time, a whole number of microseconds, moved on to "
                   "that time [Hz]; default: one for each update")
        ->check(CLI::Range(0.001, 1e6));
    app.add_option("--relative", relative,
                   "write the pose of the second of two markers or boards in the frame of the first, as 100,101, at "
                   "--rate (or 100 Hz) where both are tracking, and print the mean")
        ->delimiter(',')
        ->expected(2);
  }

  /// @throws std::invalid_argument for options that contradict each other
  void validate() const {
    if (relative.empty()) return;
    if (relative[0] == relative[1])
      throw std::invalid_argument("--relative: " + std::to_string(relative[0]) + " is there twice");
    if (frame == "board")
      throw std::invalid_argument("--relative: gives poses in the frame of the first one, without --frame board");
  }

  /// What the poses are that are written, as `T_a_b`, which maps coordinates in b to a.
  std::string transform() const {
    if (!relative.empty()) return "T_" + std::to_string(relative[0]) + '_' + std::to_string(relative[1]);
    return frame == "board" ? "T_marker_camera" : std::string(evmarker::io::kPoseTransform);
  }

  /// Time between the poses that are written; none where one is written for each update.
  std::optional<std::chrono::microseconds> interval() const {
    const double rate = rate_hz > 0 || relative.empty() ? rate_hz : 100;
    if (rate == 0) return std::nullopt;
    return std::chrono::microseconds(std::llround(1e6 / rate));
  }
};

class PoseOutput {
 public:
  /// Opens the file, so that one that cannot be written is reported before anything is tracked.
  /// @param single no more than one marker can be written
  /// @throws std::invalid_argument for options that contradict each other or files that may be overwritten
  /// @throws evmarker::io::RecordingError where a file cannot be created
  PoseOutput(const PoseOutputOptions& options, bool single, evmarker::io::PoseColumns columns) : options_(options) {
    options.validate();
    single_ = single || !options.relative.empty();
    if (options.output.empty()) return;
    if (options.format == "csv")
      table_.emplace(options.output, columns, options.transform());
    else if (single_)
      trajectories_.try_emplace(kAny, options.output, options.transform());
    else
      require_none_of_another_run();
  }

  /// Takes a pose of an update.
  void write(const evmarker::PoseEstimate& pose) {
    if (!options_.interval()) write_in_frame(pose);
  }

  /// Takes the poses of all markers at one time.
  void write(std::span<const evmarker::PoseEstimate> poses) {
    times_with_poses_ += !poses.empty();
    if (options_.relative.empty())
      for (const evmarker::PoseEstimate& pose : poses) write_in_frame(pose);
    else if (const auto* a = find(poses, options_.relative[0]), *b = find(poses, options_.relative[1]); a && b)
      write_relative(evmarker::relative_pose(*a, *b));
  }

  /// Completes the files.
  void close() {
    if (table_) table_->close();
    for (auto& [id, trajectory] : trajectories_) trajectory.close();
  }

  /// What is in the files, such as "12 poses in poses.csv".
  std::vector<std::string> kept() const {
    std::vector<std::string> files;
    const auto add = [&](std::uint64_t poses, const std::string& path) {
      files.push_back(std::to_string(poses) + " poses in " + path);
    };
    if (table_) add(table_->poses_written(), options_.output);
    for (const auto& [id, trajectory] : trajectories_)
      add(trajectory.poses_written(), id == kAny ? options_.output : path_of(id));
    return files;
  }

  /// Prints what a single file or table does not say: names of several files, the mean of relative poses.
  void print() const {
    if (!trajectories_.contains(kAny))
      for (const auto& [id, trajectory] : trajectories_)
        std::printf("output     %llu poses in %s\n", static_cast<unsigned long long>(trajectory.poses_written()),
                    path_of(id).c_str());
    if (average_.size() > 0) print_mean();
  }

  /// Where markers were tracked: why --rate leaves none of their poses, if it does; else empty.
  std::string none_at_rate(double recorded_s) const {
    if (options_.rate_hz == 0 || times_with_poses_ > 0 || options_.output.empty()) return {};
    char text[160];
    std::snprintf(
        text, sizeof text,
        "--rate %g: no pose is written: no marker was tracked at a multiple of %g s, as the recording is %.2f s "
        "long",
        options_.rate_hz, 1e-6 * static_cast<double>(options_.interval()->count()), recorded_s);
    return text;
  }

  /// Why there is no relative pose, if one was to be written; else empty.
  std::string no_relative() const {
    if (options_.relative.empty() || average_.size() > 0) return {};
    return "--relative: " + std::to_string(options_.relative[0]) + " and " + std::to_string(options_.relative[1]) +
           " were never tracking at the same time (markers of a board are not tracked alone)";
  }

 private:
  static constexpr evmarker::MarkerId kAny = -1;

  static const evmarker::PoseEstimate* find(std::span<const evmarker::PoseEstimate> poses, evmarker::MarkerId id) {
    const auto found = std::ranges::find(poses, id, &evmarker::PoseEstimate::id);
    return found == poses.end() ? nullptr : &*found;
  }

  void write_relative(const evmarker::PoseEstimate& pose) {
    if (pose.quality.state != evmarker::TrackingState::tracking) return;
    average_.add(pose);
    write_row(pose);
  }

  void write_in_frame(const evmarker::PoseEstimate& pose) {
    write_row(options_.frame == "camera" ? pose : evmarker::inverse(pose));
  }

  void write_row(const evmarker::PoseEstimate& pose) {
    if (table_) return table_->write(pose);
    if (options_.output.empty() || pose.quality.state != evmarker::TrackingState::tracking) return;
    const evmarker::MarkerId id = single_ ? kAny : pose.id;
    auto trajectory = trajectories_.find(id);
    if (trajectory == trajectories_.end())
      trajectory = trajectories_.try_emplace(id, path_of(id), options_.transform()).first;
    trajectory->second.write(pose);
  }

  // poses_7.txt for poses.txt.
  std::string path_of(evmarker::MarkerId id) const {
    const std::filesystem::path path(options_.output);
    return path.parent_path() / (path.stem().string() + '_' + std::to_string(id) + path.extension().string());
  }

  // Nobody has named these files: what is there already may be something else, or of a marker that is not there now.
  void require_none_of_another_run() const {
    const std::filesystem::path path(options_.output), folder = path.has_parent_path() ? path.parent_path() : ".";
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
      const std::filesystem::path& there = entry.path();
      const std::string stem = there.stem().string(), begin = path.stem().string() + '_';
      if (there.extension() != path.extension() || !stem.starts_with(begin) || stem.size() == begin.size()) continue;
      if (stem.find_first_not_of("0123456789", begin.size()) == std::string::npos)
        throw std::invalid_argument("--output " + options_.output + ": there is a " + there.filename().string() +
                                    " already, which could be overwritten; remove it or choose another name");
    }
    if (error) throw evmarker::io::RecordingError(path, "cannot create: " + error.message());
  }

  void print_mean() const {
    const int a = options_.relative[0], b = options_.relative[1];
    const evmarker::MeanPose mean = average_.mean();
    const Eigen::Vector3d rotation = evmarker::so3_log(mean.T.linear()), translation = mean.T.translation();
    constexpr double kDegrees = 180 / std::numbers::pi;
    std::printf("relative   mean pose of %d in the frame of %d, of %zu poses:\n", b, a, mean.poses);
    std::printf("           rotation: [%.6f, %.6f, %.6f], translation: [%.6f, %.6f, %.6f]\n", rotation.x(),
                rotation.y(), rotation.z(), translation.x(), translation.y(), translation.z());
    std::printf("           standard error %.3f mm %.3f deg, spread of the poses %.2f mm %.2f deg\n",
                1e3 * std::sqrt(mean.covariance.diagonal().head<3>().sum()),
                kDegrees * std::sqrt(mean.covariance.diagonal().tail<3>().sum()), 1e3 * mean.spread_m,
                kDegrees * mean.spread_rad);
  }

  PoseOutputOptions options_;
  bool single_ = false;
  std::optional<evmarker::io::PoseCsvWriter> table_;
  std::map<evmarker::MarkerId, evmarker::io::TumWriter> trajectories_;
  evmarker::PoseAverage average_;
  std::uint64_t times_with_poses_ = 0;  // of those at --rate
};
