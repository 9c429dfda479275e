#include "evmarker/events/hot_pixels.hpp"

#include <doctest/doctest.h>

#include <vector>

using namespace evmarker;

namespace {

constexpr SensorSize kSmallSensor{64, 48};

// Events of some pixels, each in turn, from a time on, all at the same rate.
struct Firing {
  std::vector<Event> pixels;
  double hz = 0;
};

// How many of the events until `length` [us] are those of hot pixels.
std::size_t count_hot(HotPixels& hot_pixels, const Firing& firing, Timestamp begin, Timestamp length) {
  const double step_us = 1e6 / firing.hz / static_cast<double>(firing.pixels.size());
  std::size_t hot = 0, number = 0;
  for (double t = 0; t < static_cast<double>(length); t += step_us) {
    Event event = firing.pixels[number++ % firing.pixels.size()];
    event.t = begin + static_cast<Timestamp>(t);
    hot += hot_pixels.add(event);
  }
  return hot;
}

Event at(int x, int y) { return {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1, 0}; }

std::vector<Event> column() {
  std::vector<Event> pixels;
  for (int y = 0; y < kSmallSensor.height; ++y) pixels.push_back(at(20, y));
  return pixels;
}

}  // namespace

TEST_CASE("pixels that go on firing alone, or in a line, are hot within 0.1 s") {
  std::vector<Event> row;
  for (int x = 0; x < kSmallSensor.width; ++x) row.push_back(at(x, 0));
  for (const auto& pixels : {std::vector{at(20, 20)}, std::vector{at(63, 47)}, column(), row}) {
    HotPixels hot_pixels(kSmallSensor);
    const Firing firing{pixels, 10000};
    CHECK(count_hot(hot_pixels, firing, 0, 6000) == 0);
    count_hot(hot_pixels, firing, 6000, 124000);
    const auto events = static_cast<std::size_t>(10000 * 0.1) * pixels.size();
    CHECK(count_hot(hot_pixels, firing, 130000, 100000) >= events);
  }
}

TEST_CASE("pixels that fire slowly, or beside others that do, are not hot") {
  HotPixels hot_pixels(kSmallSensor);
  CHECK(count_hot(hot_pixels, {{at(20, 20)}, 1000}, 0, 500000) == 0);
  CHECK(count_hot(hot_pixels, {column(), 1000}, 500000, 500000) == 0);
  std::vector<Event> area;  // as of a flickering lamp
  for (int y = 0; y < kSmallSensor.height; ++y)
    for (int x = 0; x < kSmallSensor.width; ++x) area.push_back(at(x, y));
  CHECK(count_hot(hot_pixels, {area, 10000}, 1000000, 200000) == 0);
}

TEST_CASE("a pixel is hot for a second after it has stopped") {
  HotPixels hot_pixels(kSmallSensor);
  const Firing firing{{at(20, 20)}, 10000};
  REQUIRE(count_hot(hot_pixels, firing, 0, 100000) > 0);
  CHECK(hot_pixels.add({20, 20, 1, 1000000}));
  CHECK(!hot_pixels.add({21, 20, 1, 1000000}));
  CHECK(!hot_pixels.add({20, 20, 1, 1600000}));
}
