#pragma once
// The light from a scene at each pixel of a camera.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/base/vector.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/simulation/marker_view.hpp"
#include "evmarker/simulation/pixel_sights.hpp"
#include "evmarker/simulation/printed_marker.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene.hpp"
#include "evmarker/simulation/texture.hpp"
#include "evmarker/simulation/tile_grid.hpp"

namespace evmarker {

/// Renders a scene through a lens, pixel by pixel and at any time. Straight edges have the exact profile of a Gaussian
/// blur.
class SceneRenderer {
 public:
  /// The light at a pixel.
  struct Sample {
    double intensity;     ///< linear
    double clearance_px;  ///< how far markers and occluders may move before it changes
    bool drifts;          ///< true if a moving background changes it all the time
  };

  /// The scene at one time.
  class Frame;

  /// Distances [px] that things move in the image between two frames.
  struct Motion {
    std::vector<double> markers, occluders;  ///< one for each in the scene; 0 unless it is visible in both frames
    double background = 0;  ///< that of an edge that would change the light as fast: less, as a texture is smoother
    double largest = 0;     ///< of all, the background's unscaled
  };

  /// The things that can change the light in one tile between two frames.
  struct Activity {
    std::vector<std::size_t> markers, occluders;  ///< indices in the scene
    double motion_px = 0;                         ///< largest motion among them, the background excepted
    std::uint64_t contents = 0;                   ///< hash of their indices, visibility and visible sides
  };

  /// @param point_spread_px sigma of the blur by lens and pixel area together (the area alone: 0.29 px)
  /// @throws std::invalid_argument naming the field of the scene, or the argument, that makes no sense
  SceneRenderer(const PinholeCamera& camera, Scene scene, double point_spread_px)
      : camera_(camera),
        scene_(checked(std::move(scene))),
        point_spread_px_(point_spread_px),
        fisheye_(std::holds_alternative<EquidistantDistortion>(camera.distortion())),
        grid_(camera.sensor_size()),
        texture_(scene_.background),
        sights_(camera, grid_) {
    if (!(std::isfinite(point_spread_px) && point_spread_px > 0))
      throw std::invalid_argument("scene renderer: point_spread_px is " + number_text(point_spread_px));
    for (const auto& marker : scene_.markers)
      prints_.emplace_back(marker.bits, marker.quiet_zone_cells, marker.black, marker.white, marker.shades);
    for (std::size_t i = 0; i < prints_.size(); ++i) everything_.markers.push_back(i);
    for (std::size_t i = 0; i < scene_.occluders.size(); ++i) everything_.occluders.push_back(i);
  }

  const PinholeCamera& camera() const noexcept { return camera_; }
  const Scene& scene() const noexcept { return scene_; }
  const TileGrid& grid() const noexcept { return grid_; }

  /// The scene at a time [s].
  Frame at(double seconds) const;
  /// Motion between two frames.
  Motion motion(const Frame& from, const Frame& to) const;
  /// Largest distance [px] that anything visible moves between two frames.
  double motion_px(const Frame& from, const Frame& to) const { return motion(from, to).largest; }

  /// Computes the activity in a tile between two frames; it is written to `activity`, whose memory is used again.
  /// @param motion that between the frames
  void compute_activity(std::size_t tile, const Frame& from, const Frame& to, const Motion& motion,
                        Activity& activity) const;

  /// The light at a pixel of the sensor.
  /// @param index of the pixel in the grid
  /// @param activity that of the pixel's tile between this frame and another; only its markers and occluders are drawn
  Sample sample(const Frame& frame, std::size_t index, const Activity& activity) const;
  Sample sample(const Frame& frame, int x, int y) const { return sample(frame, grid_.index(x, y), everything_); }

  /// Linear intensity of the whole image, row by row.
  std::vector<float> render(double seconds) const;

 private:
  static Scene checked(Scene scene) {
    validate(scene);
    return scene;
  }

