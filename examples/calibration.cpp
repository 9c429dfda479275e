// Says what a calibration is, in whatever form it comes, and writes it in that of OpenCV.
#include <cmath>
#include <cstdio>
#include <evmarker/model/camera.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <numbers>
#include <string>
#include <variant>

#include "camera_option.hpp"
#include "console.hpp"
#include "distinct_files.hpp"

using namespace evmarker;

namespace {

struct Options {
  CameraOption camera;
  std::string output;

  void add_to(CLI::App& app) {
    camera.add_to(app, "calibration", "calibration")->required();
    app.add_option("output", output, "calibration to write, as .yml, .xml or .json; none: only say what it is");
    camera.add_size_to(app);
    app.footer("Exit codes: 0 done, 1 error");
  }
};

void print(const NoDistortion&) { std::printf("  no distortion\n"); }
void print(const BrownConradyDistortion& d) {
  std::printf("  radial-tangential: k1 %g, k2 %g, p1 %g, p2 %g, k3 %g\n", d.k1, d.k2, d.p1, d.p2, d.k3);
}
void print(const EquidistantDistortion& d) {
  std::printf("  fisheye (equidistant): k1 %g, k2 %g, k3 %g, k4 %g\n", d.k1, d.k2, d.k3, d.k4);
}

/// Angle between the lines of sight of two pixels [deg]; NaN where the lens model has no inverse.
double angle(const PinholeCamera& camera, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const Eigen::Vector3d to_a = camera.line_of_sight(a), to_b = camera.line_of_sight(b);
  return std::atan2(to_a.cross(to_b).norm(), to_a.dot(to_b)) * 180 / std::numbers::pi;
}

void print(const PinholeCamera& camera) {
  const auto [width, height] = camera.sensor_size();
  std::printf("%d x %d px\n", width, height);
  std::printf("  fx %g, fy %g, cx %g, cy %g px\n", camera.fx(), camera.fy(), camera.cx(), camera.cy());
  std::visit([](const auto& distortion) { print(distortion); }, camera.distortion());
  const double right = width - 0.5, bottom = height - 0.5;
  const double across = angle(camera, {-0.5, camera.cy()}, {right, camera.cy()}),
               down = angle(camera, {camera.cx(), -0.5}, {camera.cx(), bottom});
  if (std::isfinite(across) && std::isfinite(down)) std::printf("  field of view %.1f x %.1f deg\n", across, down);
  for (const double y : {0.0, height - 1.0})
    for (const double x : {0.0, width - 1.0})
      if (!camera.line_of_sight({x, y}).allFinite())
        std::printf("  the lens model has no inverse at pixel (%.0f, %.0f): events there cannot be used\n", x, y);
}

void read_and_write(const Options& options) {
  require_distinct({{"the calibration", options.camera.path}}, {{"the output", options.output}});
  require_ending({"the output", options.output}, kCalibrationEndings);
  const PinholeCamera camera = options.camera.load();
  print(camera);
  if (options.output.empty()) return;
  opencv::save_calibration(options.output, camera);
  std::printf("written to %s\n", options.output.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("calibration",
                               "Says what a camera's calibration is, in any form, and writes it in that of OpenCV.",
                               argc, argv, read_and_write);
}
