#pragma once
// A tracker's request to a detector, and the detector's result.
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/model/wireframe.hpp"

namespace evmarker {

/// A tracker's request about one frame. A self-contained value, which the detector may process later, in another
/// thread.
struct DetectionRequest {
  Timestamp t = 0;                          ///< of the frame [us]
  std::uint64_t events_in_frame = 0;        ///< EventHistory::pushed() when the frame was taken
  double focal_length = 0;                  ///< [px]
  std::vector<PlacedMarker> unconfirmed{};  ///< markers at their tracked poses, for `shows`
  std::vector<PlacedMarker> missing{};      ///< lost markers at their predicted poses, for `search`
  std::vector<PlacedMarker> tracked{};      ///< the others that are surely tracked, see GuidedDetector
};

/// What a frame shows of a marker that is tracked but not confirmed yet.
enum class Sighting {
  none,       ///< its code is not read at the tracked pose
  there,      ///< its code is read at the tracked pose
  wrong_tilt  ///< it was detected with only one possible pose, and that is clearly tilted against the tracked one
};

/// True if a wireframe can be followed from a pose on: if both are valid, and all of the wireframe is in front of the
/// camera, with a face turned to it.
inline bool can_be_followed(const MarkerModel& model, double focal_length, const Eigen::Isometry3d& T_camera_marker) {
  try {
    validate(model);
    validate_start(model, T_camera_marker);
    return SegmentMatcher(model, focal_length).project(T_camera_marker);
  } catch (const std::invalid_argument&) {
    return false;
  }
}

/// What a detector found in the frame of a request.
struct DetectionResult {
  struct Marker {
    MarkerDetection detection;
    MarkerModel model;
  };
  std::uint64_t events_in_frame = 0;  ///< that of the request
  std::vector<Marker> markers{};      ///< first those that `detect` found, then the lost ones that `search` found
  std::size_t detected = 0;           ///< how many of them `detect` found
  std::uint64_t unusable_poses = 0;   ///< no rigid motions, or not in front of the camera: left out
  std::vector<Sighting> sightings{};  ///< one for each of the request's unconfirmed markers
  bool all_tracked = false;           ///< all markers that the detector may find are tracked already
  std::vector<MarkerId> refused{};    ///< do not fit their models, see CheckingDetector

  /// Adds a marker without those of its poses from which no tracker could start; not at all if there is no other.
  void add(Marker marker, double focal_length) {
    const auto usable = [&](const Eigen::Isometry3d& T) {
      const bool can_start = can_be_followed(marker.model, focal_length, T);
      unusable_poses += !can_start;
      return can_start;
    };
    Eigen::Isometry3d& T = marker.detection.T_camera_marker;
    auto& alternative = marker.detection.T_camera_marker_alternative;
    if (alternative && !usable(*alternative)) alternative.reset();
    if (!usable(T)) {
      if (!alternative) return;
      T = *std::exchange(alternative, std::nullopt);
    }
    markers.push_back(std::move(marker));
  }

  /// The markers that `detect` found.
  std::span<const Marker> detected_markers() const noexcept { return std::span(markers).first(detected); }
};

/// How far a tracked marker may be from where it was detected [m, across the line of sight]. A code is only read where
/// its cells are right to half of one; a pose that follows wrong edges, as those of the code in place of the border's,
/// is off by a whole one. So for codes, it is three quarters of the shortest edge; for another wireframe, of whose
/// detector nothing is known, half of its size.
inline double most_off(const MarkerModel& model) noexcept {
  const auto vertex = [&](int index) { return Vec3(model.vertices[static_cast<std::size_t>(index)]); };
  if (const bool is_code = model.cells > 0 || !model.codes.empty(); !is_code) {
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& corner : model.vertices) box.extend(corner);
    return 0.5 * box.diagonal().norm();
  }
  double shortest = std::numeric_limits<double>::infinity();
  for (const MarkerSegment& segment : model.segments)
    shortest = std::min(shortest, norm(vertex(segment.to) - vertex(segment.from)));
  return 0.75 * shortest;
}

