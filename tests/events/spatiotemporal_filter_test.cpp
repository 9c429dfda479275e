#include "evmarker/events/spatiotemporal_filter.hpp"

#include <doctest/doctest.h>

#include <cstdlib>
#include <map>
#include <random>
#include <string>
#include <utility>

using evmarker::Event;
using evmarker::kPaperWindow;
using evmarker::SensorSize;
using evmarker::SpatiotemporalFilter;
using evmarker::Timestamp;
using namespace std::chrono_literals;

namespace {

Event event_at(int x, int y, Timestamp t, int p = 1) {
  return {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), static_cast<std::int16_t>(p), t};
}

// The filter by its definition, with whole times.
class ReferenceFilter {
 public:
  ReferenceFilter(SensorSize size, Timestamp window) : size_(size), window_(window) {}
  bool accept(const Event& event) {
    bool supported = false;
    for (int y = event.y - 1; y <= event.y + 1; ++y)
      for (int x = event.x - 1; x <= event.x + 1; ++x) {
        if ((x == event.x && y == event.y) || !size_.contains(x, y)) continue;
        const auto last = last_.find({x, y});
        supported = supported || (last != last_.end() && std::abs(event.t - last->second) <= window_);
      }
    last_[{event.x, event.y}] = event.t;
    return supported;
  }

 private:
  SensorSize size_;
  Timestamp window_;
  std::map<std::pair<int, int>, Timestamp> last_;
};

// Feeds `count` random events whose times advance by `step()`, and tells how many were let through.
template <typename Step>
int accepted_like_the_reference(SensorSize size, std::chrono::microseconds window, Timestamp start, int count,
                                Step step) {
  SpatiotemporalFilter filter(size, window);
  ReferenceFilter reference(size, window.count());
  std::mt19937 random(5);
  Timestamp t = start;
  int accepted = 0;
  for (int i = 0; i < count; ++i) {
    t += step(random);
    const Event event = event_at(static_cast<int>(random() % static_cast<unsigned>(size.width)),
                                 static_cast<int>(random() % static_cast<unsigned>(size.height)), t,
                                 static_cast<int>(random() % 3) - 1);
    const bool expected = reference.accept(event);
    CAPTURE(i);
    CAPTURE(t);
    REQUIRE(filter.accept(event) == expected);
    accepted += expected;
  }
  return accepted;
}

constexpr Timestamp kWrap = Timestamp{1} << 32;  // 71.58 minutes

}  // namespace

static_assert(evmarker::EventFilter<SpatiotemporalFilter>);

TEST_CASE("the first event has no support, whenever it comes") {
  for (const Timestamp t :
       {Timestamp{0}, Timestamp{1}, Timestamp{1999}, Timestamp{-5}, kWrap / 2, kWrap - 1, kWrap, kWrap + 5,
        1000 * kWrap, std::numeric_limits<Timestamp>::max(), std::numeric_limits<Timestamp>::min()}) {
    CAPTURE(t);
    SpatiotemporalFilter filter({4, 4}, kPaperWindow);
    CHECK_FALSE(filter.accept(event_at(1, 1, t)));
  }
}

TEST_CASE("each of the 8 neighbours supports, in every corner, on every border and inside, and nobody else does") {
  constexpr SensorSize kSize{5, 4};
  int supported = 0;
  for (int y = 0; y < kSize.height; ++y)
    for (int x = 0; x < kSize.width; ++x)
      for (int other_y = 0; other_y < kSize.height; ++other_y)
        for (int other_x = 0; other_x < kSize.width; ++other_x) {
          SpatiotemporalFilter filter(kSize, kPaperWindow);
          REQUIRE_FALSE(filter.accept(event_at(other_x, other_y, 1000)));
          const bool neighbour = std::max(std::abs(x - other_x), std::abs(y - other_y)) == 1;
          CAPTURE(x);
          CAPTURE(y);
          CAPTURE(other_x);
          CAPTURE(other_y);
          CHECK(filter.accept(event_at(x, y, 1001)) == neighbour);
          supported += neighbour;
        }
  CHECK(supported == 2 * (4 * 4 + 3 * 5 + 2 * 3 * 4));  // pairs of a 5 x 4 grid: right, down, two diagonals
}

