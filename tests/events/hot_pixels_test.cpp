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

std::vector<Event> column(int x = 20) {
  std::vector<Event> pixels;
  for (int y = 0; y < kSmallSensor.height; ++y) pixels.push_back(at(x, y));
  return pixels;
}
std::vector<Event> row() {
  std::vector<Event> pixels;
  for (int x = 0; x < kSmallSensor.width; ++x) pixels.push_back(at(x, 0));
  return pixels;
}

// Each pixel fires with either polarity in turn.
std::vector<Event> with_both_polarities(std::vector<Event> pixels) {
  const std::size_t count = pixels.size();
  for (std::size_t i = 0; i < count; ++i) {
    pixels.push_back(pixels[i]);
    pixels.back().p = 0;
  }
  return pixels;
}

}  // namespace

TEST_CASE("pixels that go on firing alone, or in a line, are hot within 0.1 s") {
  for (const auto& pixels : {std::vector{at(20, 20)}, std::vector{at(63, 47)}, with_both_polarities(column()),
                             with_both_polarities(row())}) {
    HotPixels hot_pixels(kSmallSensor);
    const Firing firing{pixels, pixels.size() == 1 ? 10000.0 : 5000.0};
    CHECK(count_hot(hot_pixels, firing, 0, 6000) == 0);
    count_hot(hot_pixels, firing, 6000, 124000);
    const auto events = static_cast<std::size_t>(firing.hz * 0.1) * pixels.size();
    CHECK(count_hot(hot_pixels, firing, 130000, 100000) >= events);
  }
}

TEST_CASE("pixels that fire slowly, or beside others that do, are not hot") {
  HotPixels hot_pixels(kSmallSensor);
  CHECK(count_hot(hot_pixels, {{at(20, 20)}, 1000}, 0, 500000) == 0);
  CHECK(count_hot(hot_pixels, {with_both_polarities(column()), 200}, 500000, 500000) == 0);
  std::vector<Event> area;  // as of a flickering lamp
  for (int y = 0; y < kSmallSensor.height; ++y)
    for (int x = 0; x < kSmallSensor.width; ++x) area.push_back(at(x, y));
  CHECK(count_hot(hot_pixels, {area, 10000}, 1000000, 200000) == 0);
}

TEST_CASE("a row or column is hot after 40 events of each pixel with one polarity, or 120 with both") {
  for (const auto& pixels : {column(), column(0), column(kSmallSensor.width - 1), row()}) {
    HotPixels hot_pixels(kSmallSensor);
    const Firing firing{pixels, 3000};
    CHECK(count_hot(hot_pixels, firing, 0, 12000) == 0);
    count_hot(hot_pixels, firing, 12000, 8000);
    CHECK(count_hot(hot_pixels, firing, 20000, 100000) >= 3000 / 10 * pixels.size());
  }
  for (const auto& pixels : {with_both_polarities(column()), with_both_polarities(row())}) {
    HotPixels hot_pixels(kSmallSensor);
    const Firing firing{pixels, 1500};
    CHECK(count_hot(hot_pixels, firing, 0, 38000) == 0);
    count_hot(hot_pixels, firing, 38000, 12000);
    CHECK(count_hot(hot_pixels, firing, 50000, 100000) >= 1500 / 10 * pixels.size());
  }
}

TEST_CASE("an edge along a whole column that passes, goes on from a stop, or vibrates slowly is not hot") {
  HotPixels hot_pixels(kSmallSensor);
  std::size_t hot = 0;
  for (int x = 0; x < kSmallSensor.width; ++x)  // 20 events of each pixel
    hot += count_hot(hot_pixels, {column(x), 1000}, 20000 * x, 20000);
  hot += count_hot(hot_pixels, {column(30), 50}, 2000000, 400000);
  hot += count_hot(hot_pixels, {with_both_polarities(column(40)), 200}, 3000000, 1000000);
  CHECK(hot == 0);
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
