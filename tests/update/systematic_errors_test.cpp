#include "evmarker/update/systematic_errors.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

using namespace evmarker;

namespace {

constexpr double kSpread_px2 = 0.7, kPxPerS = 100;

}  // namespace

TEST_CASE("systematic errors: before an event, they are those of the settings") {
  KalmanSettings settings;
  settings.latency_s = 0.002;
  settings.latency_sigma_s = 0.001;
  const SystematicErrors errors(settings);
  CHECK(errors.delay_s() == 0.002);
  CHECK(errors.response_s() == 0);
  CHECK(errors.smear_px(kPxPerS) == 0);
  CHECK(errors.delay_variance_s2(kPxPerS) == doctest::Approx(1e-6));
  CHECK(errors.covariance_per_edge_px2().isZero(0));
  CHECK(errors.edge_variance_px2() == 0);
  CHECK(errors.misfit_px2() == 0);
  CHECK(errors.event_noise() == 1);
  CHECK(errors.most_trail_px() == std::numeric_limits<double>::infinity());
  CHECK_FALSE(errors.events_fill_distance());
}

TEST_CASE("systematic errors: the width of the edges bounds the trail") {
  KalmanSettings settings;
  for (const double initial_trail_px : {0.0, 5.0}) {
    settings.initial_trail_px = initial_trail_px;
    SystematicErrors errors(settings);
    errors.measure(kSpread_px2, kPxPerS, true, 0, 0);
    CHECK(errors.most_trail_px() == std::numeric_limits<double>::infinity());
    errors.measure(kSpread_px2, kPxPerS, true, 4, 0);
    const double trail_px = errors.trail_by_width_px(kSpread_px2, kPxPerS, 4);
    CHECK(trail_px > 0.1);
    CHECK(errors.most_trail_px() == doctest::Approx(std::max(2 * trail_px, initial_trail_px)));
  }
}

TEST_CASE(
    "systematic errors: a delay is measured within the matching distance that was set, at first and when forgotten") {
  // OFF events late by an exponential time of mean 2 ms.
  const auto feed = [](auto&& add) {
    std::mt19937 random(1);
    std::uniform_real_distribution<double> unit(0, 1);
    std::normal_distribution<double> normal;
    for (int i = 0; i < 5000; ++i) {
      const double v = 800 * unit(random), late_s = i % 2 == 0 ? 0 : -2e-3 * std::log(1 - unit(random));
      const double residual_px = 0.5 * normal(random) + v * late_s;
      if (std::abs(residual_px) < 3) add(residual_px, v, i % 2 == 0 ? 1 : -1);
    }
  };
  const auto delay_within = [&](double distance_px) {
    ResponseTime response(distance_px);
    feed([&](auto... sample) { response.add(sample...); });
    return response.delay_s();
  };
  REQUIRE(delay_within(3) > 0);
  REQUIRE(delay_within(2) > 1.1 * delay_within(3));
  SystematicErrors errors{KalmanSettings()};
  errors.set_max_distance_px(3);
  for (int i = 0; i < 2; ++i) {
    feed([&](auto... sample) { errors.add_moving_sample(sample...); });
    CHECK(errors.response_s() == delay_within(3));
    errors.forget_start();
    CHECK(errors.response_s() == 0);
  }
}

TEST_CASE("systematic errors: a spread beyond that of a focused sensor makes the time of the pose uncertain") {
  SystematicErrors errors{KalmanSettings()};
  const double known_s2 = errors.delay_variance_s2(kPxPerS);
  for (int i = 0; i < 100; ++i) errors.add_noise_share(0.3);
  errors.measure(1.1, kPxPerS, false, 0, 0);  // perhaps by noise
  CHECK(errors.delay_variance_s2(kPxPerS) == known_s2);
  errors.measure(1.1, kPxPerS, true, 0, 0);
  CHECK(errors.delay_variance_s2(kPxPerS) > known_s2 + 0.5 / (kPxPerS * kPxPerS));
  CHECK(errors.events_fill_distance());
  errors.set_max_distance_px(3);
  errors.measure(1.1, kPxPerS, true, 0, 0);
  CHECK_FALSE(errors.events_fill_distance());
}

