#pragma once
// Lens models by the names that programs give them, and distortions from their coefficients.
#include <algorithm>
#include <array>
#include <cstddef>
#include <opencv2/core.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/settings_file.hpp"

namespace evmarker::opencv::detail {

enum class LensModel { none, radial_tangential, fisheye };

// The names in the files of OpenCV, ROS, Kalibr and Metavision. A rational lens is one with further coefficients, which
// may be 0; without a name, ROS means plumb_bob.
inline constexpr std::array<std::pair<std::string_view, LensModel>, 13> kLensModels{
    {{"plumb_bob", LensModel::radial_tangential},
     {"radtan", LensModel::radial_tangential},
     {"radial-tangential", LensModel::radial_tangential},
     {"brown_conrady", LensModel::radial_tangential},
     {"rational_polynomial", LensModel::radial_tangential},
     {"pinhole", LensModel::radial_tangential},
     {"", LensModel::radial_tangential},
     {"none", LensModel::none},
     {"None", LensModel::none},
     {"fisheye", LensModel::fisheye},
     {"equidistant", LensModel::fisheye},
     {"equi", LensModel::fisheye},
     {"kannala_brandt", LensModel::fisheye}}};

// The model that a field names.
inline LensModel read_lens_model(const SettingsFile& file, const cv::FileNode& node, const std::string& field) {
  const std::string name = file.text(node, field);
  const auto known = std::ranges::find(kLensModels, name, &std::pair<std::string_view, LensModel>::first);
  if (known == kLensModels.end())
    file.fail(field + " is \"" + name +
              "\", which is not supported: calibrate with plumb_bob (radtan) or, a wide lens, with fisheye "
              "(equidistant)");
  return known->second;
}

// The distortion of a model with its coefficients in OpenCV's order, which Kalibr and Metavision have, too. Fails for
// more than the coefficients that the library has. `field` is the name of the coefficients in errors.
inline Distortion make_distortion(const SettingsFile& file, LensModel model, std::vector<double> k,
                                  const std::string& field) {
  const std::size_t given = k.size();
  const auto require_zero = [&](std::size_t i, const char* why) {
    if (k[i] != 0) file.fail(field + "[" + std::to_string(i) + "] is " + SettingsFile::show(k[i]) + ": " + why);
  };
  if (model == LensModel::none) {
    for (std::size_t i = 0; i < given; ++i) require_zero(i, "the lens model is none, which has no coefficients");
    return NoDistortion{};
  }
  if (model == LensModel::fisheye) {
    if (given != 4) file.fail(field + " has " + std::to_string(given) + " numbers; a fisheye lens has 4");
    return EquidistantDistortion{k[0], k[1], k[2], k[3]};
  }
  if (given != 0 && given != 4 && given != 5 && given != 8 && given != 12 && given != 14)
    file.fail(field + " has " + std::to_string(given) + " numbers, not 4 or 5 (k1 k2 p1 p2 k3)");
  for (std::size_t i = 5; i < given; ++i)
    require_zero(i, "rational, thin prism and tilted lenses are not supported, calibrate with 5 coefficients");
  k.resize(5);
  if (k == std::vector<double>(5)) return NoDistortion{};
  return BrownConradyDistortion{k[0], k[1], k[2], k[3], k[4]};
}

}  // namespace evmarker::opencv::detail
