#pragma once
// Floor 3. The light that a scene sends to each pixel of a camera.
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/camera.hpp"
#include "evmarker/printed_marker.hpp"
#include "evmarker/scene.hpp"

namespace evmarker {

/// A scene through a lens, pixel by pixel and at any time. Every edge has the exact profile of a Gaussian point spread.
class SceneRenderer {
 public:
  /// Light at a pixel, and how far [px] the edges of the scene may move before it changes.
  struct Sample {
    double intensity;
    double clearance_px;
  };

  /// The scene at one time.
  class Frame;

  /// @param point_spread_px sigma of the blur, lens and pixel area together (the area alone has 0.29 px)
  SceneRenderer(const PinholeCamera& camera, Scene scene, double point_spread_px)
      : camera_(camera), scene_(std::move(scene)), point_spread_px_(point_spread_px) {
    if (!(std::isfinite(point_spread_px) && point_spread_px > 0))
      throw std::invalid_argument("scene renderer: point_spread_px is " + std::to_string(point_spread_px));
    validate(scene_);
    for (const auto& marker : scene_.markers)
      prints_.emplace_back(marker.bits, marker.quiet_zone_cells, marker.black, marker.white);
    compute_sights();
  }

  const PinholeCamera& camera() const noexcept { return camera_; }
  const Scene& scene() const noexcept { return scene_; }

  Frame at(double seconds) const;
  Sample sample(const Frame& frame, int x, int y) const;

  /// Largest distance [px] that anything visible moves from one frame to another.
  double motion_px(const Frame& from, const Frame& to) const;

  /// Whether something came or went from one frame to another other than by moving.
  bool appearance_changes(const Frame& from, const Frame& to) const;

  /// Linear intensity of the whole image, row by row.
  std::vector<float> render(double seconds) const;

 private:
  // Line of sight of a pixel and its change from pixel to pixel. In single precision, so that many fit the processor's
  // cache: that moves a pixel by less than 1e-4 px, and always by the same.
  struct Sight {
    Eigen::Vector2f m;
    Eigen::Matrix2f per_px;
  };

  void compute_sights();
  void blend_marker(std::size_t index, const Frame& frame, const Sight& sight, auto&& add_layer,
                    double& clearance) const;

  // Clearances are linear extrapolations: kept on the safe side of lens and perspective. A pixel may sleep until an
  // edge is within 3.5 sigma, where the light has changed by 2e-4 of the step, and then takes the change as part of a
  // ramp.
  double safe_clearance(double distance_px) const { return 0.85 * distance_px - 3.5 * point_spread_px_; }

  PinholeCamera camera_;
  Scene scene_;
  double point_spread_px_;
  double largest_tangent_ = 0;  // of all lines of sight
  std::vector<PrintedMarker> prints_;
  std::vector<Sight> sights_;
};

class SceneRenderer::Frame {
 public:
  double seconds = 0;

 private:
  friend class SceneRenderer;

  struct MarkerView {
    bool visible = false;
    bool back = false;                       // blank side towards the camera
    Eigen::Matrix3d lattice;                 // line of sight -> homogeneous lattice coordinates, third = inverse depth
    Eigen::Vector2d center{0, 0};            // circle around the sheet on the plane z = 1
    double radius = 0;                       // infinite where part of the sheet is behind the camera
    std::array<Eigen::Vector2d, 25> probes;  // points of the sheet on the plane z = 1, NaN behind the camera
  };
  struct OccluderView {
    bool visible = false;
    Eigen::Vector2d center{0, 0};
  };
  std::vector<MarkerView> markers_;
  std::vector<OccluderView> occluders_;
};

inline void SceneRenderer::compute_sights() {
  const auto [width, height] = camera_.sensor_size();
  std::vector<Eigen::Vector2d> rays;  // one more on each side, so that borders have neighbours too
  for (int y = -1; y <= height; ++y)
    for (int x = -1; x <= width; ++x) rays.push_back(camera_.line_of_sight({x, y}).template head<2>());
  sights_.reserve(static_cast<std::size_t>(width * height));
  const auto ray = [&](int x, int y) -> const Eigen::Vector2d& {
    return rays[static_cast<std::size_t>((y + 1) * (width + 2) + x + 1)];
  };
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      Sight sight{ray(x, y).template cast<float>(), {}};
      sight.per_px.col(0) = ((ray(x + 1, y) - ray(x - 1, y)) / 2).template cast<float>();
      sight.per_px.col(1) = ((ray(x, y + 1) - ray(x, y - 1)) / 2).template cast<float>();
      if (!sight.per_px.allFinite()) sight.m.setConstant(std::numeric_limits<float>::quiet_NaN());
      if (sight.m.allFinite()) largest_tangent_ = std::max(largest_tangent_, static_cast<double>(sight.m.norm()));
      sights_.push_back(sight);
    }
}

