#pragma once
// Judges trackers on the real recordings of ../shared/data. Their references are fits, not motion capture.
#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <cmath>
#include <concepts>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <optional>
#include <ranges>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/detection/board_detector.hpp"
#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/io/csv_reader.hpp"
#include "evmarker/io/trajectory.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/opencv/board.hpp"
#include "evmarker/opencv/calibration.hpp"
#include "evmarker/opencv/wireframe.hpp"
#include "evmarker/simulation/trajectory.hpp"
#include "evmarker/tracking/tracker.hpp"
#include "evmarker/tracking/wireframe_tracker.hpp"

namespace evmarker::bench {

/// What a trial changes in the library's default settings, and how its poses are observed.
struct Trial {
  std::optional<int> events_per_update;
  std::optional<std::chrono::microseconds> filter_window;
  bool one_by_one = false;  ///< events are pushed alone, not in ranges
  std::function<void(const PoseEstimate&)> watch = [](const PoseEstimate&) {};  ///< called with every pose
};

/// Pushes events as the trial sets it: `use(pose)` is called with each pose.
template <typename AnyTracker, typename Use>
void push(AnyTracker& tracker, std::span<const Event> events, const Trial& trial, const Use& use) {
  const auto watched = [&](const PoseEstimate& pose) {
    trial.watch(pose);
    use(pose);
  };
  if (!trial.one_by_one) return tracker.push(events, watched);
  for (const Event& event : events) {
    if constexpr (requires {
                    { tracker.push(event) } -> std::same_as<const PoseEstimate*>;
                  }) {
      if (const PoseEstimate* const pose = tracker.push(event)) watched(*pose);
    } else {
      for (const PoseEstimate& pose : tracker.push(event)) watched(pose);
    }
  }
}

template <typename Settings>
Settings settings(const Trial& trial) {
  Settings s;
  if (trial.events_per_update) s.marker.events_per_update = *trial.events_per_update;
  if (trial.filter_window) s.filter_window = *trial.filter_window;
  return s;
}

namespace detail {

/// The numbers of a table, row by row; lines that do not begin with one are left out.
inline std::vector<std::vector<double>> read_numbers(const std::filesystem::path& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path.string() + " cannot be read");
  std::vector<std::vector<double>> rows;
  for (std::string line; std::getline(file, line);) {
    std::vector<double> row;
    for (const char *at = line.data(), *const end = at + line.size(); at < end; ++at) {
      double value = 0;
      const auto [behind, error] = std::from_chars(at, end, value);
      if (error != std::errc{}) break;
      row.push_back(value);
      at = behind;
    }
    if (!row.empty()) rows.push_back(std::move(row));
  }
  if (rows.empty()) throw std::runtime_error(path.string() + " holds no numbers");
  return rows;
}

/// From `tx ty tz qx qy qz qw`, which begin at a row's second number.
inline Eigen::Isometry3d pose(const std::vector<double>& row) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation() << row.at(1), row.at(2), row.at(3);
  T.linear() = Eigen::Quaterniond(row.at(7), row.at(4), row.at(5), row.at(6)).normalized().toRotationMatrix();
  return T;
}

inline Timestamp time(const std::vector<double>& row) { return std::llround(row.at(0)); }

inline std::vector<Event> read_events(const std::filesystem::path& path, SensorSize size) {
  io::CsvReader recording(path, {.sensor_size = size});
  std::vector<Event> events;
  for_each_event(recording, [&](const Event& event) { events.push_back(event); });
  return events;
}

}  // namespace detail

/// A body that is followed from a known pose on, at the moments of its reference.
struct BodyVerdict {
  int moments = 0;
  int right = 0;  ///< `tracking`, and within the limits
  int wrong = 0;  ///< `tracking`, and not
  std::map<LossReason, int> losses;
  std::vector<double> distances;  ///< while `tracking`, from the reference: [mm], for the flip [px]
  std::vector<double> angles;     ///< the same [deg]

  double right_share() const { return static_cast<double>(right) / moments; }
  double wrong_share() const { return static_cast<double>(wrong) / moments; }
  int lost() const {
    int sum = 0;
    for (const auto& [reason, count] : losses) sum += count;
    return sum;
  }
};

/// How far a pose is from the reference [mm or px, deg].
struct Distance {
  double length, angle_deg;
};

