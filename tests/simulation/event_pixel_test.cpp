#include "evmarker/simulation/event_pixel.hpp"

#include <doctest/doctest.h>

#include <functional>
#include <limits>
#include <utility>
#include <vector>

using evmarker::EventPixel;
using evmarker::EventPixelDynamics;

namespace {

struct Fired {
  std::vector<std::pair<double, bool>> events;
  double operator()(double t, bool on) {
    events.emplace_back(t, on);
    return t;
  }
};

}  // namespace

TEST_CASE("a straight rise fires at every threshold, at the time it is reached") {
  EventPixel pixel(0, 0.25, 0.25);
  Fired fired;
  pixel.advance(0, 1000, 1.1, {0, 0}, std::ref(fired));  // 1.1 in 1000 us
  REQUIRE(fired.events.size() == 4);
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(fired.events[i].first == doctest::Approx(0.25 / 1.1 * 1000 * static_cast<double>(i + 1)));
    CHECK(fired.events[i].second);
  }
}

TEST_CASE("ON and OFF have thresholds of their own, and small changes are remembered") {
  EventPixel pixel(0, 0.5, 0.2);
  Fired fired;
  pixel.advance(0, 100, -0.15, {0, 0}, std::ref(fired));
  pixel.advance(100, 200, 0.45, {0, 0}, std::ref(fired));
  CHECK(fired.events.empty());
  pixel.advance(200, 300, 0.55, {0, 0}, std::ref(fired));
  REQUIRE(fired.events.size() == 1);
  CHECK(fired.events[0].second);
  CHECK(fired.events[0].first == doctest::Approx(250));
  pixel.advance(300, 400, 0.25, {0, 0}, std::ref(fired));
  REQUIRE(fired.events.size() == 2);
  CHECK_FALSE(fired.events[1].second);
  CHECK(fired.events[1].first == doctest::Approx(300 + 100 * 0.25 / 0.30));
}

TEST_CASE("what happens in the dead time is lost: the level at its end is memorised") {
  EventPixel pixel(0, 0.25, 0.25);
  Fired fired;
  pixel.advance(0, 1000, 1.0, {0, 300}, std::ref(fired));  // fires at 250, dead to 550, at 0.55 there: next at 800
  REQUIRE(fired.events.size() == 2);
  CHECK(fired.events[0].first == doctest::Approx(250));
  CHECK(fired.events[1].first == doctest::Approx(800));
  pixel.advance(1000, 2000, 1.0, {0, 300}, std::ref(fired));  // dead to 1100, memorises 1.0
  pixel.advance(2000, 3000, 1.24, {0, 300}, std::ref(fired));
  CHECK(fired.events.size() == 2);
}

TEST_CASE("an event that waits for its turn keeps the pixel dead for longer") {
  EventPixel pixel(0, 0.25, 0.25);
  std::vector<double> times;
  pixel.advance(0, 1000, 1.0, {0, 100}, [&](double t, bool) {
    times.push_back(t);
    return t + 200;
  });
  REQUIRE(times.size() == 2);  // at 250, dead to 550, at 0.55 there
  CHECK(times[1] == doctest::Approx(800));
}

TEST_CASE("a step of light comes through the low-pass as 1 - exp(-t / tau)") {
  const double tau = 300;
  EventPixel pixel(0, 0.5, 0.5);
  Fired fired;
  const EventPixelDynamics dynamics{tau, 0};
  pixel.advance(0, 1e-6, 1.0, dynamics, std::ref(fired));  // as good as a step
  CHECK(fired.events.empty());
  pixel.advance(1e-6, 1000, 1.0, dynamics, std::ref(fired));
  REQUIRE(fired.events.size() == 1);
  CHECK(fired.events[0].first == doctest::Approx(tau * std::log(2)).epsilon(1e-4));
  CHECK(pixel.level() == doctest::Approx(1 - std::exp(-1000 / tau)));
  CHECK_FALSE(pixel.settle());
  pixel.advance(1000, 5000, 1.0, dynamics, std::ref(fired));
  CHECK(pixel.settle());
  CHECK(pixel.level() == pixel.log_intensity());
}

TEST_CASE("the low-pass is exact for straight lines, however the time is cut") {
  const EventPixelDynamics dynamics{200, 0};
  EventPixel whole(0, 10, 10), cut(0, 10, 10);
  Fired fired;
  whole.advance(0, 1000, 2.0, dynamics, std::ref(fired));
  for (int i = 0; i < 100; ++i) cut.advance(i * 10, i * 10 + 10, 0.02 * (i + 1), dynamics, std::ref(fired));
  CHECK(whole.level() == doctest::Approx(2.0 - 0.4 * (1 - std::exp(-5.0))).epsilon(1e-6));
  CHECK(cut.level() == doctest::Approx(whole.level()).epsilon(1e-5));
}

