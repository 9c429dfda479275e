#pragma once
// Detects boards by their markers.
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/detection/board_check.hpp"
#include "evmarker/detection/board_fit.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// A `MarkerDetector` that makes one detection of a board from the markers of it that another detector finds, and
/// passes on the markers that are on no board. One marker of a board is enough. Where several are detected, the pose is
/// fitted to the corners of all, which also decides between the two poses of a planar marker. A board whose markers are
/// seen at other places than its file says is not reported, see `BoardCheck`. One marker alone cannot contradict the
/// file: it is enough until others are seen, but not after these have contradicted. It verifies and searches if the
/// other detector does: boards by any of their markers. It is a `CheckingDetector`.
template <MarkerDetector Detector>
class BoardDetector {
 public:
  /// @param detector must find the boards' markers; the marker length that it assumes does not matter
  /// @param report called by `detect` each time that a board begins to be refused
  /// @throws std::invalid_argument naming the fault of a board, or an id or a marker that two boards share
  template <CameraModel Camera>
  BoardDetector(const Camera& camera, Detector detector, std::vector<Board> boards,
                std::function<void(const BoardContradiction&)> report = {})
      : detector_(std::move(detector)), focal_length_(camera.focal_length()), report_(std::move(report)) {
    project_ = [camera](const Eigen::Vector3d& point) -> Eigen::Vector2d { return camera.project(point); };
    for (Board& board : boards) {
      for (const Target& other : targets_) require_distinct(board, other.board);
      MarkerModel model = make_board_model(board);
      targets_.push_back({std::move(board), std::move(model)});
    }
  }

  /// Detects the markers on no board and the boards that a frame shows; the boards come last.
  std::vector<MarkerDetection> detect(const PolarityFrame& frame) { return boards_of(detector_.detect(frame)); }

  /// See GuidedDetector.
  std::vector<MarkerDetection> detect(const PolarityFrame& frame,
                                      std::span<const PlacedMarker> tracked) requires GuidedDetector<Detector> {
    return boards_of(detector_.detect(frame, markers_of(tracked)));
  }

  /// See CheckingDetector. Of one marker alone nothing can be told.
  bool checking() const {
    return std::ranges::any_of(targets_,
                               [](const Target& target) { return target.several_seen && !target.check.settled(); });
  }
  /// The boards that do not fit their files.
  std::vector<MarkerId> refused() const {
    std::vector<MarkerId> boards;
    for (const Target& target : targets_)
      if (target.check.refused()) boards.push_back(target.board.id);
    return boards;
  }

  /// See EnumeratingDetector.
  std::vector<MarkerId> ids() requires EnumeratingDetector<Detector> {
    std::vector<MarkerId> all = detector_.ids();
    std::erase_if(all, [&](MarkerId id) { return place_of(id).has_value(); });
    for (const Target& target : targets_) all.push_back(target.board.id);
    return all;
  }

  /// The wireframe of a board, or of a marker.
  MarkerModel model(MarkerId id) {
    const std::optional<std::size_t> target = target_of(id);
    return target ? targets_[*target].model : detector_.model(id);
  }

  /// See VerifyingDetector.
  bool shows(MarkerId id, const Eigen::Isometry3d& T) requires VerifyingDetector<Detector> {
    const std::optional<std::size_t> target = target_of(id);
    if (!target) return detector_.shows(id, T);
    return std::ranges::any_of(targets_[*target].board.markers, [&](const BoardMarker& marker) {
      return detector_.shows(marker.id, as_assumed(marker, product(T, marker.T_board_marker)));
    });
  }

  /// See SearchingDetector.
  std::optional<MarkerDetection> search(MarkerId id, const Eigen::Isometry3d& T) requires SearchingDetector<Detector> {
    const std::optional<std::size_t> target = target_of(id);
    if (!target) return detector_.search(id, T);
    std::vector<SeenMarker> seen;
    for (const BoardMarker& marker : targets_[*target].board.markers)
      if (const auto detection = detector_.search(marker.id, as_assumed(marker, product(T, marker.T_board_marker))))
        seen.push_back(seen_marker(marker, *detection));
    return seen.empty() || targets_[*target].check.refused() ? std::nullopt : locate(targets_[*target], seen);
  }

 private:
  struct Target {
    Board board;
    MarkerModel model;
    BoardCheck check{};
    bool several_seen = false;  // in the last frame
  };
  static constexpr double kSamePose = 0.03;  // [rad]: two fits nearer than this are one pose
  // The second pose is reported as an alternative if its error is at most so many times larger.
  static constexpr double kMaxAlternativeRatio = 2.0;
  // A deviation of the markers' size that is larger tells neither that the file is right nor that it is wrong.
  static constexpr double kUnclear = 0.5;

  // Throws if two boards share their id or a marker.
  static void require_distinct(const Board& a, const Board& b) {
    if (a.id == b.id) throw std::invalid_argument("board " + std::to_string(a.id) + " is there twice");
    for (const BoardMarker& marker : a.markers)
      if (std::ranges::find(b.markers, marker.id, &BoardMarker::id) != b.markers.end())
        throw std::invalid_argument("marker " + std::to_string(marker.id) + " is on board " + std::to_string(b.id) +
                                    " and on board " + std::to_string(a.id));
  }

  // The number of the board with this id; nothing for the id of a marker.
  std::optional<std::size_t> target_of(MarkerId id) const noexcept {
    for (std::size_t i = 0; i < targets_.size(); ++i)
      if (targets_[i].board.id == id) return i;
    return std::nullopt;
  }

