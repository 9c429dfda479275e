#pragma once
// What tests of matchers have in common: markers with random codes, and when two correspondences agree.
#include <cmath>
#include <cstdint>

#include "evmarker/matching/correspondence.hpp"
#include "evmarker/model/marker_model.hpp"
#include "random_pose.hpp"

inline evmarker::CodeBits random_bits(SeededNumbers& random, int size) {
  evmarker::CodeBits bits(size, size);
  for (int i = 0; i < bits.size(); ++i) bits(i / size, i % size) = static_cast<std::uint8_t>(random.integer(0, 1));
  return bits;
}

inline bool agree(const evmarker::Correspondence& a, const evmarker::Correspondence& b) {
  return a.segment == b.segment && std::abs(a.distance_px - b.distance_px) < 1e-7 &&
         std::abs(a.squared_px - b.distance_px * b.distance_px) < 1e-7 &&
         std::abs(b.squared_px - b.distance_px * b.distance_px) < 1e-12 && (a.normal - b.normal).norm() < 1e-9 &&
         a.dark_side_known == b.dark_side_known && (a.M - b.M).norm() == 0 && (a.E - b.E).norm() < 1e-9 * a.E.norm() &&
         (a.F - b.F).norm() < 1e-9 * a.F.norm() && (a.gradient - b.gradient).norm() < 1e-7 * a.gradient.norm();
}