inline SceneRenderer::Frame SceneRenderer::at(double seconds) const {
  Frame frame;
  frame.seconds = seconds;
  frame.markers_.resize(scene_.markers.size());
  for (std::size_t i = 0; i < scene_.markers.size(); ++i) {
    const auto& marker = scene_.markers[i];
    const auto& print = prints_[i];
    auto& view = frame.markers_[i];
    const Eigen::Isometry3d T = marker.T_camera_marker(seconds);
    const double facing = T.linear().col(2).dot(T.translation());
    const bool edge_on = !(std::abs(facing) > 1e-6 * T.translation().norm());
    if (!T.matrix().allFinite() || edge_on) continue;
    view.back = facing > 0;

    const double cell = marker.length / print.cells();
    Eigen::Matrix3d camera_from_lattice;  // top left corner of the black square, one cell right, one cell down
    camera_from_lattice.col(0) = T.linear().col(0) * cell;
    camera_from_lattice.col(1) = T.linear().col(1) * -cell;
    camera_from_lattice.col(2) = T * Eigen::Vector3d(-marker.length / 2, marker.length / 2, 0);
    view.lattice = camera_from_lattice.inverse();

    const double nearest = 0.01 * marker.length;
    bool whole = true;
    std::size_t probe = 0;
    for (int row = 0; row < 5; ++row)
      for (int column = 0; column < 5; ++column) {
        const double extent = print.last_edge() - print.first_edge();
        const Eigen::Vector3d point = camera_from_lattice * Eigen::Vector3d(print.first_edge() + extent * column / 4,
                                                                            print.first_edge() + extent * row / 4, 1);
        const bool in_front = point.z() > nearest;
        view.visible = view.visible || in_front;
        whole = whole && in_front;
        view.probes[probe++] = in_front ? Eigen::Vector2d(point.head<2>() / point.z())
                                        : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
      }
    view.radius = whole ? 0 : std::numeric_limits<double>::infinity();
    if (!whole) continue;
    view.center = view.probes[12];
    for (const auto& point : view.probes) view.radius = std::max(view.radius, (point - view.center).norm());
  }
  for (const auto& occluder : scene_.occluders) {
    auto& view = frame.occluders_.emplace_back();
    if (seconds < occluder.from_s || seconds >= occluder.until_s) continue;
    view.center = occluder.center_px(seconds);
    view.visible = view.center.allFinite();
  }
  return frame;
}

inline SceneRenderer::Sample SceneRenderer::sample(const Frame& frame, int x, int y) const {
  const Sight& sight = sights_[static_cast<std::size_t>(y * camera_.sensor_size().width + x)];
  double light = 0, remaining = 1, clearance = std::numeric_limits<double>::infinity();

  for (std::size_t i = 0; i < frame.occluders_.size(); ++i) {
    const auto& view = frame.occluders_[i];
    if (!view.visible) continue;
    const Eigen::Array2d inside =
        scene_.occluders[i].half_size_px.array() - (Eigen::Array2d(x, y) - view.center.array()).abs();
    const Eigen::Array2d far_side = 2 * scene_.occluders[i].half_size_px.array() - inside;
    clearance = std::min(clearance, std::abs(inside.minCoeff()) - kEdgeReach * point_spread_px_);
    const auto profile = [&](Eigen::Index axis) {
      return edge_profile(inside(axis) / point_spread_px_) + edge_profile(far_side(axis) / point_spread_px_) - 1;
    };
    const double coverage = profile(0) * profile(1);
    light += remaining * coverage * scene_.occluders[i].shade;
    remaining *= 1 - coverage;
  }

  struct Layer {
    double inverse_depth, coverage, radiance;
  };
  std::array<Layer, 8> layers;  // nearest first; what lies under more than these stays unseen
  std::size_t count = 0;
  const auto add_layer = [&](const Layer& layer) {
    if (count == layers.size() && layers.back().inverse_depth >= layer.inverse_depth) return;
    std::size_t place = count < layers.size() ? count++ : count - 1;
    for (; place > 0 && layers[place - 1].inverse_depth < layer.inverse_depth; --place)
      layers[place] = layers[place - 1];
    layers[place] = layer;
  };
  if (sight.m.allFinite() && remaining > 0)
    for (std::size_t i = 0; i < frame.markers_.size(); ++i)
      blend_marker(
          i, frame, sight,
          [&](double d, double c, double r) {
            add_layer({d, c, r});
          },
          clearance);
  for (std::size_t i = 0; i < count; ++i) {
    light += remaining * layers[i].radiance;
    remaining *= 1 - layers[i].coverage;
  }
  if (remaining > 0) {
    light += remaining * scene_.background.intensity(Eigen::Vector2d(x, y), frame.seconds);
    if (scene_.background.moves()) clearance = 0;
  }
  return {light, std::max(clearance, 0.0)};
}

