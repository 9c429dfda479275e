#pragma once
// What a simulated camera looks at: markers in motion, a background, things in between.
#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/simulation/printed_marker.hpp"
#include "evmarker/simulation/trajectory.hpp"

namespace evmarker {

/// A printed code marker on its way through the scene. Seen from behind it is blank paper.
struct SimulatedMarker {
  MarkerId id = 0;
  double length = 0.1;          ///< side of the black square [m]
  CodeBits bits;                ///< the cells inside the black border, 1 white
  Trajectory T_camera_marker;   ///< pose [m] over time [s]
  double quiet_zone_cells = 1;  ///< width of the white rim around the black square
  double black = 0.08;          ///< share of the light that the ink sends back
  double white = 0.85;          ///< and the paper
  CellShades shades = {};       ///< in their place, where cells differ: (bits + 4) x (bits + 4) of them; else empty
};

/// The markers of a board on its way through the scene.
inline std::vector<SimulatedMarker> simulated_markers(const Board& board, const Trajectory& T_camera_board) {
  std::vector<SimulatedMarker> markers;
  for (const BoardMarker& marker : board.markers)
    markers.push_back({.id = marker.id,
                       .length = marker.length,
                       .bits = marker.bits,
                       .T_camera_marker = [T_camera_board, T_board_marker = marker.T_board_marker](double seconds) {
                         return T_camera_board(seconds) * T_board_marker;
                       }});
  return markers;
}

/// An opaque upright rectangle in front of everything else.
struct Occluder {
  std::function<Eigen::Vector2d(double seconds)> center_px;  ///< in the (distorted) image
  Eigen::Vector2d half_size_px{50, 50};
  double shade = 0.3;  ///< share of the light that it sends back
  double from_s = -std::numeric_limits<double>::infinity();
  double until_s = std::numeric_limits<double>::infinity();  ///< not there from here on
};

/// What lies behind the markers: a random texture, blurred already, on which light and dark patches follow each other.
struct Background {
  double mean = 0.4;                           ///< share of the light that it sends back
  double contrast = 0;                         ///< largest deviation of its logarithm; 0 is plain
  double texture_size_px = 20;                 ///< distance between independent patches
  Eigen::Vector2d velocity_px_per_s = {0, 0};  ///< in the image
  std::uint64_t seed = 1;                      ///< of the patches

  bool moves() const noexcept { return contrast != 0 && squared_norm(Vec2(velocity_px_per_s)) != 0; }
};

/// All of it.
struct Scene {
  std::vector<SimulatedMarker> markers;
  std::vector<Occluder> occluders;
  Background background;
};

/// Rejects a scene that cannot be simulated, with an error that names the field.
inline void validate(const Scene& scene) {
  const Require require("scene");
  for (std::size_t i = 0; i < scene.markers.size(); ++i) {
    const auto& marker = scene.markers[i];
    const std::string name = "marker " + std::to_string(i) + ": ";
    require.positive(marker.length, name + "length");
    if (!marker.T_camera_marker) throw std::invalid_argument("scene: " + name + "T_camera_marker is not set");
    if (!is_finite(marker.T_camera_marker(0)))
      throw std::invalid_argument("scene: " + name + "T_camera_marker is not finite at 0 s");
  }
  for (std::size_t i = 0; i < scene.occluders.size(); ++i) {
    const auto& occluder = scene.occluders[i];
    const std::string name = "occluder " + std::to_string(i) + ": ";
    if (!occluder.center_px) throw std::invalid_argument("scene: " + name + "center_px is not set");
    require.positive(occluder.half_size_px.x(), name + "half_size_px");
    require.positive(occluder.half_size_px.y(), name + "half_size_px");
    require.positive(occluder.shade, name + "shade");
    require(occluder.from_s < occluder.until_s, name + "until_s (against from_s)", occluder.until_s);
  }
  const auto& background = scene.background;
  require.positive(background.mean, "background: mean");
  require.not_negative(background.contrast, "background: contrast");
  require.positive(background.texture_size_px, "background: texture_size_px");
  const Vec2 velocity = background.velocity_px_per_s;
  require(is_finite(velocity), "background: velocity_px_per_s", velocity.x + velocity.y);
}

}  // namespace evmarker
