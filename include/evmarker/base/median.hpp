#pragma once
// The median of a sample.
#include <algorithm>
#include <cstddef>
#include <vector>

namespace evmarker {

/// The median, of an even number of values the upper of the two in the middle; there must be at least one.
inline double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace evmarker
