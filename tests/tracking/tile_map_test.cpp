#include "evmarker/tracking/tile_map.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <random>
#include <vector>

#include "evmarker/model/camera.hpp"

using evmarker::Box;
using evmarker::Event;
using evmarker::PinholeCamera;
using evmarker::TileMap;
using evmarker::UndistortionTable;
using evmarker::Vec2;

namespace {

const PinholeCamera kStraight{{200, 150}, 160, 160, 99.5, 74.5};
const PinholeCamera kDistorted{{203, 149}, 150, 155,
                               97,         71,  evmarker::BrownConradyDistortion{-0.32, 0.11, 0.001, -0.002, -0.02}};

std::vector<int> asked(const TileMap& map, const Event& event) {
  std::vector<int> markers;
  map.for_each_at(event, [&](std::size_t i) { markers.push_back(static_cast<int>(i)); });
  return markers;
}

Event event_on(int x, int y) { return {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1, 0}; }

}  // namespace

TEST_CASE("every event in a marker's reach is told to it, and few others are, as markers move") {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(-0.7, 0.7), size(0, 0.2), step(-0.05, 0.05);
  for (const PinholeCamera& camera : {kStraight, kDistorted}) {
    const UndistortionTable lines(camera);
    TileMap map(lines, 70);
    std::vector<Box> reaches(70);  // more than there are bits
    map.resize(reaches.size());
    for (Box& reach : reaches) {
      const Vec2 low(place(random), place(random));
      reach = {low, low + Vec2(size(random), size(random))};
    }
    long inside = 0, told = 0, pixels = 0;
    for (int round = 0; round < 20; ++round) {
      for (std::size_t i = 0; i < reaches.size(); ++i) {
        const Vec2 moved(step(random), step(random));
        reaches[i] = {reaches[i].low + moved, reaches[i].high + moved};
        map.move(i, reaches[i]);
      }
      for (int y = 0; y < camera.sensor_size().height; ++y)
        for (int x = 0; x < camera.sensor_size().width; ++x) {
          const std::vector<int> markers = asked(map, event_on(x, y));
          std::vector<int> times(reaches.size());
          for (const int marker : markers) ++times[static_cast<std::size_t>(marker)];
          for (std::size_t i = 0; i < reaches.size(); ++i) {
            const bool reached = reaches[i].contains(lines(event_on(x, y)));
            inside += reached;
            if (times[i] > 1 || (reached && times[i] != 1)) FAIL_CHECK("marker " << i << " at " << x << ", " << y);
          }
          const auto its = [&](const Box& reach) { return reach.contains(lines(event_on(x, y))); };
          if (std::ranges::count_if(reaches, its) > 1 && !map.shared(event_on(x, y), lines))
            FAIL_CHECK("not shared at " << x << ", " << y);
          told += static_cast<long>(markers.size());
          ++pixels;
        }
    }
    REQUIRE(inside > 100000);
    CHECK(told < 20 * pixels);  // of 70 markers that are an eighth of the image wide on average
  }
}

TEST_CASE("a marker that may be anywhere is told everything, one that left or was never placed nothing") {
  const UndistortionTable lines(kStraight);
  TileMap map(lines, 3);
  map.resize(3);
  CHECK(asked(map, event_on(100, 75)).empty());
  map.move(1, Box::everywhere());
  map.move(2, {{-0.1, -0.1}, {0.1, 0.1}});
  CHECK(asked(map, event_on(100, 75)) == std::vector{1, 2});
  CHECK(asked(map, event_on(0, 149)) == std::vector{1});
  CHECK(map.shared(event_on(100, 75), lines));
  CHECK_FALSE(map.shared(event_on(0, 149), lines));
  map.move(2, {{5, 5}, {6, 6}});
  CHECK(asked(map, event_on(100, 75)) == std::vector{1});
  map.resize(2);
  CHECK(asked(map, event_on(100, 75)).empty());
}

TEST_CASE("a marker that might be anywhere, or recedes, is soon told only what lies near it") {
  const UndistortionTable lines(kStraight);
  TileMap map(lines, 1);
  map.resize(1);
  map.move(0, Box::everywhere());
  map.move(0, {{-0.1, -0.1}, {0.1, 0.1}});
  CHECK(asked(map, event_on(100, 75)) == std::vector{0});
  CHECK(asked(map, event_on(0, 149)).empty());
  CHECK(asked(map, event_on(100, 75 + 15)) == std::vector{0});
  for (double half = 0.1; half > 0.01; half *= 0.99) map.move(0, {{-half, -half}, {half, half}});
  CHECK(asked(map, event_on(100, 75)) == std::vector{0});
  CHECK(asked(map, event_on(100, 75 + 32)).empty());
}

TEST_CASE("events that come before the next move may lie three pixels beyond the reach") {
  const UndistortionTable lines(kStraight);
  TileMap map(lines, 2);
  map.resize(2);
  map.move(0, Box::everywhere());
  for (int x = 60; x < 140; ++x)
    for (const double part : {0.0, 0.3, 0.6}) {
      const Vec2 right = lines(event_on(x, 75));
      map.move(1, {{right.x - 0.1, -0.1}, {right.x - part * (lines(event_on(x + 1, 75)).x - right.x), 0.1}});
      CAPTURE(x);
      CHECK(map.shared(event_on(x + 2, 75), lines));
    }
}
