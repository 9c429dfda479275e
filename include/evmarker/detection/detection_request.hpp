#pragma once
// A tracker's request to a detector, and the detector's result.
#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// A marker at a pose.
struct PlacedMarker {
  MarkerId id = 0;
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
};

/// A tracker's request about one frame. A self-contained value, which the detector may process later, in another
/// thread.
struct DetectionRequest {
  Timestamp t = 0;                        ///< of the frame [us]
  std::uint64_t events_in_frame = 0;      ///< EventHistory::pushed() when the frame was taken
  double focal_length = 0;                ///< [px]
  std::vector<PlacedMarker> unconfirmed;  ///< markers at their tracked poses, for `shows`
  std::vector<PlacedMarker> missing;      ///< lost markers at their predicted poses, for `search`
};

/// What a frame shows of a marker that is tracked but not confirmed yet.
enum class Sighting {
  none,       ///< its code is not read at the tracked pose
  there,      ///< its code is read at the tracked pose
  wrong_tilt  ///< it was detected with only one possible pose, and that is clearly tilted against the tracked one
};

/// What a detector found in the frame of a request.
struct DetectionResult {
  struct Marker {
    MarkerDetection detection;
    MarkerModel model;
  };
  std::uint64_t events_in_frame = 0;  ///< that of the request
  std::vector<Marker> markers{};      ///< first those that `detect` found, then the lost ones that `search` found
  std::size_t detected = 0;           ///< how many of them `detect` found
  std::vector<Sighting> sightings{};  ///< one for each of the request's unconfirmed markers

  /// The markers that `detect` found.
  std::span<const Marker> detected_markers() const noexcept { return std::span(markers).first(detected); }
};

/// True if the marker's centre at a pose is, in the image, less than half of the detected marker's mean diagonal from
/// its centre as detected.
inline bool same_place(const MarkerDetection& detection, const Eigen::Isometry3d& T_camera_marker,
                       double focal_length) noexcept {
  const Vec2 a = on_plane(translation(detection.T_camera_marker)), b = on_plane(translation(T_camera_marker));
  const auto diagonal_px = [&](std::size_t i) {
    return norm(Vec2(detection.corners_px[i]) - Vec2(detection.corners_px[i + 2]));
  };
  return focal_length * norm(a - b) < 0.25 * (diagonal_px(0) + diagonal_px(1));
}

/// True if a detection without an alternative differs from a tracked pose in its rotation, by more than 0.25 rad. That
/// the code is read at the tracked pose does not exclude this: two poses of different tilt may be only a pixel apart in
/// the image.
inline bool contradicts_tilt(const MarkerDetection& detection, const Eigen::Isometry3d& T_camera_marker) noexcept {
  constexpr double kDiffers_rad = 0.25;
  return !detection.T_camera_marker_alternative &&
         geodesic_angle(detection.T_camera_marker.linear(), T_camera_marker.linear()) > kDiffers_rad;
}

/// Answers a request: detects markers in the frame, searches for the missing ones, and checks the unconfirmed ones. A
/// detector may have two more functions, about the frame that `detect` was given last:
///
///     bool shows(MarkerId, const Eigen::Isometry3d&)                             is this marker's code at this pose?
///     std::optional<MarkerDetection> search(MarkerId, const Eigen::Isometry3d&)  is this marker near this pose?
template <MarkerDetector Detector>
DetectionResult answer_request(Detector& detector, const PolarityFrame& frame, const DetectionRequest& request) {
  DetectionResult result{.events_in_frame = request.events_in_frame};
  const auto add = [&](const MarkerDetection& detection) {
    result.markers.push_back({detection, detector.model(detection.id)});
  };
  const auto find = [&](std::span<const DetectionResult::Marker> among, MarkerId id) {
    const auto found = std::ranges::find(among, id, [](const auto& marker) { return marker.detection.id; });
    return found != among.end() ? &found->detection : nullptr;
  };
  for (const MarkerDetection& detection : detector.detect(frame)) add(detection);
  result.detected = result.markers.size();

  // A search near its predicted pose finds a partly hidden marker that `detect` misses.
  if constexpr (requires(MarkerId id, Eigen::Isometry3d T) { detector.search(id, T); })
    for (const auto& [id, T_camera_marker] : request.missing)
      if (find(result.markers, id) == nullptr)
        if (const auto detection = detector.search(id, T_camera_marker)) add(*detection);

  const auto shows = [&](const PlacedMarker& marker, [[maybe_unused]] const MarkerDetection* detection) -> bool {
    if constexpr (requires { detector.shows(marker.id, marker.T_camera_marker); })
      return detector.shows(marker.id, marker.T_camera_marker);
    else
      return detection && same_place(*detection, marker.T_camera_marker, request.focal_length);
  };
  for (const PlacedMarker& marker : request.unconfirmed) {
    const MarkerDetection* const detection = find(result.detected_markers(), marker.id);
    const bool wrong_tilt = detection && contradicts_tilt(*detection, marker.T_camera_marker);
    result.sightings.push_back(wrong_tilt                 ? Sighting::wrong_tilt
                               : shows(marker, detection) ? Sighting::there
                                                          : Sighting::none);
  }
  return result;
}

}  // namespace evmarker
