#include "evmarker/events/hot_pixels.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <span>
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
    hot += hot_pixels.is_hot(event);
    hot_pixels.count(std::span(&event, 1));
    if (number % HotPixels::kEventsPerUpdate == 0) hot_pixels.update();
  }
  hot_pixels.update();
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
  REQUIRE(count_hot(hot_pixels, firing, 0, 200000) > 0);
  CHECK(hot_pixels.is_hot({20, 20, 1, 1000000}));
  CHECK(!hot_pixels.is_hot({21, 20, 1, 1000000}));
  CHECK(!hot_pixels.is_hot({20, 20, 1, 1600000}));
}

TEST_CASE("what is hot does not depend on how many events are counted at once") {
  std::vector<Event> events;
  for (int i = 0; i < 20 * 1024; ++i) {
    events.push_back(at(i % 5 * 10, 20));
    if (i % 3 == 0) events.back() = at(70, 20);  // off the sensor
    events.back().t = 30 * i;
  }
  const auto hot = [&](std::size_t at_once) {
    HotPixels hot_pixels(kSmallSensor);
    std::vector<bool> verdicts;
    for (auto rest = std::span<const Event>(events); !rest.empty();) {
      const auto batch =
          rest.first(std::min(at_once, HotPixels::kEventsPerUpdate - verdicts.size() % HotPixels::kEventsPerUpdate));
      for (const Event& event : batch) verdicts.push_back(event.x < 64 && hot_pixels.is_hot(event));
      hot_pixels.count(batch);
      if (verdicts.size() % HotPixels::kEventsPerUpdate == 0) hot_pixels.update();
      rest = rest.subspan(batch.size());
    }
    return verdicts;
  };
  const auto one_by_one = hot(1);
  CHECK(std::ranges::count(one_by_one, true) > 1000);
  CHECK(hot(7) == one_by_one);
  CHECK(hot(1024) == one_by_one);
}
