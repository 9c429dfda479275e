#pragma once
// The light from a textured background.
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene.hpp"

namespace evmarker {

/// The texture of a background: random patches, interpolated smoothly. It repeats after 256 patches.
class Texture {
 public:
  explicit Texture(const Background& background) : background_(background) {
    if (background.contrast == 0) return;
    Random random(background.seed);
    patches_.resize(kPeriod * kPeriod);
    for (float& patch : patches_) patch = static_cast<float>(random.uniform(-background.contrast, background.contrast));
  }

  /// True if the light at a pixel changes with time.
  bool moves() const noexcept { return background_.moves(); }

  /// Light at a pixel of the distorted image at a time [s].
  double intensity(Vec2 pixel, double seconds) const {
    if (patches_.empty()) return background_.mean;
    const Vec2 at = (pixel - seconds * Vec2(background_.velocity_px_per_s)) / background_.texture_size_px;
    const double x = std::floor(at.x), y = std::floor(at.y);
    const float sx = ease(static_cast<float>(at.x - x)), sy = ease(static_cast<float>(at.y - y));
    const float above = mix(patch(x, y), patch(x + 1, y), sx), below = mix(patch(x, y + 1), patch(x + 1, y + 1), sx);
    return background_.mean * static_cast<double>(std::exp(mix(above, below, sy)));
  }

 private:
  static constexpr std::size_t kPeriod = 256;

  // From 0 to 1 with first and second derivatives 0 at both ends.
  static float ease(float v) { return v * v * v * (10 + v * (6 * v - 15)); }
  static float mix(float from, float to, float share) { return from + share * (to - from); }
  float patch(double x, double y) const {
    const auto wrapped = [](double v) { return static_cast<std::size_t>(static_cast<std::int64_t>(v)) % kPeriod; };
    return patches_[wrapped(y) * kPeriod + wrapped(x)];
  }

  Background background_;
  std::vector<float> patches_;  // deviations of the logarithm of the light, row by row; empty without a texture
};

}  // namespace evmarker
