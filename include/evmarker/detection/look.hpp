#pragma once
// A look at the polarity frame: what the detector is asked about it, and what it answers.
#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/detection/detection.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// A marker at a pose.
struct PlacedMarker {
  MarkerId id = 0;
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
};

/// What is asked about one frame. A value: the detector may answer it on another thread, later.
struct Look {
  Timestamp t = 0;                        ///< of the frame [us]
  std::uint64_t position = 0;             ///< in the history of events: those up to here are in the frame
  double focal_length = 0;                ///< [px]
  std::vector<PlacedMarker> unconfirmed;  ///< where they are tracked: does the frame show their codes there?
  std::vector<PlacedMarker> missing;      ///< where they must be by now: does the frame show them nearby?
};

/// What a frame says of a marker that was tracked from an earlier one on. `elsewhere`: it shows it, but not at that
/// pose.
enum class Sighting { none, there, elsewhere };

/// The answer.
struct Findings {
  struct Found {
    MarkerDetection detection;
    MarkerModel model;
  };
  std::uint64_t position = 0;  ///< of the look
  std::vector<Found> found;    ///< by the detector itself, and then the missing markers that were found by search
  std::size_t detected = 0;    ///< how many of them the detector found by itself
  std::vector<Sighting> sightings{};  ///< of each of the look's unconfirmed markers
};

/// Whether a pose is within half the marker's own size of where it was detected.
inline bool same_place(const MarkerDetection& detection, const Eigen::Isometry3d& T_camera_marker,
                       double focal_length) noexcept {
  const Vec2 a = on_plane(translation(detection.T_camera_marker)), b = on_plane(translation(T_camera_marker));
  const auto diagonal_px = [&](std::size_t i) {
    return norm(Vec2(detection.corners_px[i]) - Vec2(detection.corners_px[i + 2]));
  };
  return focal_length * norm(a - b) < 0.25 * (diagonal_px(0) + diagonal_px(1));
}

/// Whether a detection without an alternative has another tilt than a pose. Two such poses may be a pixel apart in the
/// image, so that the code is to be seen at both.
inline bool tilted_otherwise(const MarkerDetection& detection, const Eigen::Isometry3d& T_camera_marker) noexcept {
  constexpr double kDiffers_rad = 0.25;
  return !detection.T_camera_marker_alternative &&
         geodesic_angle(detection.T_camera_marker.linear(), T_camera_marker.linear()) > kDiffers_rad;
}

/// Asks a detector. One that has members `shows(id, T_camera_marker)` and `search(id, T_camera_marker)`, both about the
/// frame of its last look, is asked more closely.
template <MarkerDetector Detector>
Findings answer(Detector& detector, const PolarityFrame& frame, const Look& look) {
  Findings findings{.position = look.position, .found = {}};
  const auto found_by_id = [&](MarkerId id) {
    return std::ranges::find(findings.found, id, [](const auto& f) { return f.detection.id; }) != findings.found.end();
  };
  const auto add = [&](const MarkerDetection& detection) {
    findings.found.push_back({detection, detector.model(detection.id)});
  };
  for (const MarkerDetection& detection : detector.detect(frame)) add(detection);
  findings.detected = findings.found.size();

  // The detector may not find a marker by itself if a part of it is hidden.
  if constexpr (requires(MarkerId id, Eigen::Isometry3d T) { detector.search(id, T); })
    for (const auto& [id, T_camera_marker] : look.missing)
      if (!found_by_id(id))
        if (const auto detection = detector.search(id, T_camera_marker)) add(*detection);

  const auto sighting = [&](const PlacedMarker& marker) {
    const auto detected = std::span(findings.found).first(findings.detected);
    const auto found = std::ranges::find(detected, marker.id, [](const auto& f) { return f.detection.id; });
    if (found != detected.end() && tilted_otherwise(found->detection, marker.T_camera_marker))
      return Sighting::elsewhere;
    bool there = false;
    if constexpr (requires { detector.shows(marker.id, marker.T_camera_marker); })
      there = detector.shows(marker.id, marker.T_camera_marker);
    else
      there = found != detected.end() && same_place(found->detection, marker.T_camera_marker, look.focal_length);
    return there ? Sighting::there : Sighting::none;
  };
  for (const PlacedMarker& marker : look.unconfirmed) findings.sightings.push_back(sighting(marker));
  return findings;
}

}  // namespace evmarker
