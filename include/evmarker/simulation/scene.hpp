#pragma once
// The scene before a simulated camera: moving markers, a background behind them, occluders in front.
#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/simulation/printed_marker.hpp"
#include "evmarker/simulation/trajectory.hpp"

namespace evmarker {

/// A moving printed code marker. Its back is blank paper.
struct SimulatedMarker {
  MarkerId id = 0;
  double length = 0.1;          ///< side of the black square [m]
  CodeBits bits;                ///< the cells inside the black border, 1 white
  Trajectory T_camera_marker;   ///< pose [m] over time [s]
  double quiet_zone_cells = 1;  ///< width of the white rim around the black square
  double black = 0.08;          ///< reflectance of the ink
  double white = 0.85;          ///< reflectance of the paper
  CellShades shades = {};       ///< if not empty, replaces black and white: (bits + 4) x (bits + 4) cells
};

/// The markers of a moving board.
inline std::vector<SimulatedMarker> simulated_markers(const Board& board, const Trajectory& T_camera_board) {
  std::vector<SimulatedMarker> markers;
  for (const BoardMarker& marker : board.markers)
    markers.push_back({.id = marker.id,
                       .length = marker.length,
                       .bits = marker.bits,
                       .T_camera_marker = [T_camera_board, T_board_marker = marker.T_board_marker](double seconds) {
                         return product(T_camera_board(seconds), T_board_marker);
                       }});
  return markers;
}

/// An opaque upright rectangle in front of everything else.
struct Occluder {
  std::function<Eigen::Vector2d(double seconds)> centre_px;  ///< in the distorted image
  Eigen::Vector2d half_size_px{50, 50};
  double shade = 0.3;                                        ///< its reflectance
  double from_s = -std::numeric_limits<double>::infinity();  ///< it is there from this time on
  double until_s = std::numeric_limits<double>::infinity();  ///< and until before this time
};

/// The background behind the markers: a smooth random texture of light and dark patches.
struct Background {
  double mean = 0.4;                           ///< reflectance (geometric mean)
  double contrast = 0;                         ///< largest deviation of the logarithm of the reflectance; 0: no texture
  double texture_size_px = 20;                 ///< distance between the centres of neighbouring patches
  Eigen::Vector2d velocity_px_per_s = {0, 0};  ///< in the image
  std::uint64_t seed = 1;                      ///< determines the patches

  bool moves() const noexcept { return contrast != 0 && squared_norm(Vec2(velocity_px_per_s)) != 0; }
};

/// All that the simulated camera sees.
struct Scene {
  std::vector<SimulatedMarker> markers;
  std::vector<Occluder> occluders;
  Background background;
};

/// Rejects a scene that cannot be simulated. The printed markers are checked by `PrintedMarker`.
/// @throws std::invalid_argument naming the field
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
    if (!occluder.centre_px) throw std::invalid_argument("scene: " + name + "centre_px is not set");
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
