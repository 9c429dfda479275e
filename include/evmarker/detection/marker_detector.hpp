#pragma once
// The concept of a detector that finds markers in a polarity frame.
#include <Eigen/Geometry>
#include <array>
#include <concepts>
#include <optional>
#include <ranges>
#include <span>
#include <vector>

#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// A marker that was found in one frame, with the pose from which a tracker starts.
struct MarkerDetection {
  MarkerId id = 0;
  Timestamp t = 0;  ///< of the frame [us]; set by `answer_request`
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
  /// The second solution for the pose of a planar marker, mirrored in depth, if it fits nearly as well.
  std::optional<Eigen::Isometry3d> T_camera_marker_alternative = std::nullopt;
  /// Corners in the distorted image [px], from the marker's top left clockwise; for pictures, no tracker needs them.
  std::array<Eigen::Vector2d, 4> corners_px{Vec2(), Vec2(), Vec2(), Vec2()};
};

/// A marker at a pose.
struct PlacedMarker {
  MarkerId id = 0;
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
};

/// A detector finds markers in a frame and returns their models. It may be slow, may allocate and may throw; it must
/// not keep the frame. A tracked marker that it finds elsewhere again and again is replaced; a cell of its code aside
/// is elsewhere, see `most_off`.
template <typename D>
concept MarkerDetector = requires(D& detector, const PolarityFrame& frame, MarkerId id) {
  { detector.detect(frame) } -> std::ranges::input_range;
  requires std::convertible_to<std::ranges::range_value_t<decltype(detector.detect(frame))>, MarkerDetection>;
  { detector.model(id) } -> std::convertible_to<MarkerModel>;
};

/// A detector that can also check whether the last frame given to `detect` shows a marker's code at a pose.
template <typename D>
concept VerifyingDetector = MarkerDetector<D> && requires(D& detector, MarkerId id, const Eigen::Isometry3d& T) {
  { detector.shows(id, T) } -> std::same_as<bool>;
};

/// A detector that can also search that frame for a marker near a pose, more thoroughly than `detect`.
template <typename D>
concept SearchingDetector = MarkerDetector<D> && requires(D& detector, MarkerId id, const Eigen::Isometry3d& T) {
  { detector.search(id, T) } -> std::same_as<std::optional<MarkerDetection>>;
};

/// A detector that need not look closely at markers that are tracked already: what it reads where they are tracked, it
/// reports at the tracked pose.
template <typename D>
concept GuidedDetector = MarkerDetector<D> &&
    requires(D& detector, const PolarityFrame& frame, std::span<const PlacedMarker> tracked) {
  { detector.detect(frame, tracked) } -> std::same_as<decltype(detector.detect(frame))>;
};

/// A detector that checks whether what a marker or board shows fits its model. While it has not seen enough for that,
/// it is asked often, and what it refuses is no longer tracked.
template <typename D>
concept CheckingDetector = MarkerDetector<D> && requires(const D& detector) {
  { detector.checking() } -> std::same_as<bool>;  // true while the last frame leaves it in doubt
  { detector.refused() } -> std::same_as<std::vector<MarkerId>>;
};

/// A detector that names all markers that it may ever find: while all of them are tracked, it is seldom asked.
template <typename D>
concept EnumeratingDetector = MarkerDetector<D> && requires(D& detector) {
  { detector.ids() } -> std::same_as<std::vector<MarkerId>>;
};

}  // namespace evmarker