  PinholeCamera camera_;
  Scene scene_;
  double point_spread_px_;
  bool fisheye_;
  TileGrid grid_;
  Texture texture_;
  std::vector<PrintedMarker> prints_;
  Activity everything_;  // all markers and occluders of the scene
  PixelSights sights_;
};

class SceneRenderer::Frame {
 public:
  double seconds = 0;

 private:
  friend class SceneRenderer;

  struct OccluderView {
    bool visible = false;
    Vec2 centre;
  };
  std::vector<MarkerView> markers_;
  std::vector<OccluderView> occluders_;
};

inline SceneRenderer::Frame SceneRenderer::at(double seconds) const {
  Frame frame;
  frame.seconds = seconds;
  frame.markers_.reserve(prints_.size());
  for (std::size_t i = 0; i < prints_.size(); ++i)
    frame.markers_.emplace_back(prints_[i], scene_.markers[i].length, scene_.markers[i].T_camera_marker(seconds));
  frame.occluders_.reserve(scene_.occluders.size());
  for (const auto& occluder : scene_.occluders) {
    auto& view = frame.occluders_.emplace_back();
    if (seconds < occluder.from_s || seconds >= occluder.until_s) continue;
    view.centre = occluder.centre_px(seconds);
    view.visible = is_finite(view.centre);
  }
  return frame;
}

inline SceneRenderer::Sample SceneRenderer::sample(const Frame& frame, std::size_t index,
                                                   const Activity& activity) const {
  const Vec2 pixel =
      sights_.tile(TileGrid::tile(index)).corner + Vec2(static_cast<double>(index % TileGrid::kSide),
                                                        static_cast<double>(index / TileGrid::kSide % TileGrid::kSide));
  double light = 0, remaining = 1, clearance = std::numeric_limits<double>::infinity();

  for (const std::size_t i : activity.occluders) {
    const auto& view = frame.occluders_[i];
    if (!view.visible) continue;
    const Vec2 half_size = scene_.occluders[i].half_size_px, from_centre = pixel - view.centre;
    const Vec2 inside{half_size.x - std::abs(from_centre.x), half_size.y - std::abs(from_centre.y)};
    clearance = std::min(clearance, std::abs(std::min(inside.x, inside.y)) - kEdgeReach * point_spread_px_);
    const auto profile = [&](double near_side, double half) {
      const double far_side = 2 * half - near_side;
      return edge_profile(near_side / point_spread_px_) + edge_profile(far_side / point_spread_px_) - 1;
    };
    const double coverage = profile(inside.x, half_size.x) * profile(inside.y, half_size.y);
    light += remaining * coverage * scene_.occluders[i].shade;
    remaining *= 1 - coverage;
  }

  std::array<MarkerView::Sample, 8> sheets;  // the nearest ones, nearest first; others are left out
  std::size_t count = 0;
  const Sight& sight = sights_.pixel(index);
  if (fisheye_) clearance = std::min(clearance, fisheye_reach_px(sight, camera_.focal_length()));
  if (remaining > 0 && sight.exists())
    for (const std::size_t i : activity.markers) {
      const auto sheet = frame.markers_[i].sample(prints_[i], sight, point_spread_px_);
      clearance = std::min(clearance, sheet.clearance_px);
      if (sheet.coverage == 0) continue;
      if (count == sheets.size() && sheets.back().inverse_depth >= sheet.inverse_depth) continue;
      std::size_t place = count < sheets.size() ? count++ : count - 1;
      for (; place > 0 && sheets[place - 1].inverse_depth < sheet.inverse_depth; --place)
        sheets[place] = sheets[place - 1];
      sheets[place] = sheet;
    }
  for (std::size_t i = 0; i < count; ++i) {
    light += remaining * sheets[i].radiance;
    remaining *= 1 - sheets[i].coverage;
  }
  if (remaining > 0) {
    light += remaining * texture_.intensity(pixel, frame.seconds);
  }
  return {light, std::max(clearance, 0.0), remaining > 0 && texture_.moves()};
}

inline SceneRenderer::Motion SceneRenderer::motion(const Frame& from, const Frame& to) const {
  Motion motion;
  if (texture_.moves()) {
    motion.largest = norm(Vec2(scene_.background.velocity_px_per_s)) * std::abs(to.seconds - from.seconds);
    // A texture is at most as steep as an edge with a blur of a fifth of the distance between its patches.
    motion.background = motion.largest * std::min(1.0, point_spread_px_ / (0.2 * scene_.background.texture_size_px));
  }
  // Points far outside of the field of view do not matter, and a lens model may project them anywhere.
  const auto in_sight = [&](Vec2 m) { return norm(m) < 1.3 * sights_.largest_tangent(); };
  const auto pixel = [&](Vec2 m) -> Vec2 { return camera_.project({m.x, m.y, 1}); };
  for (std::size_t i = 0; i < from.markers_.size(); ++i) {
    double& largest = motion.markers.emplace_back(0);
    if (!from.markers_[i].visible() || !to.markers_[i].visible()) continue;
    const auto &before = from.markers_[i].probes(), &after = to.markers_[i].probes();
    for (std::size_t probe = 0; probe < before.size(); ++probe)
      if (in_sight(before[probe]) || in_sight(after[probe])) {
        const Vec2 moved = pixel(after[probe]) - pixel(before[probe]);
        if (is_finite(moved)) largest = std::max(largest, norm(moved));
      }
    motion.largest = std::max(motion.largest, largest);
  }
  for (std::size_t i = 0; i < from.occluders_.size(); ++i) {
    const auto &before = from.occluders_[i], &after = to.occluders_[i];
    const bool moves = before.visible && after.visible;
    motion.occluders.push_back(moves ? norm(after.centre - before.centre) : 0);
    motion.largest = std::max(motion.largest, motion.occluders.back());
  }
  return motion;
}

inline void SceneRenderer::compute_activity(std::size_t tile, const Frame& from, const Frame& to, const Motion& motion,
                                            Activity& activity) const {
  activity.markers.clear();
  activity.occluders.clear();
  activity.motion_px = 0;
  activity.contents = 0;
  const auto add = [&](std::vector<std::size_t>& list, std::size_t i, double motion_px, std::uint64_t appearance) {
    list.push_back(i);
    activity.motion_px = std::max(activity.motion_px, motion_px);
    activity.contents = mix_bits(activity.contents + appearance) + i + 1;
  };
  const double margin = 2 * kEdgeReach * point_spread_px_;
  const TileSight& sight = sights_.tile(tile);
  for (std::size_t i = 0; i < from.markers_.size(); ++i) {
    const auto &before = from.markers_[i], &after = to.markers_[i];
    const auto reaches = [&](const MarkerView& view) {
      return view.visible() && !(view.distance_px(sight.centre) > sight.radius_px + motion.markers[i] + margin);
    };
    if (reaches(before) || reaches(after))
      add(activity.markers, i, motion.markers[i],
          1 + before.visible() + 2u * after.visible() + 4u * before.back() + 8u * after.back());
  }
  const Vec2 centre = sight.corner + Vec2(TileGrid::kSide / 2, TileGrid::kSide / 2);
  for (std::size_t i = 0; i < from.occluders_.size(); ++i) {
    const auto &before = from.occluders_[i], &after = to.occluders_[i];
    const auto reaches = [&](const Frame::OccluderView& view) {
      const Vec2 away = centre - view.centre, half_size = scene_.occluders[i].half_size_px;
      const double outside = std::max(std::abs(away.x) - half_size.x, std::abs(away.y) - half_size.y);
      return view.visible && outside < TileGrid::kSide / 2 + motion.occluders[i] + margin;
    };
    if (reaches(before) || reaches(after))
      add(activity.occluders, i, motion.occluders[i], 17 + before.visible + 2u * after.visible);
  }
}

inline std::vector<float> SceneRenderer::render(double seconds) const {
  const SensorSize size = camera_.sensor_size();
  const Frame frame = at(seconds);
  std::vector<float> image;
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) image.push_back(static_cast<float>(sample(frame, x, y).intensity));
  return image;
}

}  // namespace evmarker
