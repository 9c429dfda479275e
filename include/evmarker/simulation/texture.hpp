#pragma once
// The light of a textured background.
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene.hpp"

namespace evmarker {

/// The random patches of a background, drawn once. They repeat after 256 patches.
class Texture {
 public:
  explicit Texture(const Background& background) : background_(background) {
    if (background.contrast == 0) return;
    Random random(background.seed);
    patches_.resize(kPeriod * kPeriod);
    for (float& patch : patches_) patch = static_cast<float>(random.uniform(-background.contrast, background.contrast));
  }

  bool moves() const noexcept { return background_.moves(); }

  /// Light from an image point at a time.
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

  static float ease(float v) { return v * v * v * (10 + v * (6 * v - 15)); }
  static float mix(float from, float to, float share) { return from + share * (to - from); }
  float patch(double x, double y) const {
    const auto wrapped = [](double v) { return static_cast<std::size_t>(static_cast<std::int64_t>(v)) % kPeriod; };
    return patches_[wrapped(y) * kPeriod + wrapped(x)];
  }

  Background background_;
  std::vector<float> patches_;  // deviations of the logarithm
};

}  // namespace evmarker