/// Pushes the events from the first moment on and evaluates the tracker's pose at each moment.
/// @param distance of a pose from the reference of the moment with a number
template <typename TrackerOfOne, typename DistanceOf>
BodyVerdict follow(TrackerOfOne& tracker, std::span<const Event> events, std::span<const Timestamp> moments,
                   const Distance& limits, const Trial& trial, const DistanceOf& distance) {
  BodyVerdict verdict;
  const auto at = [&](Timestamp t) { return std::ranges::lower_bound(events, t, {}, &Event::t); };
  auto next = at(moments.front());
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const auto end = at(moments[i]);
    push(tracker, std::span(next, end), trial, [&](const PoseEstimate& pose) {
      if (pose.quality.state == TrackingState::lost) ++verdict.losses[pose.quality.loss_reason];
    });
    next = end;
    ++verdict.moments;
    const PoseEstimate pose = tracker.pose_at(moments[i]);
    if (pose.quality.state != TrackingState::tracking) continue;
    const Distance d = distance(pose, i);
    const bool right = d.length < limits.length && d.angle_deg < limits.angle_deg;
    ++(right ? verdict.right : verdict.wrong);
    verdict.distances.push_back(d.length);
    verdict.angles.push_back(d.angle_deg);
  }
  return verdict;
}

/// The paper pyramid, from its first usable reference on: right within 10 mm and 8 deg.
template <PoseUpdateRule Rule>
BodyVerdict judge_pyramid(const std::filesystem::path& data, const Trial& trial = {}) {
  const std::filesystem::path folder = data / "pyramid";
  const PinholeCamera camera = opencv::load_calibration((folder / "camera.yml").string());
  const std::vector<Event> events = detail::read_events(folder / "events.csv", camera.sensor_size());
  std::vector<Timestamp> moments;
  std::vector<Eigen::Isometry3d> references;
  for (const auto& row : detail::read_numbers(folder / "reference.csv"))
    if (row.at(8) > 0.6 && row.at(10) < 100) {  // what its README calls usable
      moments.push_back(detail::time(row));
      references.push_back(detail::pose(row));
    }
  Wireframe pyramid = opencv::load_wireframe((folder / "wireframe.yml").string());
  pyramid.start = references.at(0);
  WireframeTracker<Rule> tracker(camera, pyramid, settings<WireframeTrackerSettings<Rule>>(trial));
  return follow(tracker, events, moments, {10, 8}, trial, [&](const PoseEstimate& pose, std::size_t i) {
    const PoseError error = pose_error(pose.T_camera_marker, references[i]);
    return Distance{error.translation_mm, error.rotation_deg};
  });
}

/// The dark square in front of a camera that rolls through 360 degrees, from 0.1 to 1.95 s: right within 3 px and
/// 10 deg about the line of sight. Neither the camera nor the square's size is known; only its image is compared.
template <PoseUpdateRule Rule>
BodyVerdict judge_flip(const std::filesystem::path& data, const Trial& trial = {}) {
  constexpr double kFocal = 100, kCentre = 63.5, kSide = 0.3;
  const std::filesystem::path folder = data / "flip";
  const PinholeCamera camera({128, 128}, kFocal, kFocal, kCentre, kCentre);
  const std::vector<Event> events = detail::read_events(folder / "events.csv", camera.sensor_size());
  std::vector<std::vector<double>> fits;
  std::vector<Timestamp> moments;
  for (const auto& row : detail::read_numbers(folder / "square_fit.csv"))
    if (row.at(0) > 100000 && row.at(0) < 1950000) {
      fits.push_back(row);
      moments.push_back(detail::time(row));
    }
  const auto& start = fits.at(0);
  const double depth = kFocal * kSide / start.at(3);
  const Eigen::Isometry3d T_start = facing_pose(
      {(start.at(1) - kCentre) / kFocal * depth, (start.at(2) - kCentre) / kFocal * depth, depth}, {0, 0, start.at(4)});
  WireframeTracker<Rule> tracker(camera, Wireframe{0, make_square_marker(kSide), T_start},
                                 settings<WireframeTrackerSettings<Rule>>(trial));
  return follow(tracker, events, moments, {3, 10}, trial, [&](const PoseEstimate& pose, std::size_t i) {
    const Eigen::Vector2d centre = camera.project(pose.T_camera_marker.translation());
    const auto& R = pose.T_camera_marker.linear();
    const double turned = std::remainder(std::atan2(R(1, 0), R(0, 0)) - fits[i].at(4), 2 * std::numbers::pi);
    return Distance{std::hypot(centre.x() - fits[i].at(1), centre.y() - fits[i].at(2)),
                    std::abs(turned) * 180 / std::numbers::pi};
  });
}