TEST_CASE("systematic errors: a spread beyond what noise explains tells that the edges are lost") {
  const auto fill = [](double noise_share, double spread_px2) {
    SystematicErrors errors{KalmanSettings()};
    for (int i = 0; i < 100; ++i) errors.add_noise_share(noise_share);
    errors.measure(spread_px2, kPxPerS, false, 0, 0);
    const bool unsure = errors.delay_variance_s2(kPxPerS) > 1 / (kPxPerS * kPxPerS);
    CHECK(unsure == errors.events_fill_distance());
    return unsure;
  };
  // Evenly over 2 px it is 1.33; over the edges' width .7, and .89 where three tenths of the events are noise.
  CHECK(fill(0, 1.1));
  CHECK_FALSE(fill(0, 0.9));
  CHECK(fill(0.3, 1.3));
  CHECK_FALSE(fill(0.3, 1.1));
  CHECK_FALSE(fill(0.3, 0.89));
  CHECK_FALSE(fill(0.6, 1.33));  // by noise alone
}

TEST_CASE("systematic errors: those of whole edges are evaluated when the edges have moved by several widths") {
  SystematicErrors errors{KalmanSettings()};
  for (int i = 0; i < 700; ++i) {
    const auto of_state = static_cast<std::size_t>(i % 7);
    MeasurementRow row{};
    row[of_state] = 1;
    errors.add(i % 10, i % 10 < 5 ? 0.1 : -0.1, 1);
    errors.add_sample(row, 1);
  }
  errors.add_motion(1, kSpread_px2);
  CHECK(errors.covariance_per_edge_px2().isZero(0));
  errors.add_motion(10, kSpread_px2);
  // Ten edges that err by 0.1 px, without noise; a seventh of the events shows each element of the pose.
  CHECK(errors.edge_variance_px2() == doctest::Approx(0.01));
  for (int i = 0; i < 6; ++i) CHECK(errors.covariance_per_edge_px2()(i, i) == doctest::Approx(7 / 10.0));
}

TEST_CASE("systematic errors: the noise of events is what differs between the halves of a motion") {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const auto noise_of = [&](double shift_px) {
    SystematicErrors errors{KalmanSettings()};
    const double width_px = std::sqrt(kSpread_px2);
    for (int half = 0; half < 400; ++half) {
      for (int i = 0; i < 700; ++i) {
        const double residual_px = width_px * normal(random) + (half % 2 == 0 ? shift_px : 0);
        MeasurementRow row{};
        row[static_cast<std::size_t>(i / 10 % 7)] = 1;
        row[6 + kBiases] = residual_px;
        errors.add(i % 10, residual_px, 1);
        errors.add_sample(row, 1);
      }
      errors.add_motion(half % 2 == 0 ? 5 * width_px : 4 * width_px, kSpread_px2);
    }
    return errors.event_noise();
  };
  CHECK(noise_of(0) == doctest::Approx(1).epsilon(0.2));
  CHECK(noise_of(0.5) > 5);
}

TEST_CASE("systematic errors: a spread that stays is blur, unless it is the start pose's, or noise") {
  const auto move = [](SystematicErrors& errors, double spread_px2) {
    for (int i = 0; i < 1000; ++i) errors.add_motion(1, spread_px2);
  };
  SystematicErrors errors{KalmanSettings()};
  move(errors, 1.2);  // while the start pose is still off
  CHECK(errors.blur() == 1);
  errors.forget_start();
  CHECK(errors.blur() == 1);
  move(errors, 1.2);
  CHECK(errors.blur() == doctest::Approx(std::sqrt(1.2) / EdgeBlur::kSharp_px));
  // Explained, it makes the pose no less certain.
  SystematicErrors sharp{KalmanSettings()};
  for (SystematicErrors* one : {&errors, &sharp}) {
    one->set_max_distance_px(3.3);
    one->measure(1.2, kPxPerS, true, 0, 0);
  }
  CHECK(errors.delay_variance_s2(kPxPerS) < 0.5 * sharp.delay_variance_s2(kPxPerS));
  errors.forget_start();
  for (int i = 0; i < 100; ++i) errors.add_noise_share(0.8);
  move(errors, 1.2);
  CHECK(errors.blur() == 1);
}