TEST_CASE("noise fires a living pixel, not a dead one, and resets it") {
  EventPixel pixel(0, 0.25, 0.25);
  Fired fired;
  const EventPixelDynamics dynamics{0, 100};
  pixel.advance(0, 1000, 0.2, dynamics, std::ref(fired));
  pixel.fire(1000, false, dynamics, std::ref(fired));
  REQUIRE(fired.events.size() == 1);
  CHECK_FALSE(fired.events[0].second);
  pixel.advance(1000, 1050, 0.2, dynamics, std::ref(fired));
  pixel.fire(1050, true, dynamics, std::ref(fired));
  CHECK(fired.events.size() == 1);
  pixel.advance(1050, 2000, 0.4, dynamics, std::ref(fired));  // memorised 0.21: not 0.25 away
  CHECK(fired.events.size() == 1);
  pixel.advance(2000, 3000, 0.5, dynamics, std::ref(fired));
  CHECK(fired.events.size() == 2);
}

TEST_CASE("an event never comes before the step that makes it, whatever rounding does at a threshold") {
  EventPixel pixel(1, 0.1, 0.1);
  Fired fired;
  pixel.advance(0, 1000, 1.1000000014, {0, 0}, std::ref(fired));  // just below 1 + 0.1f, but not in single precision
  REQUIRE(fired.events.empty());
  pixel.advance(1000, 2000, 1.1000002, {0, 0}, std::ref(fired));
  REQUIRE(fired.events.size() == 1);
  CHECK(fired.events[0].first >= 1000);
  CHECK(fired.events[0].first < 1010);
}

TEST_CASE("a threshold that is reached exactly at the end of a step fires there") {
  EventPixel pixel(0, 0.25, 0.25);
  Fired fired;
  pixel.advance(0, 1000, 0.25, {0, 0}, std::ref(fired));
  REQUIRE(fired.events.size() == 1);
  CHECK(fired.events[0].first == 1000);
}

TEST_CASE("what is memorised leaks away: ON events at rest, one each threshold over leak, and dead time in between") {
  EventPixel pixel(0, 0.25, 0.25, 1e-4);
  Fired fired;
  pixel.advance(0, 10000, 0, {0, 500}, std::ref(fired));  // 2500 us of leak and 500 us of dead time
  REQUIRE(fired.events.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(fired.events[i].first == doctest::Approx(2500 + 3000.0 * static_cast<double>(i)));
    CHECK(fired.events[i].second);
  }
  CHECK(pixel.leak_event_us() == doctest::Approx(11500));
}

TEST_CASE("a leak is the same however the time is cut, and asleep over whole stretches of it") {
  EventPixel cut(0, 0.25, 0.25, 1e-6), asleep(0, 0.25, 0.25, 1e-6);
  Fired often, once;
  for (int i = 0; i < 60000; ++i) cut.advance(i * 10, i * 10 + 10, 0, {0, 50}, std::ref(often));
  asleep.advance(0, 10, 0, {0, 50}, std::ref(once));
  CHECK(asleep.leak_event_us() == doctest::Approx(250000));
  asleep.advance(249000, 251000, 0, {0, 50}, std::ref(once));
  CHECK(asleep.leak_event_us() == doctest::Approx(500050));
  asleep.advance(499000, 600000, 0, {0, 50}, std::ref(once));
  REQUIRE(often.events.size() == 2);
  REQUIRE(once.events.size() == 2);
  for (std::size_t i = 0; i < 2; ++i)
    CHECK(often.events[i].first == doctest::Approx(once.events[i].first).epsilon(1e-6));
}

TEST_CASE("a leak brings ON events nearer and puts OFF events off") {
  const double leak = 2e-4, ramp = 5e-4;  // [1/us]
  EventPixel up(0, 0.25, 0.25, leak), down(0, 0.25, 0.25, leak);
  Fired on, off;
  up.advance(0, 1000, ramp * 1000, {0, 0}, std::ref(on));
  down.advance(0, 1000, -ramp * 1000, {0, 0}, std::ref(off));
  REQUIRE(on.events.size() == 2);
  CHECK(on.events[0].first == doctest::Approx(0.25 / (ramp + leak)));
  CHECK(on.events[1].first == doctest::Approx(2 * 0.25 / (ramp + leak)));
  REQUIRE(off.events.size() == 1);
  CHECK(off.events[0].first == doctest::Approx(0.25 / (ramp - leak)));
  CHECK_FALSE(off.events[0].second);
}

TEST_CASE("a pixel may start with some of its leak behind it, and one without a leak is never due") {
  EventPixel pixel(1, 0.25, 0.25, 1e-4, 0.2);
  CHECK(pixel.leak_event_us() == doctest::Approx(500));
  CHECK(EventPixel(1, 0.25, 0.25).leak_event_us() == std::numeric_limits<double>::infinity());
}
