#include "evmarker/simulation/scene_renderer.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

namespace {

const PinholeCamera kSmallCamera{{200, 160}, 200, 200, 100, 80};

SimulatedMarker marker_at(const Eigen::Isometry3d& T, double length, std::uint8_t bit, double quiet_zone_cells = 0) {
  return {.length = length,
          .bits = CodeBits::Constant(1, 1, bit),
          .T_camera_marker = trajectory::still(T),
          .quiet_zone_cells = quiet_zone_cells,
          .black = 0.1,
          .white = 0.9};
}

double light(const Scene& scene, int x, int y, double seconds = 0) {
  const SceneRenderer renderer(kSmallCamera, scene, 0.6);
  return renderer.sample(renderer.at(seconds), x, y).intensity;
}

}  // namespace

TEST_CASE("marker, paper and background are where the pose puts them") {
  // 60 px of black with 20 px of paper around, from (70, 50) to (130, 110).
  const Scene scene{{marker_at(facing_pose({0, 0, 1}), 0.3, 0, 1)}, {}, {.mean = 0.4}};
  CHECK(light(scene, 100, 80) == doctest::Approx(0.1));
  CHECK(light(scene, 75, 55) == doctest::Approx(0.1));
  CHECK(light(scene, 60, 80) == doctest::Approx(0.9));
  CHECK(light(scene, 100, 125) == doctest::Approx(0.9));
  CHECK(light(scene, 40, 80) == doctest::Approx(0.4));
  CHECK(light(scene, 70, 80) == doctest::Approx(0.5));    // a pixel on the edge of the ink
  CHECK(light(scene, 130, 110) == doctest::Approx(0.7));  // its corner: a quarter black
  CHECK(light(scene, 100, 30) == doctest::Approx(0.65));  // the edge of the paper
}

TEST_CASE("an edge has the profile of the blur, also under tilt and behind a lens") {
  const PinholeCamera lens{{200, 160}, 200, 200, 100, 80, BrownConradyDistortion{-0.3, 0.05, 0.001, 0.002, 0}};
  const auto T = facing_pose({0.25, 0.1, 1}, {0.4, -0.5, 0.3});
  const SceneRenderer renderer(lens, Scene{{marker_at(T, 0.3, 0)}, {}, {.mean = 0.9}}, 0.8);
  const auto frame = renderer.at(0);
  int checked = 0;
  for (int y = 0; y < 160; ++y)
    for (int x = 0; x < 200; ++x) {
      // Distance from the right edge by brute force: the nearest of many projected points, kept off the corners.
      double nearest = 1e9, nearest_at = 0;
      for (int i = 0; i <= 2000; ++i) {
        const double along = -0.15 + 0.3 * i / 2000;
        const double d = (lens.project(T * Eigen::Vector3d(0.15, along, 0)) - Eigen::Vector2d(x, y)).norm();
        if (d < nearest) {
          nearest = d;
          nearest_at = along;
        }
      }
      if (nearest > 2 || std::abs(nearest_at) > 0.09) continue;
      ++checked;
      const double outside = 0.5 * std::erfc(-nearest / 0.8 / std::sqrt(2.0));
      const double value = (renderer.sample(frame, x, y).intensity - 0.1) / 0.8;
      CHECK(std::min(std::abs(value - outside), std::abs(value - (1 - outside))) < 0.01);
    }
  CHECK(checked > 50);
}

TEST_CASE("the nearest marker hides the others, whatever their order") {
  const auto near_white = marker_at(facing_pose({0, 0, 0.8}), 0.06, 1),
             far_black = marker_at(facing_pose({0, 0, 1}), 0.3, 0);
  CHECK(light({{near_white, far_black}, {}, {}}, 100, 80) == doctest::Approx(0.9));
  CHECK(light({{far_black, near_white}, {}, {}}, 100, 80) == doctest::Approx(0.9));
  CHECK(light({{far_black, near_white}, {}, {}}, 120, 80) == doctest::Approx(0.1));
}

TEST_CASE("the back of a marker is blank, one edge-on or behind the camera cannot be seen") {
  const double pi = std::acos(-1.0);
  const auto seen = [](const Eigen::Isometry3d& T) {
    return light({{marker_at(T, 0.3, 0)}, {}, {.mean = 0.4}}, 100, 80);
  };
  CHECK(seen(facing_pose({0, 0, 1})) == doctest::Approx(0.1));
  CHECK(seen(facing_pose({0, 0, 1}, {0, pi, 0})) == doctest::Approx(0.9));
  CHECK(seen(facing_pose({0, 0, 1}, {0, pi / 2, 0})) == doctest::Approx(0.4));
  CHECK(seen(facing_pose({0, 0, -1})) == doctest::Approx(0.4));
}

