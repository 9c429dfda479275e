#include "evmarker/events/background_activity.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <cstddef>
#include <random>
#include <vector>

#include "evmarker/events/spatiotemporal_filter.hpp"

using namespace evmarker;

namespace {

constexpr SensorSize kSize{128, 128};

// Noise of so many events per pixel and second, independent in place and time.
std::vector<Event> noise(double hz_per_px, double duration_s, SensorSize size = kSize, Timestamp start = 0) {
  std::mt19937_64 random(7);
  std::exponential_distribution<double> pause_us(hz_per_px * size.width * size.height * 1e-6);
  std::vector<Event> events;
  for (double t = pause_us(random); t < duration_s * 1e6; t += pause_us(random))
    events.push_back({static_cast<std::uint16_t>(random() % static_cast<unsigned>(size.width)),
                      static_cast<std::uint16_t>(random() % static_cast<unsigned>(size.height)),
                      static_cast<std::int16_t>(random() & 1), start + static_cast<Timestamp>(t)});
  return events;
}

std::vector<Event> merged(std::vector<Event> a, const std::vector<Event>& b) {
  const auto middle = static_cast<std::ptrdiff_t>(a.size());
  a.insert(a.end(), b.begin(), b.end());
  std::inplace_merge(a.begin(), a.begin() + middle, a.end(), [](const Event& l, const Event& r) { return l.t < r.t; });
  return a;
}

// Share of the events that pass.
double share(SpatiotemporalFilter& filter, const std::vector<Event>& events) {
  const auto passed = std::ranges::count_if(events, [&](const Event& event) { return filter.accept(event); });
  return static_cast<double>(passed) / static_cast<double>(events.size());
}

// A rate that has the window as long as it is.
double rate_of(const SpatiotemporalFilter& filter) { return 0.01e6 / static_cast<double>(filter.window().count()); }

// A vertical edge that moves to the right at a speed, three events at each pixel of a few columns.
std::vector<Event> edge(double px_s, double duration_s) {
  std::mt19937_64 random(9);
  std::vector<Event> events;
  for (int x = 0; x < 127 && x / px_s < duration_s; ++x)
    for (int y = 20; y < 108; ++y)
      for (int i = 0; i < 3; ++i)
        events.push_back({static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1,
                          static_cast<Timestamp>((x + static_cast<double>(random() % 1000) * 1e-3) / px_s * 1e6)});
  std::ranges::sort(events, {}, &Event::t);
  return events;
}

}  // namespace

TEST_CASE("the rate of noise is measured, and one noise event in thirteen passes") {
  for (const double hz : {0.5, 1.0, 5.0, 15.0}) {
    CAPTURE(hz);
    SpatiotemporalFilter filter(kSize);
    share(filter, noise(hz, 3));
    CHECK(rate_of(filter) == doctest::Approx(hz).epsilon(0.1).scale(0));
    CHECK(share(filter, noise(hz, 3, kSize, 3000000)) == doctest::Approx(1.0 / 13).epsilon(0.1).scale(0));
  }
}

TEST_CASE("strong noise is noticed within milliseconds") {
  SpatiotemporalFilter filter({640, 480});
  CHECK(filter.window().count() == 10000);
  share(filter, noise(20, 0.002, {640, 480}));
  CHECK(rate_of(filter) > 8);
  share(filter, noise(20, 0.02, {640, 480}, 2000));
  CHECK(rate_of(filter) > 16);
}

TEST_CASE("the window has ends, the rate that is reported has none") {
  SpatiotemporalFilter quiet(kSize), loud(kSize);
  share(quiet, noise(0.05, 10));
  CHECK(quiet.window().count() == 50000);
  CHECK(quiet.background_hz_per_px() < 0.12);  // what was assumed at first still counts after so few events
  share(loud, noise(100, 0.5));
  CHECK(loud.window().count() == 500);
  CHECK(loud.background_hz_per_px() == doctest::Approx(100).epsilon(0.03).scale(0));
}

TEST_CASE("edges, slow or fast, are no noise") {
  for (const double px_s : {30.0, 100.0, 1000.0}) {
    CAPTURE(px_s);
    SpatiotemporalFilter filter(kSize);
    const double duration_s = 120 / px_s;
    const auto events = edge(px_s, duration_s);
    REQUIRE(events.size() > 30000);
    CHECK(share(filter, events) > 0.95);
    CHECK(rate_of(filter) < 1.2);
    SpatiotemporalFilter paper(kSize, kPaperWindow);
    if (px_s < 50) CHECK(share(paper, events) < 0.9);
  }
}

TEST_CASE("noise is measured beside edges") {
  for (const double hz : {1.0, 5.0}) {
    CAPTURE(hz);
    SpatiotemporalFilter filter(kSize);
    share(filter, merged(edge(60, 2), noise(hz, 2)));
    CHECK(rate_of(filter) > 0.75 * hz);
    CHECK(rate_of(filter) < 1.3 * hz);
  }
}

TEST_CASE("hot pixels are no background activity") {
  std::vector<Event> hot;
  for (Timestamp t = 0; t < 3000000; t += 1000)
    for (int i = 0; i < 20; ++i)
      hot.push_back({static_cast<std::uint16_t>(6 * i + 3), static_cast<std::uint16_t>(37 * i % 128), 1, t});
  SpatiotemporalFilter filter(kSize);
  share(filter, merged(hot, noise(1, 3)));  // 1.2 Hz/px more
  CHECK(rate_of(filter) == doctest::Approx(1).epsilon(0.15).scale(0));
}

TEST_CASE("a clock that jumps or steps back does not change the rate") {
  SpatiotemporalFilter filter(kSize);
  auto events = noise(2, 4);
  for (std::size_t i = 0; i < events.size(); ++i) {
    if (i > events.size() / 4) events[i].t -= 900000;
    if (i > events.size() / 2) events[i].t += Timestamp{1} << 40;
  }
  share(filter, events);
  CHECK(rate_of(filter) > 1.3);
  CHECK(rate_of(filter) < 2.2);
}

TEST_CASE("packets that come in another order do not change the rate") {
  std::vector<Event> events = noise(5, 3);
  constexpr std::ptrdiff_t kPacket = 32;  // 0.4 ms
  for (auto at = events.begin(); events.end() - at >= 2 * kPacket; at += 2 * kPacket)
    std::rotate(at, at + kPacket, at + 2 * kPacket);
  SpatiotemporalFilter filter(kSize);
  share(filter, events);
  CHECK(rate_of(filter) == doctest::Approx(5).epsilon(0.1).scale(0));
}

TEST_CASE("noise is measured beside edges that come back after 30 ms, however long it goes on") {
  std::mt19937_64 random(3);
  constexpr double kNoise = 0.26;  // [Hz/px]: half of 32 events in 0.2 ms on a sensor of 640 x 480
  std::exponential_distribution<double> age_of_noise(9 * kNoise * 1e-6);
  std::uniform_real_distribution<double> age_of_edge(0, 30e3);
  BackgroundActivity activity(640 * 480);
  double sum = 0;
  int n = 0;
  for (Timestamp t = 0; t < 20'000'000;) {
    const bool edge = random() % 2 == 0;
    const double age_us = edge ? age_of_edge(random) : age_of_noise(random);
    const std::uint64_t events = activity.add(static_cast<std::uint64_t>(age_us), t);
    t += static_cast<Timestamp>(events * 200 / 32);
    if (t < 2'000'000) continue;
    sum += activity.hz_per_px();
    ++n;
  }
  CHECK(sum / n == doctest::Approx(kNoise).epsilon(0.05).scale(0));  // the first guess still adds 3 %
}