/// Squared errors of all `tracking` poses by their covariance, for each degree of freedom: 1 on average where a
/// covariance is consistent.
struct Nees {
  std::vector<double> all, translation, rotation;

  void add(const Vector6d& error, const Matrix6d& covariance) {
    const Eigen::Matrix3d P_t = covariance.topLeftCorner<3, 3>(), P_r = covariance.bottomRightCorner<3, 3>();
    const Eigen::Vector3d e_t = error.head<3>(), e_r = error.tail<3>();
    all.push_back(error.dot(covariance.ldlt().solve(error)) / 6);
    translation.push_back(e_t.dot(P_t.ldlt().solve(e_t)) / 3);
    rotation.push_back(e_r.dot(P_r.ldlt().solve(e_r)) / 3);
  }
};

/// The twelve tags, each alone or as one board.
struct TagsVerdict {
  int targets = 0;               ///< tags, or one board
  std::vector<int> tracked;      ///< ids that ever were `tracking`
  std::vector<double> first_ms;  ///< first `tracking` pose of each of these, from the recording's begin on
  std::map<LossReason, int> losses;
  double corner_px = 0;  ///< mean distance of the corners from corners.csv, over all `tracking` poses
  Nees exact;            ///< as if the reference was exact
  Nees fit;              ///< with the deviations that its README states added

  int lost() const {
    int sum = 0;
    for (const auto& [reason, count] : losses) sum += count;
    return sum;
  }
};

namespace detail {

/// The batch fit of the tags: the board's pose and the corners in the image.
class TagsReference {
 public:
  explicit TagsReference(const std::filesystem::path& folder) {
    std::vector<io::TimedPose> poses;
    for (const auto& row : read_numbers(folder / "reference.csv")) poses.push_back({time(row), pose(row)});
    T_camera_board_ = io::Trajectory(std::move(poses));
    for (const auto& row : read_numbers(folder / "corners.csv")) {
      Corners corners{time(row), {}};
      for (std::size_t k = 0; k < 4; ++k) corners.at[k] = {row.at(2 + 2 * k), row.at(3 + 2 * k)};
      corners_[static_cast<MarkerId>(row.at(1))].push_back(corners);
    }
  }

  std::optional<Eigen::Isometry3d> T_camera_board(Timestamp t) const { return T_camera_board_.at(t); }

  /// From the tag's top left clockwise; nothing outside of the time that the fit covers.
  std::optional<std::array<Eigen::Vector2d, 4>> corners(MarkerId id, Timestamp t) const {
    const std::vector<Corners>& all = corners_.at(id);
    const auto next = std::ranges::upper_bound(all, t, {}, &Corners::t);
    if (next == all.begin() || next == all.end()) return std::nullopt;
    const Corners &a = next[-1], &b = *next;
    const double part = static_cast<double>(t - a.t) / static_cast<double>(b.t - a.t);
    std::array<Eigen::Vector2d, 4> mixed;
    for (std::size_t k = 0; k < 4; ++k) mixed[k] = (1 - part) * a.at[k] + part * b.at[k];
    return mixed;
  }

 private:
  struct Corners {
    Timestamp t;
    std::array<Eigen::Vector2d, 4> at;
  };
  io::Trajectory T_camera_board_;
  std::map<MarkerId, std::vector<Corners>> corners_;
};

/// Compares a pose with the board's, from which it lies `lever` away [m, camera frame].
inline void add_nees(TagsVerdict& verdict, const PoseEstimate& pose, const Eigen::Isometry3d& truth,
                     const Eigen::Vector3d& lever) {
  if (!pose.covariance) return;
  const Eigen::AngleAxisd turn(Eigen::Matrix3d(pose.T_camera_marker.linear() * truth.linear().transpose()));
  Vector6d error, board;  // of the estimate; deviations of the board's pose [m, rad]
  error << pose.T_camera_marker.translation() - truth.translation(), turn.angle() * turn.axis();
  constexpr double kAcross = 1e-4, kDepth = 3e-4, kTurn = 0.08 * std::numbers::pi / 180;
  board << kAcross, kAcross, kDepth, kTurn, kTurn, kTurn;
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() << 0, lever.z(), -lever.y(), -lever.z(), 0, lever.x(), lever.y(), -lever.x(), 0;
  verdict.exact.add(error, *pose.covariance);
  verdict.fit.add(error, *pose.covariance + J * board.cwiseAbs2().asDiagonal() * J.transpose());
}

/// Judges the poses of the tags, or of the board that they are on.
class TagsJudge {
 public:
  TagsJudge(const std::filesystem::path& folder, PinholeCamera camera, Board board, bool as_board)
      : reference_(folder), camera_(std::move(camera)), board_(std::move(board)), as_board_(as_board) {
    verdict_.targets = as_board ? 1 : static_cast<int>(board_.markers.size());
  }