/// True if a marker at a pose is, in the image, where it was detected, at one pose or the other: all vertices are, see
/// `most_off`.
inline bool same_place(const DetectionResult::Marker& detected, const Eigen::Isometry3d& T_camera_marker) noexcept {
  const double most_m = most_off(detected.model);
  const auto near = [&](const Eigen::Isometry3d& T) {
    return std::ranges::all_of(detected.model.vertices, [&](const Eigen::Vector3d& vertex) {
      const Vec3 there = transform(T, vertex);
      return norm(there.z * (on_plane(there) - on_plane(transform(T_camera_marker, vertex)))) < most_m;
    });
  };
  const auto& [id, t, T, alternative, corners_px] = detected.detection;
  return near(T) || (alternative && near(*alternative));
}

/// True if a detection without an alternative differs from a tracked pose in its rotation, by more than 0.25 rad. That
/// the code is read at the tracked pose does not exclude this: two poses of different tilt may be only a pixel apart in
/// the image.
inline bool contradicts_tilt(const MarkerDetection& detection, const Eigen::Isometry3d& T_camera_marker) noexcept {
  constexpr double kDiffers_rad = 0.25;
  return !detection.T_camera_marker_alternative &&
         geodesic_angle(detection.T_camera_marker.linear(), T_camera_marker.linear()) > kDiffers_rad;
}

/// True if the detector can find no other markers than these, and has nothing left to check.
template <MarkerDetector Detector>
bool finds_only(Detector& detector, std::span<const PlacedMarker> markers) {
  if constexpr (CheckingDetector<Detector>)
    if (detector.checking()) return false;
  if constexpr (EnumeratingDetector<Detector>)
    return std::ranges::all_of(detector.ids(), [&](MarkerId id) {
      return std::ranges::find(markers, id, &PlacedMarker::id) != markers.end();
    });
  return false;
}

/// Detects the markers in the frame of a request.
template <MarkerDetector Detector>
auto detect(Detector& detector, const PolarityFrame& frame, const DetectionRequest& request) {
  if constexpr (GuidedDetector<Detector>)
    return detector.detect(frame, std::span(request.tracked));
  else
    return detector.detect(frame);
}

/// Answers a request: detects markers in the frame, searches for the missing ones if the detector is a
/// `SearchingDetector`, and checks the unconfirmed ones: whether they are detected at their places, or, by a
/// `VerifyingDetector`, their codes are read there. Poses from which no tracker could start, as of a detector that
/// errs, are left out and counted.
template <MarkerDetector Detector>
DetectionResult answer_request(Detector& detector, const PolarityFrame& frame, const DetectionRequest& request) {
  DetectionResult result{.events_in_frame = request.events_in_frame};
  const auto add = [&](MarkerDetection detection) {
    detection.t = request.t;
    result.add({detection, detector.model(detection.id)}, request.focal_length);
  };
  const auto find = [&](std::span<const DetectionResult::Marker> among, MarkerId id) {
    const auto found = std::ranges::find(among, id, [](const auto& marker) { return marker.detection.id; });
    return found != among.end() ? &*found : nullptr;
  };
  for (const MarkerDetection& detection : detect(detector, frame, request)) add(detection);
  result.detected = result.markers.size();
  result.all_tracked = finds_only(detector, request.tracked);
  if constexpr (CheckingDetector<Detector>) result.refused = detector.refused();

  // A search near its predicted pose finds a partly hidden marker that `detect` misses.
  if constexpr (SearchingDetector<Detector>)
    for (const auto& [id, T_camera_marker] : request.missing)
      if (find(result.markers, id) == nullptr)
        if (const auto detection = detector.search(id, T_camera_marker)) add(*detection);

  const auto there = [&](const PlacedMarker& marker, const DetectionResult::Marker* found) -> bool {
    if (found && same_place(*found, marker.T_camera_marker)) return true;
    if constexpr (VerifyingDetector<Detector>) return detector.shows(marker.id, marker.T_camera_marker);
    return false;
  };
  for (const PlacedMarker& marker : request.unconfirmed) {
    const DetectionResult::Marker* const found = find(result.detected_markers(), marker.id);
    const bool wrong_tilt = found && contradicts_tilt(found->detection, marker.T_camera_marker);
    result.sightings.push_back(wrong_tilt             ? Sighting::wrong_tilt
                               : there(marker, found) ? Sighting::there
                                                      : Sighting::none);
  }
  return result;
}

}  // namespace evmarker
