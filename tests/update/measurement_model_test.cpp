#include "evmarker/update/measurement_model.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

namespace {

constexpr double kFarFromEnds_px2 = 1e6;

// Offset 0.3 px, trail 0.2 px, OFF events later by 0.4 ms.
MeasurementModel model() { return {.bias = {0.3, 0.2, 0.4}, .robust_px = 2, .spread_px2 = 0.25}; }

}  // namespace

TEST_CASE("measurement model: events of both polarities lie where offset, trail and OFF delay say") {
  CHECK(model().residual_px(0.3 - 0.2, 1, 1, 1, 0) == doctest::Approx(0).epsilon(1e-15));
  CHECK(model().residual_px(0.3 + 0.2, 1, -1, 1, 0) == doctest::Approx(0).epsilon(1e-15));
  CHECK(model().residual_px(0.5, 0, 1, 1, 0) == 0.5);  // dark side not known
  // At 2000 px/s toward the dark, ON events are 0.4 px ahead of the mean of both polarities; at as much away from it,
  // OFF events are 0.4 px behind, which is toward the dark, too.
  CHECK(model().residual_px(0.3 - 0.2 + 0.4, 1, 1, 1, 2000) == doctest::Approx(0).epsilon(1e-15));
  CHECK(model().residual_px(0.3 + 0.2 + 0.4, 1, -1, 1, -2000) == doctest::Approx(0).epsilon(1e-15));
  CHECK(model().residual_px(0.4, 0, 1, 1, 2000) == doctest::Approx(0).epsilon(1e-15));
}

TEST_CASE("measurement model: a row is the derivative of the residual by pose and biases") {
  const Vec3 g{100, -40, 7}, lever{0.03, 0.05, -0.01};
  MeasurementModel moving = model();
  moving.twist = {{0.3, 0.1, -0.2}, {1, -2, 0.5}};
  moving.time_direction = -1;
  const auto [row, weight, residual2, lever2, gradient2, toward_dark_px_per_s] =
      moving.measure(g, lever, 0.8, kFarFromEnds_px2, 1, -1);
  const double px_per_s = -dot(g, moving.twist.t + cross(moving.twist.r, lever));
  const auto residual_at = [&](const Vec6& step, const std::array<double, kBiases>& biases) {
    const double moved_px = dot(g, step.t + cross(step.r, lever));  // the edge, along its normal
    MeasurementModel other = model();
    for (std::size_t b = 0; b < kBiases; ++b) other.bias[b] += biases[b];
    return other.residual_px(0.8 - moved_px, 1, -1, 1, px_per_s);
  };
  const double before = residual_at({}, {});
  CHECK(row[6 + kBiases] == before);
  constexpr double kStep = 1e-3;
  for (std::size_t k = 0; k < 6 + kBiases; ++k) {
    CAPTURE(k);
    std::array<double, 6 + kBiases> step{};
    step[k] = kStep;
    const Vec6 motion{{step[0], step[1], step[2]}, {step[3], step[4], step[5]}};
    CHECK((before - residual_at(motion, {step[6], step[7], step[8]})) / kStep == doctest::Approx(row[k]).epsilon(1e-9));
  }
  CHECK(residual2 == before * before);
  CHECK(weight == doctest::Approx(4 / (4 + before * before)));
  CHECK(lever2 == doctest::Approx(0.0035));
  CHECK(gradient2 == doctest::Approx(11649));
  CHECK(toward_dark_px_per_s == doctest::Approx(px_per_s));
}

TEST_CASE("measurement model: far events of a fast edge count as more, the slower the pixels are") {
  MeasurementModel slow = model();
  slow.response_s = 2e-3;
  const Vec3 g{100, 0, 0};
  const auto weight = [&](double speed_px_per_s) {
    slow.twist = {{speed_px_per_s / g.x, 0, 0}, {}};
    return slow.measure(g, {}, 3, kFarFromEnds_px2, 0, 0).weight;
  };
  CHECK(weight(0) == doctest::Approx(4 / (4 + 9.0)).scale(0));
  CHECK(weight(1500) == doctest::Approx((4 + 9) / (4 + 9 + 9.0)).scale(0));  // smeared by 3 px
  CHECK(weight(-1500) == weight(1500));
}

TEST_CASE("measurement model: an event within three spreads of its edge's end counts a fifth") {
  const auto weight = [](double from_end_px) {
    return model().measure({1, 0, 0}, {}, 0, from_end_px * from_end_px, 1, 1).weight;
  };
  CHECK(weight(1.49) == doctest::Approx(0.2 * weight(1.51)));
  CHECK(weight(1.51) == weight(1000));
}

TEST_CASE("the offset is proportional to an edge's contrast, the trail to its inverse") {
  // Offset 0.3, trail 0.2.
  CHECK(model().residual_px(2 * 0.3 - 0.2 / 2, 1, 1, 2, 0) == doctest::Approx(0).epsilon(1e-12));
  const auto row = model().measure({1, 0, 0}, {}, 0, kFarFromEnds_px2, 1, 1, 2).row;
  CHECK(row[6 + kOffset] == 2);
  CHECK(row[6 + kTrail] == -0.5);
}

TEST_CASE(
    "amid noise, an event counts less the slower its edge moves, and nearly nothing if it contradicts the motion") {
  const auto weight = [](double px_per_s, double polarity, double direction) {
    MeasurementModel noisy = model();
    noisy.by_chance_px_per_s = 10;
    noisy.speed_deviation_px_per_s = 10;
    noisy.twist = {{px_per_s, 0, 0}, {}};
    noisy.time_direction = direction;
    const double at = 0.3 - 0.2 * polarity;  // no residual
    return noisy.measure({1, 0, 0}, {}, at, kFarFromEnds_px2, 1, polarity).weight;
  };
  CHECK(weight(1000, 1, 1) > 0.9);
  CHECK(weight(100, 1, 1) == doctest::Approx(0.909).epsilon(0.01));
  CHECK(weight(10, 1, 1) == doctest::Approx(0.547).epsilon(0.01));
  CHECK(weight(1000, -1, 1) < 0.004);
  CHECK(weight(-1000, -1, 1) > 0.9);
  CHECK(weight(-1000, 1, -1) > 0.9);  // seen backwards
  CHECK(weight(1000, 0, 1) > 0.9);    // polarity not known
}
