#include "evmarker/simulation/scene.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

namespace {

Scene good() {
  Scene scene;
  scene.markers.push_back({.bits = CodeBits::Zero(2, 2), .T_camera_marker = trajectory::still(facing_pose({0, 0, 1}))});
  scene.occluders.push_back({.centre_px = [](double) { return Eigen::Vector2d(1, 2); }});
  return scene;
}

}  // namespace

TEST_CASE("a scene that makes no sense is refused with the field's name") {
  CHECK_NOTHROW(validate(good()));
  CHECK_NOTHROW(validate(Scene{}));
  auto scene = good();
  scene.markers[0].length = 0;
  CHECK_THROWS_WITH_AS(validate(scene), "scene: marker 0: length is 0", std::invalid_argument);
  scene = good();
  scene.markers[0].T_camera_marker = nullptr;
  CHECK_THROWS_WITH_AS(validate(scene), "scene: marker 0: T_camera_marker is not set", std::invalid_argument);
  scene = good();
  scene.markers[0].T_camera_marker = [](double) { return facing_pose({0, 0, std::nan("")}); };
  CHECK_THROWS_WITH_AS(validate(scene), "scene: marker 0: T_camera_marker is not finite at 0 s", std::invalid_argument);
  scene = good();
  scene.occluders[0].centre_px = nullptr;
  CHECK_THROWS_WITH_AS(validate(scene), "scene: occluder 0: centre_px is not set", std::invalid_argument);
  scene = good();
  scene.occluders[0].half_size_px = {10, -1};
  CHECK_THROWS_WITH_AS(validate(scene), "scene: occluder 0: half_size_px is -1", std::invalid_argument);
  scene = good();
  scene.occluders[0].until_s = scene.occluders[0].from_s = 1;
  CHECK_THROWS_AS(validate(scene), std::invalid_argument);
  scene = good();
  scene.background.mean = 0;
  CHECK_THROWS_WITH_AS(validate(scene), "scene: background: mean is 0", std::invalid_argument);
  scene = good();
  scene.background.texture_size_px = -3;
  CHECK_THROWS_AS(validate(scene), std::invalid_argument);
}
