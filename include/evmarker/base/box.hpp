#pragma once
// An axis-aligned rectangle in a plane.
#include <algorithm>
#include <limits>

#include "evmarker/base/vector.hpp"

namespace evmarker {

/// An axis-aligned rectangle, its boundary included. A default-constructed one is empty.
struct Box {
  Vec2 low{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity()};
  Vec2 high{-std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};

  /// The whole plane.
  static constexpr Box everywhere() noexcept {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    return {{-kFar, -kFar}, {kFar, kFar}};
  }

  bool empty() const noexcept { return low.x > high.x || low.y > high.y; }
  /// The sides; negative infinity for a default-constructed box.
  double width() const noexcept { return high.x - low.x; }
  double height() const noexcept { return high.y - low.y; }
  /// The longer side.
  double size() const noexcept { return std::max(width(), height()); }

  /// Grows the box just enough to contain a point.
  void extend(Vec2 point) noexcept {
    low = {std::min(low.x, point.x), std::min(low.y, point.y)};
    high = {std::max(high.x, point.x), std::max(high.y, point.y)};
  }
  /// Grows the box just enough to contain another one.
  void extend(const Box& other) noexcept {
    low = {std::min(low.x, other.low.x), std::min(low.y, other.low.y)};
    high = {std::max(high.x, other.high.x), std::max(high.y, other.high.y)};
  }
  /// A copy that is larger by `margin` on every side.
  Box widened(double margin) const noexcept {
    return {{low.x - margin, low.y - margin}, {high.x + margin, high.y + margin}};
  }

  /// The common part of both boxes; empty if they do not intersect.
  Box intersection(const Box& other) const noexcept {
    return {{std::max(low.x, other.low.x), std::max(low.y, other.low.y)},
            {std::min(high.x, other.high.x), std::min(high.y, other.high.y)}};
  }

  bool contains(Vec2 point) const noexcept {
    return low.x <= point.x && low.y <= point.y && point.x <= high.x && point.y <= high.y;
  }
  bool contains(const Box& other) const noexcept {
    return low.x <= other.low.x && low.y <= other.low.y && other.high.x <= high.x && other.high.y <= high.y;
  }
  /// True if both boxes have a common point; touching is enough.
  bool intersects(const Box& other) const noexcept {
    return low.x <= other.high.x && low.y <= other.high.y && other.low.x <= high.x && other.low.y <= high.y;
  }
};

}  // namespace evmarker