  void add(const PoseEstimate& pose, Timestamp begin) {
    if (pose.quality.state == TrackingState::lost) ++verdict_.losses[pose.quality.loss_reason];
    if (pose.quality.state != TrackingState::tracking) return;
    if (std::ranges::find(verdict_.tracked, pose.id) == verdict_.tracked.end()) {
      verdict_.tracked.push_back(pose.id);
      verdict_.first_ms.push_back(1e-3 * static_cast<double>(pose.t - begin));
    }
    if (as_board_)
      compare_board(pose);
    else
      compare_tag(pose);
  }

  TagsVerdict verdict() const {
    TagsVerdict verdict = verdict_;
    verdict.corner_px =
        corners_ > 0 ? distances_px_ / static_cast<double>(corners_) : std::numeric_limits<double>::quiet_NaN();
    return verdict;
  }

 private:
  void compare_board(const PoseEstimate& pose) {
    for (const BoardMarker& tag : board_.markers)
      compare_corners(tag, pose.t, pose.T_camera_marker * tag.T_board_marker);
    if (const auto T_camera_board = reference_.T_camera_board(pose.t))
      add_nees(verdict_, pose, *T_camera_board, Eigen::Vector3d::Zero());
  }

  void compare_tag(const PoseEstimate& pose) {
    const auto tag = std::ranges::find(board_.markers, pose.id, &BoardMarker::id);
    if (tag == board_.markers.end()) return;
    compare_corners(*tag, pose.t, pose.T_camera_marker);
    if (const auto T_camera_board = reference_.T_camera_board(pose.t))
      add_nees(verdict_, pose, *T_camera_board * tag->T_board_marker,
               T_camera_board->linear() * tag->T_board_marker.translation());
  }

  void compare_corners(const BoardMarker& tag, Timestamp t, const Eigen::Isometry3d& T_camera_tag) {
    const auto expected = reference_.corners(tag.id, t);
    if (!expected) return;
    const auto square = make_square_marker(tag.length).vertices;
    for (std::size_t k = 0; k < 4; ++k)
      distances_px_ += (camera_.project(T_camera_tag * square[k]) - (*expected)[k]).norm();
    corners_ += 4;
  }

  TagsReference reference_;
  PinholeCamera camera_;
  Board board_;
  bool as_board_;
  TagsVerdict verdict_;
  double distances_px_ = 0;
  std::uint64_t corners_ = 0;
};

}  // namespace detail

/// The tags as `Tracker` finds and follows them; the covariance is compared with the batch fit.
template <PoseUpdateRule Rule>
TagsVerdict judge_tags(const std::filesystem::path& data, bool as_board, const Trial& trial = {}) {
  const std::filesystem::path folder = data / "tags";
  constexpr const char* kDictionary = "DICT_APRILTAG_36h11";
  const PinholeCamera camera = opencv::load_calibration((folder / "camera.yml").string());
  const Board board = opencv::load_board((folder / "board.yml").string(), kDictionary);
  const std::vector<Event> events = detail::read_events(folder / "events.csv", camera.sensor_size());
  // One type of detector for both, to compile once: with no boards it passes on every tag.
  BoardDetector detector(
      camera, opencv::ArucoDetector(camera, {.dictionary = kDictionary, .marker_length = board.markers[0].length}),
      as_board ? std::vector{board} : std::vector<Board>{});
  Tracker<decltype(detector), Rule> tracker(camera, detector, settings<TrackerSettings<Rule>>(trial));
  detail::TagsJudge judge(folder, camera, board, as_board);
  push(tracker, events, trial, [&](const PoseEstimate& pose) { judge.add(pose, events.front().t); });
  return judge.verdict();
}

}  // namespace evmarker::bench
