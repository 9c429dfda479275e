#pragma once
// Finds the parts of a model to which an event may belong, in constant time.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "evmarker/base/box.hpp"

namespace evmarker {

/// The part of the image that a model covers, in tiles, each with the set of parts whose events may lie in it. The
/// image is that of lines of sight (m; 1).
class PartTiles {
 public:
  /// Sets where the events of each part may lie; empty boxes: nowhere.
  void set(std::span<const Box> areas) noexcept {
    parts_ = areas.size();
    std::ranges::fill(tiles_, 0);
    Box all;
    for (const Box& area : areas)
      if (const Box here = area.intersection(kImage); !here.empty()) all.extend(here);
    low_ = all.low;
    tiles_per_unit_ = {kSide / all.width(), kSide / all.height()};
    for (std::size_t part = 0; part < parts_; ++part)
      if (const Box here = areas[part].intersection(kImage); !here.empty()) add(part, here);
  }

  /// Calls `use(part)` with the number of every part to which an event may belong, and with some others.
  template <typename Use>
  [[gnu::always_inline]] void for_each_at(Vec2 m, const Use& use) const {
    for (std::uint64_t bits = bits_at(m); bits != 0; bits &= bits - 1)
      for (auto part = static_cast<std::size_t>(std::countr_zero(bits)); part < parts_; part += kBits) use(part);
  }
  /// True if `for_each_at` finds at most one part.
  bool at_most_one_at(Vec2 m) const noexcept {
    const std::uint64_t bits = bits_at(m);
    return (bits & (bits - 1)) == 0 && parts_ <= kBits;
  }

 private:
  static constexpr std::size_t kSide = 32, kBits = 64;
  static constexpr Box kImage{{-100, -100}, {100, 100}};  // no lens sees more

  static std::size_t tile(std::size_t x, std::size_t y) noexcept { return y * kSide + x; }

  [[gnu::always_inline]] std::uint64_t bits_at(Vec2 m) const noexcept {
    const double x = (m.x - low_.x) * tiles_per_unit_.x, y = (m.y - low_.y) * tiles_per_unit_.y;
    const bool inside = x >= 0 && y >= 0 && x < kSide && y < kSide;  // false for NaN
    return inside ? tiles_[tile(static_cast<std::size_t>(x), static_cast<std::size_t>(y))] : 0;
  }

  void add(std::size_t part, const Box& area) noexcept {
    const auto column = [&](double x) { return index((x - low_.x) * tiles_per_unit_.x); };
    const auto row = [&](double y) { return index((y - low_.y) * tiles_per_unit_.y); };
    for (std::size_t y = row(area.low.y); y <= row(area.high.y); ++y)
      for (std::size_t x = column(area.low.x); x <= column(area.high.x); ++x)
        tiles_[tile(x, y)] |= std::uint64_t{1} << (part % kBits);  // the 65th part shares the bit of the first
  }
  static std::size_t index(double place) noexcept {
    return static_cast<std::size_t>(std::clamp(place, 0.0, static_cast<double>(kSide - 1)));
  }

  std::size_t parts_ = 0;
  Vec2 low_, tiles_per_unit_;
  std::vector<std::uint64_t> tiles_ = std::vector<std::uint64_t>(kSide * kSide);
};

}  // namespace evmarker
