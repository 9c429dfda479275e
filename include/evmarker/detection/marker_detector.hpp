#pragma once
// What finds markers in a frame of last polarities.
#include <Eigen/Geometry>
#include <array>
#include <concepts>
#include <optional>
#include <ranges>

#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker {

/// A marker found in one frame: the pose from which a tracker starts.
struct MarkerDetection {
  MarkerId id = 0;
  Timestamp t = 0;  ///< of the frame [us]
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
  /// The second solution of a planar pose, mirrored in depth, where it fits nearly as well.
  std::optional<Eigen::Isometry3d> T_camera_marker_alternative = std::nullopt;
  /// In the (distorted) image, from the marker's top left clockwise.
  std::array<Eigen::Vector2d, 4> corners_px{Vec2(), Vec2(), Vec2(), Vec2()};
};

/// Finds markers in a frame and has their models. May be slow and may allocate; must not keep the frame. Optional
/// functions: see `answer_request`.
template <typename D>
concept MarkerDetector = requires(D& detector, const PolarityFrame& frame, MarkerId id) {
  { detector.detect(frame) } -> std::ranges::input_range;
  requires std::convertible_to<std::ranges::range_value_t<decltype(detector.detect(frame))>, MarkerDetection>;
  { detector.model(id) } -> std::convertible_to<MarkerModel>;
};

}  // namespace evmarker
