#pragma once
// A lens as it is written on a command line.
#include <CLI/CLI.hpp>
#include <cmath>
#include <evmarker/model/camera.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace evmarker {

/// Reads `radtan:k1,k2,p1,p2[,k3]` or `fisheye:k1,k2,k3,k4`; OpenCV's and Kalibr's other names of the two will do.
/// @throws CLI::ValidationError with the word or the coefficient that makes no sense
inline Distortion parse_lens(const std::string& text) {
  const auto fail = [&](const std::string& why) { throw CLI::ValidationError("--lens " + text, why); };
  const std::size_t colon = text.find(':');
  const std::string model = text.substr(0, colon);
  const bool radial = model == "radtan" || model == "radial-tangential" || model == "plumb_bob";
  const bool fisheye = model == "fisheye" || model == "equidistant";
  if (!radial && !fisheye) fail("the lens is \"" + model + "\", not radtan or fisheye");
  std::vector<double> k;
  if (colon != std::string::npos)
    for (const std::string& word : CLI::detail::split(text.substr(colon + 1), ',')) {
      const std::vector<const char*> names =
          radial ? std::vector{"k1", "k2", "p1", "p2", "k3"} : std::vector{"k1", "k2", "k3", "k4"};
      const std::string name = k.size() < names.size() ? names[k.size()] : "one too many";
      double value = 0;
      if (!CLI::detail::lexical_cast(word, value) || !std::isfinite(value)) fail(name + " is \"" + word + "\"");
      k.push_back(value);
    }
  if (fisheye && k.size() != 4) fail("a fisheye lens has 4 coefficients, not " + std::to_string(k.size()));
  if (fisheye) return EquidistantDistortion{k[0], k[1], k[2], k[3]};
  if (k.size() != 4 && k.size() != 5) fail("a radtan lens has 4 or 5 coefficients, not " + std::to_string(k.size()));
  k.resize(5);
  return BrownConradyDistortion{k[0], k[1], k[2], k[3], k[4]};
}

}  // namespace evmarker