TEST_CASE("a sensor of one pixel, one row or one column works") {
  SpatiotemporalFilter one({1, 1}, kPaperWindow), row({3, 1}, kPaperWindow), column({1, 3}, kPaperWindow);
  for (Timestamp t = 0; t < 10; ++t) CHECK_FALSE(one.accept(event_at(0, 0, t)));
  CHECK_FALSE(row.accept(event_at(2, 0, 0)));
  CHECK(row.accept(event_at(1, 0, 1)));
  CHECK_FALSE(column.accept(event_at(0, 0, 0)));
  CHECK_FALSE(column.accept(event_at(0, 2, 1)));
  CHECK(column.accept(event_at(0, 1, 2)));
}

TEST_CASE("a hot pixel does not support itself") {
  SpatiotemporalFilter filter({8, 8}, kPaperWindow);
  for (Timestamp t = 0; t < 10000; t += 10) CHECK_FALSE(filter.accept(event_at(3, 3, t)));
}

TEST_CASE("support ends exactly with the window") {
  for (const Timestamp window : {1, 2, 2000, 5000, 60'000'000}) {
    CAPTURE(window);
    for (const Timestamp t : {Timestamp{0}, Timestamp{123456}, kWrap - window}) {
      const std::chrono::microseconds us(window);
      SpatiotemporalFilter at_end({4, 4}, us), after_end({4, 4}, us);
      at_end.accept(event_at(1, 1, t));
      CHECK(at_end.accept(event_at(2, 2, t + window)));
      after_end.accept(event_at(1, 1, t));
      CHECK_FALSE(after_end.accept(event_at(2, 2, t + window + 1)));
    }
  }
}

TEST_CASE("the paper's window is 2000 us") {
  SpatiotemporalFilter filter({4, 4}, kPaperWindow);
  filter.accept(event_at(0, 0, 0));
  CHECK(filter.accept(event_at(1, 0, 2000)));
  CHECK_FALSE(filter.accept(event_at(2, 0, 4001)));
}

TEST_CASE("either polarity supports either") {
  for (const int first : {-1, 0, 1})
    for (const int second : {-1, 0, 1}) {
      SpatiotemporalFilter filter({4, 4}, kPaperWindow);
      filter.accept(event_at(0, 0, 10, first));
      CHECK(filter.accept(event_at(1, 0, 20, second)));
    }
}

TEST_CASE("a rejected event supports the next one") {
  SpatiotemporalFilter filter({4, 4}, kPaperWindow);
  CHECK_FALSE(filter.accept(event_at(0, 0, 0)));
  CHECK_FALSE(filter.accept(event_at(2, 0, 1)));
  CHECK(filter.accept(event_at(3, 0, 2)));
}

TEST_CASE("times that step back a little are supported, far back not") {
  SpatiotemporalFilter little({4, 4}, kPaperWindow), far({4, 4}, kPaperWindow), hours({4, 4}, kPaperWindow);
  little.accept(event_at(0, 0, 10000));
  CHECK(little.accept(event_at(1, 0, 8000)));
  CHECK_FALSE(little.accept(event_at(0, 1, 5999)));
  far.accept(event_at(0, 0, 10000));
  CHECK_FALSE(far.accept(event_at(1, 0, 7999)));
  hours.accept(event_at(0, 0, 5 * kWrap));
  CHECK_FALSE(hours.accept(event_at(1, 0, 3 * kWrap)));
  CHECK(hours.accept(event_at(0, 1, 3 * kWrap + 1)));
}

TEST_CASE("the times come round after 71.58 minutes without anyone noticing") {
  for (const Timestamp wrap : {kWrap, 2 * kWrap, 7 * kWrap, kWrap / 2}) {
    SpatiotemporalFilter across({4, 4}, kPaperWindow), stale({4, 4}, kPaperWindow);
    across.accept(event_at(0, 0, wrap - 10));
    CHECK(across.accept(event_at(1, 0, wrap + 10)));
    CHECK_FALSE(across.accept(event_at(2, 0, wrap + 2500)));
    stale.accept(event_at(0, 0, 100));
    CHECK_FALSE(stale.accept(event_at(1, 0, wrap + 100)));
    CHECK_FALSE(stale.accept(event_at(3, 3, wrap + 200)));  // never touched near it
  }
}

