#pragma once
// Events of a marker's edges for tests that look for its pose, drawn without the simulator.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <random>
#include <vector>

#include "evmarker/search/start_pose_search.hpp"
#include "simulated.hpp"

namespace evmarker::simulated {

inline const MarkerModel kModel = make_code_marker(kMarkerLength, code());

/// Off by so much to one side, in depth and about some axis.
inline Eigen::Isometry3d off(Eigen::Isometry3d T, std::mt19937& random, double sideways_m, double depth_m,
                             double angle_deg) {
  std::normal_distribution<double> normal;
  const double direction = std::uniform_real_distribution<double>(0, 2 * std::numbers::pi)(random);
  T.translation() += Eigen::Vector3d(sideways_m * std::cos(direction), sideways_m * std::sin(direction), depth_m);
  const Eigen::Vector3d axis = Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
  T.linear() = so3_exp(angle_deg / 180 * std::numbers::pi * axis) * T.linear();
  return T;
}

/// Events of edges that move and of noise, drawn without the simulator: `per_px` for every pixel that an edge sweeps,
/// spread by 0.6 px.
struct Sketch {
  PinholeCamera camera = simulated::camera;
  MarkerModel model = kModel;
  Eigen::Isometry3d T = facing_pose({0, 0, 0.6}, {0.2, 0.1, 0.2});
  double speed_px_per_s = 100, direction_rad = 0.7, duration_s = 0.1, per_px = 9, noise_hz = 1;
  double rest_s = 0;  // before it moves

  double focal_length() const { return camera.focal_length(); }
  Eigen::Isometry3d pose(double t) const {
    Eigen::Isometry3d moved = T;
    const double way = speed_px_per_s * T.translation().z() / focal_length() * std::max(0.0, t - rest_s);
    moved.translation() += way * Eigen::Vector3d(std::cos(direction_rad), std::sin(direction_rad), 0);
    return moved;
  }
  Eigen::Vector2d centre() const {
    return {(camera.sensor_size().width - 1) / 2.0, (camera.sensor_size().height - 1) / 2.0};
  }
  Eigen::Vector2d pixel(const Event& event) const { return Eigen::Vector2d(event.x, event.y) - centre(); }

  std::vector<Event> draw(unsigned seed) const {
    std::mt19937 random(seed);
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> share;
    std::vector<Event> events;
    const SensorSize size = camera.sensor_size();
    const double step_s = std::min(1e-3, 0.1 / speed_px_per_s);
    const auto add = [&](const Eigen::Vector2d& u, double t) {
      const int x = static_cast<int>(std::lround(u.x())), y = static_cast<int>(std::lround(u.y()));
      if (size.contains(x, y))
        events.push_back({static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1,
                          static_cast<Timestamp>((t + step_s * share(random)) * 1e6)});
    };
    const auto count = [&](double mean) { return mean > 0 ? std::poisson_distribution<int>(mean)(random) : 0; };
    for (double t = 0; t < rest_s + duration_s; t += step_s) {
      const Eigen::Isometry3d from = pose(t), to = pose(t + step_s);
      for (const MarkerSegment& edge : model.segments) {
        const auto image = [&](const Eigen::Isometry3d& at, int vertex) -> Eigen::Vector2d {
          const Eigen::Vector3d P = at * model.vertices[static_cast<std::size_t>(vertex)];
          return focal_length() / P.z() * P.head<2>() + centre();
        };
        const Eigen::Vector2d a = image(from, edge.from), along = image(from, edge.to) - a;
        const Eigen::Vector2d normal_of_edge = Eigen::Vector2d(-along.y(), along.x()).normalized();
        const double swept = along.norm() * std::abs(normal_of_edge.dot(image(to, edge.from) - a));
        for (int i = count(per_px * swept); i > 0; --i)
          add(a + share(random) * along + 0.6 * normal(random) * normal_of_edge, t);
      }
      for (int i = count(noise_hz * step_s * size.width * size.height); i > 0; --i)
        add({share(random) * size.width - 0.5, share(random) * size.height - 0.5}, t);
    }
    std::ranges::sort(events, {}, &Event::t);
    return events;
  }

  StartPoseSearch search_from(const Eigen::Isometry3d& T_rough, const StartPoseSearchSettings& settings = {}) const {
    return {model, focal_length(), Box{-centre(), centre()}, T_rough, settings};
  }

  // Off by two thirds of what is within reach, this way or that; in depth along its line of sight.
  Eigen::Isometry3d rough(unsigned seed) const {
    std::mt19937 random(seed);
    const double length = (model.vertices[0] - model.vertices[1]).norm();
    Eigen::Isometry3d rough = T;
    rough.translation() *= seed % 2 == 0 ? 1.065 : 0.935;
    return off(rough, random, 0.12 * length, 0, 4);
  }

  // How far the vertices that are in the image are from where they were at that time.
  double error_px(const Eigen::Isometry3d& found, Timestamp t) const {
    const Eigen::Isometry3d truth = pose(static_cast<double>(t) * 1e-6);
    double squared = 0;
    int seen = 0;
    for (const Eigen::Vector3d& vertex : model.vertices) {
      const Eigen::Vector3d P = found * vertex, Q = truth * vertex;
      const Eigen::Vector2d at = focal_length() / Q.z() * Q.head<2>();
      if ((at.cwiseAbs() - centre()).maxCoeff() > 0) continue;
      ++seen;
      squared += (focal_length() * (P.head<2>() / P.z() - Q.head<2>() / Q.z())).squaredNorm();
    }
    return std::sqrt(squared / seen);
  }
};

}  // namespace evmarker::simulated