  // How many times larger a marker is than the detector assumes. A larger one looks the same, but is farther away in
  // proportion.
  double scale(const BoardMarker& marker) {
    double assumed = 0;
    for (const Eigen::Vector3d& vertex : detector_.model(marker.id).vertices)
      assumed = std::max(assumed, 2 * std::abs(vertex.x()));
    return marker.length / assumed;
  }
  // The pose at which a marker of the size that the detector assumes has the image of this one at T.
  Eigen::Isometry3d as_assumed(const BoardMarker& marker, Eigen::Isometry3d T) {
    set_translation(T, 1 / scale(marker) * translation(T));
    return T;
  }

  // The boards that these detections show, after the markers that are on no board.
  template <typename Detections>
  std::vector<MarkerDetection> boards_of(const Detections& detections) {
    std::vector<MarkerDetection> found;
    std::vector<std::vector<SeenMarker>> seen_markers(targets_.size());
    for (const MarkerDetection& detection : detections)
      if (const auto place = place_of(detection.id))
        seen_markers[place->target].push_back(seen_marker(*place->marker, detection));
      else
        found.push_back(detection);
    for (std::size_t i = 0; i < targets_.size(); ++i) {
      targets_[i].several_seen = seen_markers[i].size() > 1;
      if (seen_markers[i].empty()) continue;
      auto detection = locate(targets_[i], seen_markers[i]);
      if (detection && update_check(targets_[i], seen_markers[i], detection->T_camera_marker))
        found.push_back(*std::move(detection));
    }
    return found;
  }

  // The markers of the tracked boards, and the tracked markers on no board. Not those of a board whose file is being
  // checked: where they are tracked, they fit it anyway.
  std::vector<PlacedMarker> markers_of(std::span<const PlacedMarker> tracked) {
    std::vector<PlacedMarker> markers;
    for (const auto& [id, T] : tracked)
      if (const auto target = target_of(id); !target)
        markers.push_back({id, T});
      else if (targets_[*target].check.settled())
        for (const BoardMarker& marker : targets_[*target].board.markers)
          markers.push_back({marker.id, as_assumed(marker, product(T, marker.T_board_marker))});
    return markers;
  }

  // Where a marker is; nothing if it is on no board.
  struct Place {
    std::size_t target;
    const BoardMarker* marker;
  };
  std::optional<Place> place_of(MarkerId id) const noexcept {
    for (std::size_t target = 0; target < targets_.size(); ++target)
      for (const BoardMarker& marker : targets_[target].board.markers)
        if (marker.id == id) return Place{target, &marker};
    return std::nullopt;
  }

  SeenMarker seen_marker(const BoardMarker& marker, const MarkerDetection& detection) {
    const auto T_camera_marker = [larger = scale(marker)](Eigen::Isometry3d T) {
      set_translation(T, larger * translation(T));
      return T;
    };
    SeenMarker s{&marker, detection.t, {}, {}, {}};
    const Eigen::Isometry3d T_marker_board = inverse(marker.T_board_marker);
    s.T_camera_board.push_back(product(T_camera_marker(detection.T_camera_marker), T_marker_board));
    if (detection.T_camera_marker_alternative)
      s.T_camera_board.push_back(product(T_camera_marker(*detection.T_camera_marker_alternative), T_marker_board));
    const auto square = make_square_marker(marker.length).vertices;
    for (std::size_t i = 0; i < 4; ++i) {
      s.corners[i] = transform(marker.T_board_marker, square[i]);
      s.seen[i] = on_plane(transform(s.T_camera_board[0], s.corners[i]));
    }
    return s;
  }

  // The detection of a board at the pose that fits the seen markers best; nothing if no tracker could start there.
  std::optional<MarkerDetection> locate(const Target& target, const std::vector<SeenMarker>& seen_markers) const {
    std::vector<BoardFit> fits;
    for (const SeenMarker& marker : seen_markers)
      for (const Eigen::Isometry3d& T : marker.T_camera_board) {
        const BoardFit fit = seen_markers.size() > 1 ? fit_board(T, seen_markers, focal_length_) : BoardFit{T, 0};
        // A tracker can start only where the matcher can project the board.
        if (SegmentMatcher(target.model, focal_length_).project(fit.T_camera_board)) fits.push_back(fit);
      }
    if (fits.empty()) return std::nullopt;
    std::ranges::stable_sort(fits, {}, &BoardFit::cost_px);
    MarkerDetection detection{.id = target.board.id, .t = seen_markers[0].t, .T_camera_marker = fits[0].T_camera_board};
    for (const BoardFit& fit : fits)
      if (fit.cost_px <= kMaxAlternativeRatio * fits[0].cost_px &&
          geodesic_angle(fit.T_camera_board.linear(), fits[0].T_camera_board.linear()) > kSamePose) {
        detection.T_camera_marker_alternative = fit.T_camera_board;
        break;
      }
    detection.corners_px = box_around(target.model, detection.T_camera_marker);
    return detection;
  }

  // Counts in the board's check whether the seen markers fit its pose. Returns true if the board may be tracked.
  bool update_check(Target& target, const std::vector<SeenMarker>& seen_markers, const Eigen::Isometry3d& T) const {
    if (seen_markers.size() < 2) return !target.check.refused() && !target.check.doubtful();
    const bool refused = target.check.refused();
    const MarkerScale scale = fit_marker_scale(T, seen_markers, focal_length_);
    const double size = size_deviation(seen_markers, scale, focal_length_);
    const bool other_size = size > 1, contradicts = other_size || contradicts_places(seen_markers, T, focal_length_);
    if (contradicts || size < kUnclear) target.check.add(contradicts);
    if (target.check.refused() && !refused && report_)
      report_(worst_contradiction(target.board.id, seen_markers, other_size ? scale.value : 1));
    return !target.check.refused() && !target.check.doubtful();
  }

  // Corners of the smallest upright rectangle in the image that contains the board.
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