TEST_CASE("a sheet that reaches behind the camera is drawn where it is in front") {
  // A floor 0.1 m below the camera, 2 m long: below the horizon there is paper, above it there is none.
  const double pi = std::acos(-1.0);
  const Scene scene{{marker_at(facing_pose({0, 0.1, 0}, {pi / 2, 0, 0}), 2, 0)}, {}, {.mean = 0.4}};
  const double below = light(scene, 100, 150), above = light(scene, 100, 20);
  CHECK(below != doctest::Approx(0.4));
  CHECK(above == doctest::Approx(0.4));
  for (const float value : SceneRenderer(kSmallCamera, scene, 0.6).render(0)) CHECK(std::isfinite(value));
}

TEST_CASE("occluders stand in front, between their times") {
  const Scene scene{{marker_at(facing_pose({0, 0, 1}), 0.3, 0)},
                    {{.centre_px = [](double s) { return Eigen::Vector2d(100 + 10 * s, 80); },
                      .half_size_px = {10, 5},
                      .shade = 0.3,
                      .from_s = 1,
                      .until_s = 3}},
                    {}};
  CHECK(light(scene, 110, 80, 0.9) == doctest::Approx(0.1));
  CHECK(light(scene, 110, 80, 1.0) == doctest::Approx(0.3));
  CHECK(light(scene, 120, 80, 1.0) == doctest::Approx(0.2));  // on its edge
  CHECK(light(scene, 110, 90, 1.0) == doctest::Approx(0.1));
  CHECK(light(scene, 125, 80, 2.0) == doctest::Approx(0.3));
  CHECK(light(scene, 110, 80, 3.0) == doctest::Approx(0.1));
}

TEST_CASE("motion is the fastest point's") {
  const auto motion = [](const SimulatedMarker& marker) {
    const SceneRenderer renderer(kSmallCamera, {{marker}, {}, {}}, 0.6);
    return renderer.motion_px(renderer.at(0), renderer.at(0.01));
  };
  auto marker = marker_at(facing_pose({0, 0, 1}), 0.3, 0);
  CHECK(motion(marker) == 0);
  marker.T_camera_marker = trajectory::linear(facing_pose({0, 0, 1}), {0.5, 0, 0});
  CHECK(motion(marker) == doctest::Approx(1));  // 5 mm at 1 m
  marker.T_camera_marker = trajectory::spin(facing_pose({0, 0, 1}), {0, 0, 1}, 2);
  CHECK(motion(marker) == doctest::Approx(0.02 * 30 * std::sqrt(2.0)).epsilon(0.01).scale(0));  // the corners
}

namespace {

void check_clearances(const PinholeCamera& lens, double length, const Trajectory& motion) {
  CodeBits bits(2, 2);
  bits << 1, 0, 0, 1;
  const SimulatedMarker marker{.length = length, .bits = bits, .T_camera_marker = motion};
  const SceneRenderer renderer(lens, {{marker}, {}, {}}, 0.6);
  std::vector<double> start, asleep_until(200 * 160, -1), value(200 * 160);
  double moved = 0;
  auto frame = renderer.at(0);
  int sleeping = 0;
  for (int step = 1; step <= 150; ++step) {
    for (int y = 0; y < 160; ++y)
      for (int x = 0; x < 200; ++x) {
        const auto i = static_cast<std::size_t>(y * 200 + x);
        const auto sample = renderer.sample(frame, x, y);
        if (moved <= asleep_until[i]) {
          ++sleeping;
          if (std::abs(sample.intensity - value[i]) > 1e-3) FAIL_CHECK("pixel " << x << ", " << y << " changed");
        } else if (sample.clearance_px > 0) {
          asleep_until[i] = moved + sample.clearance_px;
          value[i] = sample.intensity;
        }
      }
    const auto next = renderer.at(step * 1e-3);
    moved += renderer.motion_px(frame, next);
    frame = next;
  }
  CHECK(moved > 20);
  CHECK(sleeping > 1000000);
}

}  // namespace

TEST_CASE("light does not change before the edges have moved by the clearance") {
  check_clearances({{200, 160}, 200, 200, 100, 80, BrownConradyDistortion{-0.3, 0.05, 0, 0, 0}}, 0.3,
                   trajectory::linear(facing_pose({-0.1, 0, 1}, {0.5, 0.4, 0}), {1, 0.5, -1}, {1, 2, 3}));
}

TEST_CASE("nor behind a fisheye lens that sees 65 deg to the side") {
  check_clearances({{200, 160}, 90, 90, 100, 80, EquidistantDistortion{0.02, -0.005, 0.001, 0}}, 1,
                   trajectory::linear(facing_pose({2, 0, 1}, {0.2, 0.1, 0}), {-24, 0.5, 0}, {0, 0, 1}));
}

TEST_CASE("a blur that makes no sense is named") {
  CHECK_THROWS_WITH_AS(SceneRenderer(kSmallCamera, {}, 0), "scene renderer: point_spread_px is 0",
                       std::invalid_argument);
}
