#include "evmarker/simulation/sensor_pixel.hpp"

#include <doctest/doctest.h>

#include <vector>

using namespace evmarker;

namespace {

/// The way of the light from a pixel's first event to its second, as it rises (or falls) by 0.001 a microsecond.
double threshold(EventPixel pixel, bool rising) {
  std::vector<double> times;
  pixel.advance(0, 2000, rising ? 2 : -2, {0, 0}, [&](double t, bool) { return times.emplace_back(t); });
  return (times.at(1) - times.at(0)) * 1e-3;
}

struct Spread {
  double mean = 0, deviation = 0;
};

template <typename Measure>
Spread over_many(const SimulatorSettings& settings, Measure&& measure) {
  constexpr int kPixels = 20000;
  double sum = 0, squares = 0;
  for (int i = 0; i < kPixels; ++i) {
    const double value = measure(make_pixel(settings, static_cast<std::uint64_t>(i), 0));
    sum += value / kPixels;
    squares += value * value / kPixels;
  }
  return {sum, std::sqrt(squares - sum * sum)};
}

}  // namespace

TEST_CASE("thresholds are spread from pixel to pixel, each polarity around its own") {
  const SimulatorSettings settings{
      .contrast_threshold_on = 0.4, .contrast_threshold_off = 0.2, .threshold_mismatch = 0.03};
  const Spread on = over_many(settings, [](const EventPixel& pixel) { return threshold(pixel, true); });
  const Spread off = over_many(settings, [](const EventPixel& pixel) { return threshold(pixel, false); });
  CHECK(on.mean == doctest::Approx(0.4).epsilon(0.003).scale(0));
  CHECK(off.mean == doctest::Approx(0.2).epsilon(0.005).scale(0));
  CHECK(on.deviation == doctest::Approx(0.03).epsilon(0.02).scale(0));
  CHECK(off.deviation == doctest::Approx(0.03).epsilon(0.02).scale(0));
}

TEST_CASE("a leak changes no threshold, has the rate that is set on average, and each pixel its own") {
  SimulatorSettings settings{.threshold_mismatch = 0.03};
  const EventPixel firm = make_pixel(settings, 7, 0);
  settings.leak_hz_per_px = 1e-9;
  CHECK(threshold(firm, false) == doctest::Approx(threshold(make_pixel(settings, 7, 0), false)).epsilon(1e-6));

  settings = {.threshold_mismatch = 0, .leak_hz_per_px = 2, .leak_spread = 0.5};
  const auto period_us = [](EventPixel pixel) {
    std::vector<double> times;
    pixel.advance(0, 1e8, 0, {0, 0}, [&](double t, bool) {
      times.push_back(t);
      return t;
    });
    return times.at(1) - times.at(0);
  };
  const Spread rate = over_many(settings, [&](const EventPixel& pixel) { return 1e6 / period_us(pixel); });
  CHECK(rate.mean == doctest::Approx(2).epsilon(0.01).scale(0));
  const Spread log_rate = over_many(settings, [&](const EventPixel& pixel) { return std::log(period_us(pixel)); });
  CHECK(log_rate.deviation == doctest::Approx(0.5).epsilon(0.02).scale(0));
  // At the start the pixels are anywhere on their way to the next event.
  const Spread phase =
      over_many(settings, [&](const EventPixel& pixel) { return pixel.leak_event_us() / period_us(pixel); });
  CHECK(phase.mean == doctest::Approx(0.5).epsilon(0.02).scale(0));
  CHECK(phase.deviation == doctest::Approx(std::sqrt(1 / 12.0)).epsilon(0.02).scale(0));
}

TEST_CASE("a pixel follows a step in the light that it has then: 1 - exp(-t light / time constant)") {
  const SimulatorSettings settings{.pixel_time_constant_us = 50, .light_time_constant_us = 100};
  const auto none = [](double t, bool) { return t; };
  for (const double light : {1.0, 0.5, 0.1}) {
    EventPixel pixel(std::log(light) - 1, 10, 10);
    follow_light(pixel, settings, 0, 1e-6, std::log(light), none);  // as good as a step
    follow_light(pixel, settings, 1e-6, 300, std::log(light), none);
    const double time_constant = 50 + 100 / light;
    CHECK(pixel.level() == doctest::Approx(std::log(light) - std::exp(-300 / time_constant)).epsilon(1e-4));
  }
}

TEST_CASE("without light-dependent stages it is the pixel's own straight line") {
  const SimulatorSettings settings{.pixel_time_constant_us = 80};
  std::vector<double> followed, advanced;
  EventPixel one(0, 0.25, 0.25), other(0, 0.25, 0.25);
  follow_light(one, settings, 0, 1000, 2, [&](double t, bool) { return followed.emplace_back(t); });
  other.advance(0, 1000, 2, {80, 50}, [&](double t, bool) { return advanced.emplace_back(t); });
  REQUIRE(followed.size() > 3);
  CHECK(followed == advanced);
  CHECK(one.level() == other.level());
}
