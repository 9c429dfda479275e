#include "evmarker/model/undistortion_table.hpp"

#include <doctest/doctest.h>

#include <string>
#include <type_traits>

using Eigen::Vector2d;
using Eigen::Vector3d;
using evmarker::SensorSize;
using evmarker::UndistortionTable;

namespace {

// A camera of the test's own: sees past its right edge with z not 1, and has no line of sight in its first row.
struct OddCamera {
  SensorSize size{40, 30};
  float focal = 123;
  SensorSize sensor_size() const { return size; }
  float focal_length() const { return focal; }
  Vector2d project(const Vector3d&) const { return {0, 0}; }
  Vector3d line_of_sight(const Vector2d& pixel) const {
    if (pixel.y() < 0.5) return Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    return {2 * (pixel.x() - 10), 2 * (pixel.y() - 20), 200};
  }
};

std::string refusal_of_table(const OddCamera& camera) {
  try {
    const UndistortionTable table(camera);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

evmarker::Event event_at(int x, int y) { return {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1, 0}; }

}  // namespace

static_assert(std::is_constructible_v<UndistortionTable, evmarker::PinholeCamera>);
static_assert(!std::is_constructible_v<UndistortionTable, SensorSize>);
static_assert(!std::is_convertible_v<evmarker::PinholeCamera, UndistortionTable>, "costs too much to happen unseen");

TEST_CASE("every pixel has its own line of sight, divided by its depth") {
  const UndistortionTable table(OddCamera{});
  CHECK(table.sensor_size() == SensorSize{40, 30});
  CHECK(table.focal_length() == 123);
  for (int y = 1; y < 30; ++y)
    for (int x = 0; x < 40; ++x)
      CHECK((Vector2d(table(event_at(x, y))) - Vector2d(0.01 * (x - 10), 0.01 * (y - 20))).norm() < 1e-7);
}

TEST_CASE("a pixel without a line of sight is NaN and does not count for the rectangle") {
  const UndistortionTable table(OddCamera{});
  for (int x = 0; x < 40; ++x) CHECK_FALSE(evmarker::is_finite(table(event_at(x, 0))));
  CHECK((Vector2d(table.image().low) - Vector2d(-0.1, -0.19)).norm() < 1e-7);
  CHECK((Vector2d(table.image().high) - Vector2d(0.29, 0.09)).norm() < 1e-7);
  CHECK((Vector2d(table.inner_image().low) - Vector2d(-0.1, -0.19)).norm() < 1e-7);
  CHECK((Vector2d(table.inner_image().high) - Vector2d(0.29, 0.09)).norm() < 1e-7);
}

TEST_CASE("a lens is taken out to a thousandth of a pixel") {
  const evmarker::PinholeCamera camera({640, 480}, 533, 531, 321.5, 238.25,
                                       evmarker::BrownConradyDistortion{-0.35, 0.15, 0.001, -0.0007, -0.03});
  const UndistortionTable table(camera);
  double worst = 0, moved = 0;
  Vector2d low(1e9, 1e9), high = -low;
  for (int y = 0; y < 480; ++y)
    for (int x = 0; x < 640; ++x) {
      const Vector2d m = table(event_at(x, y));
      low = low.cwiseMin(m);
      high = high.cwiseMax(m);
      // Through the lens again, by the formula of the model.
      const double r2 = m.squaredNorm(), radial = 1 + r2 * (-0.35 + r2 * (0.15 - 0.03 * r2));
      const double u = m.x() * radial + 2 * 0.001 * m.x() * m.y() - 0.0007 * (r2 + 2 * m.x() * m.x());
      const double v = m.y() * radial + 0.001 * (r2 + 2 * m.y() * m.y()) - 2 * 0.0007 * m.x() * m.y();
      const Vector2d undistorted(533 * m.x() + 321.5, 531 * m.y() + 238.25);
      worst = std::max(worst, (Vector2d(533 * u + 321.5, 531 * v + 238.25) - Vector2d(x, y)).norm());
      moved = std::max(moved, (undistorted - Vector2d(x, y)).norm());
    }
  CHECK(worst < 1e-3);
  CHECK(moved > 20);  // so there was a distortion to take out
  CHECK((table.image().low == evmarker::Vec2(low)));
  CHECK((table.image().high == evmarker::Vec2(high)));
}

TEST_CASE("copies share the table") {
  const UndistortionTable table(OddCamera{});
  const UndistortionTable copy = table;
  CHECK((copy(event_at(39, 29)) == table(event_at(39, 29))));
  CHECK(sizeof(UndistortionTable) < 100);
}

TEST_CASE("a camera that cannot be tabulated is refused with the value") {
  CHECK(refusal_of_table({}) == "accepted");
  CHECK(refusal_of_table({.size = {0, 30}}) == "camera: sensor size is 0 x 30");
  CHECK(refusal_of_table({.size = {40, -1}}) == "camera: sensor size is 40 x -1");
  CHECK(refusal_of_table({.focal = 0}) == "camera: focal length is 0");
  CHECK(refusal_of_table({.focal = std::numeric_limits<float>::quiet_NaN()}) == "camera: focal length is nan");
}
