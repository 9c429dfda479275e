#pragma once
// Variances of what is estimated from samples that err alike when they follow each other.
#include <cstddef>
#include <utility>
#include <vector>

namespace evmarker {

/// Factor from the sum of squared deviations of ten such estimates to the variance, see leave_out_tenths.
inline constexpr double kJackknifeWeight = 0.9;

/// Calls `add(others)` with the samples without the first tenth of them, without the second, and so on: the deviations
/// of the ten estimates from that of all samples give its variance (the delete-a-group jackknife), in which is what the
/// errors of neighbouring samples have in common.
template <typename Sample, typename Add>
void leave_out_tenths(const std::vector<Sample>& samples, const Add& add) {
  constexpr std::size_t kGroups = 10;
  for (std::size_t left_out = 0; left_out < kGroups; ++left_out) {
    std::vector<Sample> others;
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (i * kGroups / samples.size() != left_out) others.push_back(samples[i]);
    add(std::move(others));
  }
}

}  // namespace evmarker
