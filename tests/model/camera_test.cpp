#include "evmarker/model/camera.hpp"

#include <doctest/doctest.h>

#include <array>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <random>
#include <utility>
#include <vector>

using Eigen::Vector2d;
using Eigen::Vector3d;
using evmarker::BrownConradyDistortion;
using evmarker::CameraModel;
using evmarker::Distortion;
using evmarker::EquidistantDistortion;
using evmarker::NoDistortion;
using evmarker::PinholeCamera;
using evmarker::SensorSize;

namespace {

struct OwnCamera {
  SensorSize sensor_size() const;
  float focal_length() const;
  Vector2d project(const Vector3d&) const;
  Vector3d line_of_sight(const Vector2d&) const;
};
struct WithoutInverse {
  SensorSize sensor_size() const;
  double focal_length() const;
  Vector2d project(const Vector3d&) const;
};
struct WithoutFocalLength {
  SensorSize sensor_size() const;
  Vector2d project(const Vector3d&) const;
  Vector3d line_of_sight(const Vector2d&) const;
};
struct PairSize {
  std::pair<int, int> sensor_size() const;
  double focal_length() const;
  Vector2d project(const Vector3d&) const;
  Vector3d line_of_sight(const Vector2d&) const;
};
struct ArraySight {
  SensorSize sensor_size() const;
  double focal_length() const;
  Vector2d project(const Vector3d&) const;
  std::array<double, 3> line_of_sight(const Vector2d&) const;
};
struct MutableProject {
  SensorSize sensor_size() const;
  double focal_length() const;
  Vector2d project(const Vector3d&);
  Vector3d line_of_sight(const Vector2d&) const;
};

constexpr SensorSize kSize{640, 480};

PinholeCamera camera_with(const Distortion& distortion) { return {kSize, 533, 531, 321.5, 238.25, distortion}; }

// Independent truth: OpenCV's own projection of points in the camera frame.
std::vector<cv::Point2d> project_by_opencv(const PinholeCamera& camera, const std::vector<cv::Point3d>& points) {
  const cv::Matx33d K(camera.fx(), 0, camera.cx(), 0, camera.fy(), camera.cy(), 0, 0, 1);
  const cv::Vec3d none(0, 0, 0);
  std::vector<cv::Point2d> pixels;
  if (const auto* d = std::get_if<EquidistantDistortion>(&camera.distortion())) {
    cv::fisheye::projectPoints(points, pixels, none, none, K, cv::Vec4d(d->k1, d->k2, d->k3, d->k4));
  } else {
    cv::Vec<double, 5> coefficients = cv::Vec<double, 5>::all(0);
    if (const auto* b = std::get_if<BrownConradyDistortion>(&camera.distortion()))
      coefficients = {b->k1, b->k2, b->p1, b->p2, b->k3};
    cv::projectPoints(points, none, none, K, coefficients, pixels);
  }
  return pixels;
}

std::vector<Distortion> lenses() {
  return {NoDistortion{},
          BrownConradyDistortion{},
          BrownConradyDistortion{-0.35, 0.15, 0.001, -0.0007, -0.03},
          BrownConradyDistortion{0.2, 0.05, -0.002, 0.001, 0.01},
          EquidistantDistortion{},
          EquidistantDistortion{-0.03, 0.01, -0.004, 0.001},
          EquidistantDistortion{0.05, -0.02, 0.01, 0.002}};
}

std::string refusal_of_camera(SensorSize size, double fx, double fy, double cx, double cy,
                              const Distortion& distortion = {}) {
  try {
    const PinholeCamera camera(size, fx, fy, cx, cy, distortion);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace

static_assert(CameraModel<PinholeCamera>);
static_assert(CameraModel<OwnCamera>);
static_assert(!CameraModel<int>);
static_assert(!CameraModel<WithoutInverse>);
static_assert(!CameraModel<WithoutFocalLength>);
static_assert(!CameraModel<PairSize>);
static_assert(!CameraModel<ArraySight>);
static_assert(!CameraModel<MutableProject>);

TEST_CASE("points project as OpenCV projects them") {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> across(-0.6, 0.6), depth(0.1, 5);
  std::vector<cv::Point3d> points{{0, 0, 1}, {1e-14, 0, 1}};
  for (int i = 0; i < 500; ++i) {
    const double z = depth(random);
    points.emplace_back(across(random) * z, across(random) * z, z);
  }
  for (const Distortion& lens : lenses()) {
    CAPTURE(lens.index());
    const PinholeCamera camera = camera_with(lens);
    const std::vector<cv::Point2d> expected = project_by_opencv(camera, points);
    REQUIRE(expected.size() == points.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vector2d pixel = camera.project({points[i].x, points[i].y, points[i].z});
      CHECK((pixel - Vector2d(expected[i].x, expected[i].y)).norm() < 1e-9);
    }
  }
}

TEST_CASE("distortion is felt: each coefficient moves the pixel") {
  const Vector3d point(0.3, -0.2, 1);
  const Vector2d straight = camera_with(NoDistortion{}).project(point);
  for (const BrownConradyDistortion& d :
       {BrownConradyDistortion{0.1}, {0, 0.1}, {0, 0, 0.1}, {0, 0, 0, 0.1}, {0, 0, 0, 0, 0.1}})
    CHECK((camera_with(d).project(point) - straight).norm() > 0.03);
  const Vector2d fisheye = camera_with(EquidistantDistortion{}).project(point);
  CHECK((fisheye - straight).norm() > 5);
  for (const EquidistantDistortion& d : {EquidistantDistortion{0.1}, {0, 0.1}, {0, 0, 0.1}, {0, 0, 0, 0.1}})
    CHECK((camera_with(d).project(point) - fisheye).norm() > 0.003);
}

TEST_CASE("the line of sight of every pixel leads back to it through OpenCV's projection") {
  for (const Distortion& lens : lenses()) {
    CAPTURE(lens.index());
    const PinholeCamera camera = camera_with(lens);
    std::vector<cv::Point3d> sights;
    std::vector<Vector2d> pixels;
    for (int y = -1; y <= kSize.height; y += 3)  // the sensor and its border, 480 = 160 * 3
      for (int x = -1; x <= kSize.width; x += 3) {
        pixels.emplace_back(x, y);
        const Vector3d M = camera.line_of_sight(pixels.back());
        REQUIRE(M.allFinite());
        CHECK(M.z() == 1);
        sights.emplace_back(M.x(), M.y(), 1);
        CHECK((camera.project(0.37 * M) - pixels.back()).norm() < 1e-8);
      }
    const std::vector<cv::Point2d> back = project_by_opencv(camera, sights);
    double worst = 0;
    for (std::size_t i = 0; i < pixels.size(); ++i)
      worst = std::max(worst, (Vector2d(back[i].x, back[i].y) - pixels[i]).norm());
    REQUIRE(pixels.size() > 30000);
    CHECK(worst < 1e-6);
  }
}

TEST_CASE("without distortion the line of sight is K^-1 (u, 1)") {
  const PinholeCamera camera({640, 480}, 500, 250, 320, 240);
  CHECK((camera.line_of_sight({320, 240}) - Vector3d(0, 0, 1)).norm() == 0);
  CHECK((camera.line_of_sight({570, 115}) - Vector3d(0.5, -0.5, 1)).norm() < 1e-15);
  CHECK((camera.project({0.2, 0.4, 2}) - Vector2d(370, 290)).norm() < 1e-12);
  CHECK(camera.focal_length() == doctest::Approx(std::sqrt(500.0 * 250.0)));
}

TEST_CASE("a wide fisheye sees to 85 degrees and no farther than 90") {
  const PinholeCamera camera({1000, 1000}, 300, 300, 499.5, 499.5, EquidistantDistortion{});
  for (double degrees = 0; degrees <= 85; degrees += 2.5) {
    const double theta = degrees * std::numbers::pi / 180;
    const Vector3d M = camera.line_of_sight({499.5 + 300 * theta * 0.8, 499.5 - 300 * theta * 0.6});
    REQUIRE(M.allFinite());
    CHECK(std::atan(M.head<2>().norm()) == doctest::Approx(theta).epsilon(1e-7));
  }
  CHECK_FALSE(camera.line_of_sight({499.5 + 300 * 1.58, 499.5}).allFinite());
  CHECK_FALSE(camera.line_of_sight({0, 0}).allFinite());
}

TEST_CASE("beyond the fold of a barrel lens there is no line of sight") {
  // The radius r (1 + k1 r^2 + k2 r^4 + k3 r^6) has its first maximum at the fold: found by stepping.
  for (const BrownConradyDistortion& lens : {BrownConradyDistortion{-0.3},
                                             {-0.1},
                                             {-0.8},
                                             {-0.4, 0.05},
                                             {-0.2, -0.1},
                                             {-0.5, 0.1, 0, 0, -0.05},
                                             {0.2, -0.3},
                                             {-0.35, 0.15, 0, 0, -0.03}}) {
    CAPTURE(lens.k1);
    CAPTURE(lens.k2);
    double fold = 0, fold_distorted = 0;
    for (double r = 0; r < 10; r += 1e-5) {
      const double r2 = r * r, distorted = r * (1 + r2 * (lens.k1 + r2 * (lens.k2 + r2 * lens.k3)));
      if (distorted < fold_distorted) break;
      fold = r;
      fold_distorted = distorted;
    }
    REQUIRE(fold < 9);
    const PinholeCamera camera({3001, 3001}, 500, 500, 1500, 1500, lens);
    int before = 0, beyond = 0;
    for (int y = 0; y <= 3000; y += 20)
      for (int x = 0; x <= 3000; x += 20) {
        const double radius = std::hypot(x - 1500, y - 1500) / 500;
        const Vector3d M = camera.line_of_sight(Vector2d(x, y));
        if (radius < 0.995 * fold_distorted) {
          ++before;
          CAPTURE(radius);
          REQUIRE(M.allFinite());
          CHECK(M.head<2>().norm() < fold);
          CHECK(M.head<2>().dot(Vector2d(x - 1500, y - 1500)) >= 0);
        } else if (radius > 1.005 * fold_distorted) {
          ++beyond;
          CAPTURE(radius);
          CHECK_FALSE(M.allFinite());
        }
      }
    CHECK(before > 50);
    CHECK(beyond > 50);
  }
}

TEST_CASE("beyond the fold of a fisheye lens there is no line of sight") {
  const EquidistantDistortion lens{-0.1, -0.03, 0,
                                   0};  // theta (1 - 0.1 theta^2 - 0.03 theta^4): fold where its slope is 0
  const double fold = std::sqrt((-0.3 + std::sqrt(0.09 + 4 * 0.15)) / 0.3);
  REQUIRE(fold < 1.5);
  const double fold_px = 300 * fold * (1 - 0.1 * fold * fold - 0.03 * std::pow(fold, 4));
  const PinholeCamera camera({2001, 2001}, 300, 300, 1000, 1000, lens);
  for (double px = 0; px < 1000; px += 5) {
    const Vector3d M = camera.line_of_sight({1000 + 0.6 * px, 1000 - 0.8 * px});
    CAPTURE(px);
    if (px < 0.995 * fold_px) {
      REQUIRE(M.allFinite());
      CHECK(std::atan(M.head<2>().norm()) < fold);
    } else if (px > 1.005 * fold_px) {
      CHECK_FALSE(M.allFinite());
    }
  }
}

TEST_CASE("pincushion lenses have no fold") {
  const PinholeCamera camera({1001, 1001}, 250, 250, 500, 500, BrownConradyDistortion{0.5, 0.2, 0, 0, 0.1});
  for (int x = 0; x <= 1000; x += 10) {
    const Vector3d M = camera.line_of_sight(Vector2d(x, 0));
    REQUIRE(M.allFinite());
    CHECK((camera.project(M) - Vector2d(x, 0)).norm() < 1e-6);
  }
}

TEST_CASE("each impossible parameter is named with its value") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240) == "accepted");
  CHECK(refusal_of_camera(kSize, 500, 500, -10, 9999) ==
        "accepted");  // a cropped image may lie beside its principal point
  CHECK(refusal_of_camera({0, 480}, 500, 500, 320, 240) == "camera: image width is 0");
  CHECK(refusal_of_camera({640, -1}, 500, 500, 320, 240) == "camera: image height is -1");
  CHECK(refusal_of_camera(kSize, 0, 500, 320, 240) == "camera: fx is 0");
  CHECK(refusal_of_camera(kSize, 500, -2.5, 320, 240) == "camera: fy is -2.5");
  CHECK(refusal_of_camera(kSize, nan, 500, 320, 240) == "camera: fx is nan");
  CHECK(refusal_of_camera(kSize, 500, infinity, 320, 240) == "camera: fy is inf");
  CHECK(refusal_of_camera(kSize, 500, 500, nan, 240) == "camera: cx is nan");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, -infinity) == "camera: cy is -inf");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, BrownConradyDistortion{nan}) == "camera: k1 is nan");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, BrownConradyDistortion{0, infinity}) == "camera: k2 is inf");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, BrownConradyDistortion{0, 0, nan}) == "camera: p1 is nan");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, BrownConradyDistortion{0, 0, 0, -infinity}) ==
        "camera: p2 is -inf");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, BrownConradyDistortion{0, 0, 0, 0, nan}) == "camera: k3 is nan");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, EquidistantDistortion{nan}) == "camera: k1 is nan");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, EquidistantDistortion{0, nan}) == "camera: k2 is nan");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, EquidistantDistortion{0, 0, nan}) == "camera: k3 is nan");
  CHECK(refusal_of_camera(kSize, 500, 500, 320, 240, EquidistantDistortion{0, 0, 0, nan}) == "camera: k4 is nan");
}
