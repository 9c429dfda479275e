#pragma once
// Finds boards by their markers.
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/detection/board_check.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// A `MarkerDetector` that makes one detection of a board from the markers of it that another detector finds, and
/// passes on the markers that are on no board. Any marker of a board will do; of several the pose is fitted to the
/// corners of all, which also decides between the two poses of a planar marker. A board whose markers are seen at other
/// places than its file says is not found, see `BoardCheck`. One marker alone cannot contradict the file: it will do
/// until others are seen, but not after they have contradicted.
template <MarkerDetector Detector>
class BoardDetector {
 public:
  /// @param detector must find the boards' markers; at which length [m] it takes them for does not matter
  /// @param report is called within `detect`, each time that a board begins to be refused
  /// @throws std::invalid_argument naming the fault of a board, or an id or marker that two boards share
  template <CameraModel Camera>
  BoardDetector(const Camera& camera, Detector detector, std::vector<Board> boards,
                std::function<void(const BoardContradiction&)> report = {})
      : detector_(std::move(detector)), focal_length_(camera.focal_length()), report_(std::move(report)) {
    project_ = [camera](const Eigen::Vector3d& point) -> Eigen::Vector2d { return camera.project(point); };
    for (Board& board : boards) {
      for (const Target& other : targets_) require_apart(board, other.board);
      MarkerModel model = make_board_model(board);
      targets_.push_back({std::move(board), std::move(model), {}});
    }
  }