TEST_CASE("no pause, however long, makes an event recent") {
  std::vector<std::chrono::microseconds> windows{2000us, 1s, 8min};
  for (const auto window : windows)
    for (Timestamp pause = Timestamp{1} << 26; pause < 3 * kWrap; pause += (Timestamp{1} << 25) - 1) {
      if (pause <= window.count()) continue;
      CAPTURE(window.count());
      CAPTURE(pause);
      for (const Timestamp off : {Timestamp{0}, -window.count(), window.count()}) {
        SpatiotemporalFilter filter({4, 4}, window);
        filter.accept(event_at(0, 0, 50));
        const Timestamp t = 50 + std::max(pause + off, window.count() + 1);
        CHECK_FALSE(filter.accept(event_at(1, 0, t)));
        CHECK_FALSE(filter.accept(event_at(3, 3, t)));
      }
    }
  for (const Timestamp power : {29, 30, 31, 32, 33})  // the places where 32 bits could mistake it
    for (Timestamp off = -3000; off <= 3000; off += 100) {
      SpatiotemporalFilter filter({4, 4}, kPaperWindow);
      filter.accept(event_at(0, 0, 50));
      CAPTURE(power);
      CAPTURE(off);
      CHECK_FALSE(filter.accept(event_at(1, 0, 50 + (Timestamp{1} << power) + off)));
      CHECK_FALSE(filter.accept(event_at(3, 3, 50 + (Timestamp{1} << power) + off)));
    }
}

TEST_CASE("a jump of more than 18 min forgets the events before it, also where the time comes back") {
  for (const Timestamp jump : {Timestamp{1200000000}, Timestamp{-1200000000}}) {
    SpatiotemporalFilter filter({4, 4}, kPaperWindow);
    filter.accept(event_at(0, 0, 5 * kWrap));
    CHECK(filter.accept(event_at(1, 0, 5 * kWrap + 1)));
    CHECK_FALSE(filter.accept(event_at(3, 3, 5 * kWrap + jump)));
    CHECK_FALSE(filter.accept(event_at(0, 1, 5 * kWrap + 2)));
    CHECK(filter.accept(event_at(1, 1, 5 * kWrap + 3)));
  }
}

TEST_CASE("random events are let through exactly as the definition says") {
  const auto few_ms = [](auto& random) { return static_cast<Timestamp>(random() % 200); };
  const int dense = accepted_like_the_reference({12, 9}, 2000us, 0, 50000, few_ms);
  CHECK(dense > 10000);
  CHECK(dense < 40000);
  SUBCASE("with steps back") {
    CHECK(accepted_like_the_reference({12, 9}, 2000us, 1'000'000, 50000, [](auto& random) {
            return random() % 50 == 0 ? -static_cast<Timestamp>(random() % 10000)
                                      : static_cast<Timestamp>(random() % 400);
          }) > 3000);
  }
  SUBCASE("over the end of 32 bits") {
    CHECK(accepted_like_the_reference({12, 9}, 2000us, kWrap - 2'000'000, 50000, few_ms) == dense);
  }
  SUBCASE("with pauses of up to hours") {
    CHECK(accepted_like_the_reference({12, 9}, 2000us, -kWrap, 50000, [](auto& random) {
            return random() % 100 == 0 ? static_cast<Timestamp>(random()) * 2 : static_cast<Timestamp>(random() % 200);
          }) > 10000);
  }
  SUBCASE("with jumps back of 18 min and more") {
    CHECK(accepted_like_the_reference({12, 9}, 2000us, 40 * kWrap, 50000, [](auto& random) {
            return random() % 500 == 0 ? -(Timestamp{1} << 30) - static_cast<Timestamp>(random())
                                       : static_cast<Timestamp>(random() % 200);
          }) > 10000);
  }
  SUBCASE("slowly, with a window of minutes") {
    for (const auto window : {1min, 5min, 8min})
      CHECK(accepted_like_the_reference({40, 30}, window, 0, 50000, [](auto& random) {
              return random() % 400 == 0 ? static_cast<Timestamp>(random())
                                         : static_cast<Timestamp>(random() % 5'000'000);
            }) > 3000);
  }
}

TEST_CASE("an impossible size or window is refused with its value") {
  const auto message_of = [](SensorSize size, std::chrono::microseconds window) -> std::string {
    try {
      const SpatiotemporalFilter filter(size, window);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  CHECK(message_of({4, 4}, 1us) == "accepted");
  CHECK(message_of({4, 4}, 8min) == "accepted");
  CHECK(message_of({0, 4}, 2ms) == "filter: sensor size is 0 x 4");
  CHECK(message_of({4, -4}, 2ms) == "filter: sensor size is 4 x -4");
  CHECK(message_of({4, 4}, evmarker::kAutomaticWindow) == "accepted");
  CHECK(message_of({4, 4}, -3us) == "filter: window is -3 us, not in [0, 8 min]");
  CHECK(message_of({4, 4}, 8min + 1us) == "filter: window is 480000001 us, not in [0, 8 min]");
  CHECK(message_of({4, 4}, 100h) == "filter: window is 360000000000 us, not in [0, 8 min]");
}