inline void SceneRenderer::blend_marker(std::size_t index, const Frame& frame, const Sight& sight, auto&& add_layer,
                                        double& clearance) const {
  const auto& view = frame.markers_[index];
  if (!view.visible) return;
  const Eigen::Vector2d m = sight.m.template cast<double>();
  const double to_circle = safe_clearance(((m - view.center).norm() - view.radius) / sight.per_px.norm());
  if (to_circle > 0) {
    clearance = std::min(clearance, to_circle);
    return;
  }
  const Eigen::Vector3d h = view.lattice * m.homogeneous();
  const double inverse_depth = h.z();
  if (!(inverse_depth > 0)) {  // the sheet's plane is behind the camera here
    clearance = 0;
    return;
  }
  const double a = h.x() / inverse_depth, b = h.y() / inverse_depth;
  const auto gradient = [&](Eigen::Index row, double value) {  // [cells/px]
    const double per_mx = view.lattice(row, 0) - value * view.lattice(2, 0);
    const double per_my = view.lattice(row, 1) - value * view.lattice(2, 1);
    const double per_x = per_mx * sight.per_px(0, 0) + per_my * sight.per_px(1, 0);
    const double per_y = per_mx * sight.per_px(0, 1) + per_my * sight.per_px(1, 1);
    return std::sqrt(per_x * per_x + per_y * per_y) / inverse_depth;
  };
  const double gradient_a = gradient(0, a), gradient_b = gradient(1, b);
  if (!(std::isfinite(gradient_a) && std::isfinite(gradient_b) && gradient_a > 0 && gradient_b > 0)) {
    clearance = 0;
    return;
  }
  const double sigma_a = gradient_a * point_spread_px_, sigma_b = gradient_b * point_spread_px_;
  const auto sheet =
      view.back ? prints_[index].back(a, b, sigma_a, sigma_b) : prints_[index].front(a, b, sigma_a, sigma_b);
  clearance = std::min(clearance, safe_clearance(sheet.clearance / std::max(gradient_a, gradient_b)));
  if (sheet.coverage > 0) add_layer(inverse_depth, sheet.coverage, sheet.radiance);
}

inline double SceneRenderer::motion_px(const Frame& from, const Frame& to) const {
  double largest =
      scene_.background.moves() ? scene_.background.velocity_px_per_s.norm() * std::abs(to.seconds - from.seconds) : 0;
  // What is far outside the view neither matters nor projects to anything sensible through a lens model.
  const auto in_sight = [&](const Eigen::Vector2d& m) { return m.norm() < 1.3 * largest_tangent_; };
  for (std::size_t i = 0; i < from.markers_.size(); ++i) {
    const auto &before = from.markers_[i].probes, &after = to.markers_[i].probes;
    if (!from.markers_[i].visible || !to.markers_[i].visible) continue;
    for (std::size_t probe = 0; probe < before.size(); ++probe)
      if (in_sight(before[probe]) || in_sight(after[probe])) {
        const Eigen::Vector2d moved =
            camera_.project(after[probe].homogeneous()) - camera_.project(before[probe].homogeneous());
        if (moved.allFinite()) largest = std::max(largest, moved.norm());
      }
  }
  for (std::size_t i = 0; i < from.occluders_.size(); ++i)
    if (from.occluders_[i].visible && to.occluders_[i].visible)
      largest = std::max(largest, (to.occluders_[i].center - from.occluders_[i].center).norm());
  return largest;
}

inline bool SceneRenderer::appearance_changes(const Frame& from, const Frame& to) const {
  for (std::size_t i = 0; i < from.markers_.size(); ++i)
    if (from.markers_[i].visible != to.markers_[i].visible || from.markers_[i].back != to.markers_[i].back) return true;
  for (std::size_t i = 0; i < from.occluders_.size(); ++i)
    if (from.occluders_[i].visible != to.occluders_[i].visible) return true;
  return false;
}

inline std::vector<float> SceneRenderer::render(double seconds) const {
  const auto [width, height] = camera_.sensor_size();
  const Frame frame = at(seconds);
  std::vector<float> image;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) image.push_back(static_cast<float>(sample(frame, x, y).intensity));
  return image;
}

}  // namespace evmarker