  /// The boards and the markers on no board that are in a frame; the boards come last.
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) {
    std::vector<MarkerDetection> found;
    std::vector<std::vector<Sighting>> sightings(targets_.size());
    for (const MarkerDetection& detection : detector_.detect(frame))
      if (const auto sighting = recognise(detection))
        sightings[sighting->target].push_back(*sighting);
      else
        found.push_back(detection);
    for (std::size_t i = 0; i < targets_.size(); ++i) {
      if (sightings[i].empty()) continue;
      auto detection = locate(targets_[i], sightings[i]);
      if (detection && believable(targets_[i], sightings[i], detection->T_camera_marker))
        found.push_back(*std::move(detection));
    }
    return found;
  }

  /// The wireframe of a board, or of a marker.
  MarkerModel model(MarkerId id) {
    for (const Target& target : targets_)
      if (target.board.id == id) return target.model;
    return detector_.model(id);
  }

 private:
  struct Target {
    Board board;
    MarkerModel model;
    BoardCheck check;
  };
  // A marker of a board, seen.
  struct Sighting {
    std::size_t target;
    const BoardMarker* marker;
    Timestamp t;
    std::vector<Eigen::Isometry3d> T_camera_board;  // by this marker alone: the likelier pose, and the other
    std::array<Vec3, 4> corners;                    // board frame [m]
    std::array<Vec2, 4> seen;                       // the corners on the plane z = 1
  };
  struct Fit {
    Eigen::Isometry3d T_camera_board;
    double cost_px = 0;  // root mean square, far ones limited
  };
  static constexpr double kOutlier_px = 4;
  static constexpr double kSamePose = 0.03;  // [rad]: two starts led to one pose
  static constexpr double kMaxAlternativeRatio =
      2.0;  // the other pose is reported if its error is at most so many times larger

  static void require_apart(const Board& a, const Board& b) {
    if (a.id == b.id) throw std::invalid_argument("board " + std::to_string(a.id) + " is there twice");
    for (const BoardMarker& marker : a.markers)
      if (std::ranges::find(b.markers, marker.id, &BoardMarker::id) != b.markers.end())
        throw std::invalid_argument("marker " + std::to_string(marker.id) + " is on board " + std::to_string(b.id) +
                                    " and on board " + std::to_string(a.id));
  }

  std::optional<Sighting> recognise(const MarkerDetection& detection) {
    for (std::size_t target = 0; target < targets_.size(); ++target)
      for (const BoardMarker& marker : targets_[target].board.markers)
        if (marker.id == detection.id) return sighting(target, marker, detection);
    return std::nullopt;
  }

  Sighting sighting(std::size_t target, const BoardMarker& marker, const MarkerDetection& detection) {
    // A marker of another size than the detector takes it for looks the same, in proportion farther away.
    double assumed = 0;
    for (const Eigen::Vector3d& vertex : detector_.model(marker.id).vertices)
      assumed = std::max(assumed, 2 * std::abs(vertex.x()));
    const auto T_camera_marker = [&](Eigen::Isometry3d T) {
      set_translation(T, marker.length / assumed * translation(T));
      return T;
    };
    Sighting s{target, &marker, detection.t, {}, {}, {}};
    const Eigen::Isometry3d T_marker_board = marker.T_board_marker.inverse();
    s.T_camera_board.push_back(T_camera_marker(detection.T_camera_marker) * T_marker_board);
    if (detection.T_camera_marker_alternative)
      s.T_camera_board.push_back(T_camera_marker(*detection.T_camera_marker_alternative) * T_marker_board);
    const auto square = make_square_marker(marker.length).vertices;
    for (std::size_t i = 0; i < 4; ++i) {
      s.corners[i] = transform(marker.T_board_marker, square[i]);
      s.seen[i] = on_plane(transform(s.T_camera_board[0], s.corners[i]));
    }
    return s;
  }

  std::optional<MarkerDetection> locate(const Target& target, const std::vector<Sighting>& sightings) const {
    std::vector<Fit> fits;
    for (const Sighting& sighting : sightings)
      for (const Eigen::Isometry3d& T : sighting.T_camera_board) {
        const Fit fit = sightings.size() > 1 ? fitted(T, sightings) : Fit{T, 0};
        // A tracker must be able to start there.
        if (SegmentMatcher(target.model, focal_length_).project(fit.T_camera_board)) fits.push_back(fit);
      }
    if (fits.empty()) return std::nullopt;
    std::ranges::stable_sort(fits, {}, &Fit::cost_px);
    MarkerDetection detection{.id = target.board.id, .t = sightings[0].t, .T_camera_marker = fits[0].T_camera_board};
    for (const Fit& fit : fits)
      if (fit.cost_px <= kMaxAlternativeRatio * fits[0].cost_px &&
          geodesic_angle(fit.T_camera_board.linear(), fits[0].T_camera_board.linear()) > kSamePose) {
        detection.T_camera_marker_alternative = fit.T_camera_board;
        break;
      }
    detection.corners_px = box_around(target.model, detection.T_camera_marker);
    return detection;
  }

  // Gauss-Newton on the corners of all markers that were seen, Cauchy weights.
  Fit fitted(const Eigen::Isometry3d& start, const std::vector<Sighting>& sightings) const {
    Eigen::Isometry3d T = start;
    for (int iteration = 0; iteration < 10; ++iteration) {
      Matrix6d H = Matrix6d::Zero();
      Vector6d b = Vector6d::Zero();
      for (int i = 0; i < 6; ++i) H(i, i) = 1e-9;
      for_each_corner(T, sightings, [&](Vec3 P, Vec2 residual_px) {
        const double weight = 1 / (1 + squared_norm(residual_px) / (kOutlier_px * kOutlier_px));
        add_row(image_gradient({1, 0}, P, focal_length_), P - translation(T), residual_px.x, weight, H, b);
        add_row(image_gradient({0, 1}, P, focal_length_), P - translation(T), residual_px.y, weight, H, b);
      });
      const Vec6 step = Vector6d(H.ldlt().solve(b));
      if (!is_finite(step)) break;
      set_translation(T, translation(T) + step.t);
      turn(T, step.r);
      orthonormalize(T);
    }
    double cost = 0;
    int corners = 0;
    for_each_corner(T, sightings, [&](Vec3, Vec2 residual_px) {
      cost += std::min(squared_norm(residual_px), 4 * kOutlier_px * kOutlier_px);
      ++corners;
    });
    return {T, std::sqrt(cost / corners)};
  }

  // One row J = [g, lever x g] of the normal equations H x = b.
  static void add_row(Vec3 g, Vec3 lever, double residual_px, double weight, Matrix6d& H, Vector6d& b) {
    const std::array<double, 6> J = Vec6(g, cross(lever, g)).array();
    for (std::size_t k = 0; k < 6; ++k) {
      for (std::size_t i = 0; i < 6; ++i) H.data()[6 * k + i] += weight * J[i] * J[k];
      b.data()[k] += weight * J[k] * residual_px;
    }
  }

  template <typename Use>
  void for_each_corner(const Eigen::Isometry3d& T, const std::vector<Sighting>& sightings, Use&& use) const {
    for (const Sighting& sighting : sightings)
      for (std::size_t i = 0; i < 4; ++i) {
        const Vec3 P = transform(T, sighting.corners[i]);
        use(P, focal_length_ * (sighting.seen[i] - on_plane(P)));
      }
  }

  // True if the markers that were seen are where a pose of the board puts them; remembered for later frames.
  bool believable(Target& target, const std::vector<Sighting>& sightings, const Eigen::Isometry3d& T) const {
    if (sightings.size() < 2) return !target.check.refused() && !target.check.doubtful();
    const bool refused = target.check.refused();
    target.check.add(contradict(sightings, T));
    if (target.check.refused() && !refused && report_) report_(worst_pair(target.board, sightings));
    return !target.check.refused() && !target.check.doubtful();
  }

  // Half of the markers are off by more than the detector and a calibration with errors may be, or one of them is
  // somewhere else altogether.
  bool contradict(const std::vector<Sighting>& sightings, const Eigen::Isometry3d& T) const {
    constexpr double kDetector_px = 2, kCalibration = 0.005, kElsewhere = 0.25;  // of the board's, of the marker's size
    std::vector<double> off_px;
    Box box;
    bool elsewhere = false;
    for (const Sighting& sighting : sightings) {
      double squares = 0;
      for (std::size_t i = 0; i < 4; ++i) {
        squares += squared_norm(focal_length_ * (sighting.seen[i] - on_plane(transform(T, sighting.corners[i]))));
        box.extend(focal_length_ * sighting.seen[i]);
      }
      off_px.push_back(std::sqrt(squares / 4));
      elsewhere |= off_px.back() > kElsewhere * focal_length_ * norm(sighting.seen[0] - sighting.seen[2]);
    }
    const auto middle = off_px.begin() + static_cast<std::ptrdiff_t>(off_px.size() / 2);
    std::ranges::nth_element(off_px, middle);
    return elsewhere || *middle > std::hypot(kDetector_px, kCalibration * norm(box.high - box.low));
  }

  // The two markers that differ most from the file, by their own poses.
  static BoardContradiction worst_pair(const Board& board, const std::vector<Sighting>& sightings) {
    BoardContradiction worst{.board = board.id};
    for (const Sighting& a : sightings)
      for (const Sighting& b : sightings) {
        if (&a == &b) continue;
        const Eigen::Isometry3d T_camera_a = a.T_camera_board[0] * a.marker->T_board_marker;
        const Eigen::Isometry3d T_camera_b = b.T_camera_board[0] * b.marker->T_board_marker;
        const BoardContradiction pair{
            board.id, a.marker->id, b.marker->id, transform(T_camera_a.inverse(), translation(T_camera_b)),
            transform(a.marker->T_board_marker.inverse(), translation(b.marker->T_board_marker))};
        if (off(pair) > off(worst)) worst = pair;
      }
    return worst;
  }

  static double off(const BoardContradiction& pair) { return norm(Vec3(pair.seen) - Vec3(pair.in_file)); }

  // Corners of the upright rectangle in the image that holds all of the board.
  std::array<Eigen::Vector2d, 4> box_around(const MarkerModel& model, const Eigen::Isometry3d& T) const {
    Box box;
    for (const Eigen::Vector3d& vertex : model.vertices) box.extend(project_(transform(T, vertex)));
    return {box.low, Vec2(box.high.x, box.low.y), box.high, Vec2(box.low.x, box.high.y)};
  }

  Detector detector_;
  double focal_length_;
  std::function<Eigen::Vector2d(const Eigen::Vector3d&)> project_;
  std::vector<Target> targets_;
  std::function<void(const BoardContradiction&)> report_;
};

}  // namespace evmarker
