#pragma once
// A frame camera at the place of the event camera: grey images of the same scene with exposure blur and read noise.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene_renderer.hpp"
#include "scenarios.hpp"

namespace evmarker::bench {

struct GreySettings {
  double rate_hz = 60;
  double exposure_s = 0.008;
  double read_noise = 1.5;  ///< standard deviation [grey levels of 255]
};

/// Linear 8-bit images; white paper is 217 of 255 at every exposure, as if the light were always enough.
class GreyCamera {
 public:
  GreyCamera(const Situation& situation, const GreySettings& settings)
      : settings_(settings),
        renderer_(situation.camera, situation.scene, situation.simulator.point_spread_px),
        behind_(situation.camera, Scene{{}, situation.scene.occluders, situation.scene.background},
                situation.simulator.point_spread_px),
        seed_(situation.simulator.seed) {
    Random random(seed_, kNoiseStream);
    for (double& value : noise_) value = settings_.read_noise * random.gaussian();
  }

  /// The image whose exposure has its middle at a time [s].
  cv::Mat image(double middle_s) {
    const auto frames = exposure(middle_s);
    // Around the markers all of the exposure counts; farther off its middle is enough.
    const cv::Mat_<std::uint8_t> near_marker = neighbourhood(frames);
    const cv::Mat_<float>& rest = surroundings(middle_s);
    cv::Mat_<std::uint8_t> grey(rest.rows, rest.cols);
    Random random(seed_, kNoiseStream, static_cast<std::uint64_t>(std::llround(middle_s * 1e6)));
    for (int y = 0; y < grey.rows; ++y) {
      std::size_t noise = random.bits() % noise_.size();  // drawing it anew for each pixel takes longer than all else
      for (int x = 0; x < grey.cols; ++x) {
        double light = rest(y, x);
        if (near_marker(y, x) != 0) {
          light = 0;
          for (const auto& frame : frames) light += renderer_.sample(frame, x, y).intensity;
          light /= static_cast<double>(frames.size());
        }
        noise = (noise + 1) % noise_.size();
        grey(y, x) = static_cast<std::uint8_t>(std::lround(std::clamp(255 * light + noise_[noise], 0.0, 255.0)));
      }
    }
    return grey;
  }

 private:
  static constexpr std::uint64_t kNoiseStream = 0x6EE7;

  // Moments of the exposure, at most about a pixel of motion apart: less than two sigmas of the point spread.
  std::vector<SceneRenderer::Frame> exposure(double middle_s) const {
    constexpr int kParts = 4, kMost = 48;
    const double begin = middle_s - settings_.exposure_s / 2;
    double motion_px = 0;
    for (int part = 0; part < kParts; ++part)
      motion_px += renderer_.motion_px(renderer_.at(begin + settings_.exposure_s * part / kParts),
                                       renderer_.at(begin + settings_.exposure_s * (part + 1) / kParts));
    const int count = std::clamp(static_cast<int>(std::ceil(motion_px)), 1, kMost);
    std::vector<SceneRenderer::Frame> frames;
    for (int i = 0; i < count; ++i) frames.push_back(renderer_.at(begin + settings_.exposure_s * (i + 0.5) / count));
    return frames;
  }

  cv::Mat_<std::uint8_t> neighbourhood(const std::vector<SceneRenderer::Frame>& frames) const {
    const auto [width, height] = renderer_.camera().sensor_size();
    cv::Mat_<std::uint8_t> mask(height, width, std::uint8_t{0});
    for (const SimulatedMarker& marker : renderer_.scene().markers) {
      const double reach =
          marker.length * (0.5 + marker.quiet_zone_cells / static_cast<double>(marker.bits.rows() + 2));
      Eigen::Vector2d low(width, height), high(-1, -1);
      for (const auto& frame : frames)
        for (const double x : {-reach, 0.0, reach})
          for (const double y : {-reach, 0.0, reach}) {
            const Eigen::Vector3d point = marker.T_camera_marker(frame.seconds) * Eigen::Vector3d(x, y, 0);
            const Eigen::Vector2d pixel = renderer_.camera().project(point);
            low = low.cwiseMin(pixel);
            high = high.cwiseMax(pixel);
          }
      constexpr int kMargin = 6;
      const cv::Rect box(cv::Point(static_cast<int>(low.x()) - kMargin, static_cast<int>(low.y()) - kMargin),
                         cv::Point(static_cast<int>(high.x()) + kMargin, static_cast<int>(high.y()) + kMargin));
      const cv::Rect visible = box & cv::Rect(0, 0, width, height);
      if (visible.area() > 0) mask(visible).setTo(1);
    }
    return mask;
  }

  const cv::Mat_<float>& surroundings(double seconds) {
    const bool fixed = behind_.scene().occluders.empty() && !behind_.scene().background.moves();
    if (fixed && !surroundings_.empty()) return surroundings_;
    const auto [width, height] = renderer_.camera().sensor_size();
    const std::vector<float> light = behind_.render(seconds);
    surroundings_.create(height, width);
    std::ranges::copy(light, surroundings_.begin());
    return surroundings_;
  }

  GreySettings settings_;
  SceneRenderer renderer_, behind_;
  std::uint64_t seed_;
  std::array<double, 65536> noise_;
  cv::Mat_<float> surroundings_;
};

}  // namespace evmarker::bench
