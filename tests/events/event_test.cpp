#include "evmarker/events/event.hpp"

#include <doctest/doctest.h>

#include <cstddef>
#include <limits>
#include <type_traits>

using evmarker::Event;
using evmarker::EventLike;
using evmarker::EventTraits;
using evmarker::to_event;

namespace {

struct EventCD {  // as OpenEB declares it
  unsigned short x, y;
  short p;
  long long t;
};

class AccessorEvent {  // as dv-processing declares it
 public:
  AccessorEvent(std::int64_t timestamp, std::int16_t x, std::int16_t y, bool polarity)
      : timestamp_(timestamp), x_(x), y_(y), polarity_(polarity) {}
  [[nodiscard]] std::int64_t timestamp() const noexcept { return timestamp_; }
  [[nodiscard]] std::int16_t x() const noexcept { return x_; }
  [[nodiscard]] std::int16_t y() const noexcept { return y_; }
  [[nodiscard]] bool polarity() const noexcept { return polarity_; }

 private:
  std::int64_t timestamp_;
  std::int16_t x_, y_;
  bool polarity_;
};

struct PlusMinusEvent {
  int x, y;
  signed char p;  // -1 or +1
  std::uint32_t t;
};

struct PackedEvent {
  std::uint64_t t : 34;
  std::uint64_t x : 14;
  std::uint64_t y : 14;
  std::uint64_t p : 1;
};

struct ForeignEvent {
  int column, row;
  bool brighter;
  double seconds;
};

struct WithoutPolarity {
  int x, y;
  long long t;
};
struct WithoutTime {
  int x, y, p;
};
struct TextTime {
  int x, y, p;
  const char* t;
};
struct SecondsTime {
  int x, y, p;
  double t;
};
struct AccessorsWithoutPolarity {
  int x() const;
  int y() const;
  std::int64_t timestamp() const;
};
struct MutableAccessors {
  int x();
  int y();
  bool polarity();
  std::int64_t timestamp();
};

}  // namespace

template <>
struct evmarker::EventTraits<ForeignEvent> {
  static int x(const ForeignEvent& e) { return e.column; }
  static int y(const ForeignEvent& e) { return e.row; }
  static bool on(const ForeignEvent& e) { return e.brighter; }
  static Timestamp t(const ForeignEvent& e) { return static_cast<Timestamp>(e.seconds * 1e6); }
};

static_assert(EventLike<Event>);
static_assert(EventLike<EventCD>);
static_assert(EventLike<AccessorEvent>);
static_assert(EventLike<PlusMinusEvent>);
static_assert(EventLike<PackedEvent>);
static_assert(EventLike<ForeignEvent>);
static_assert(!EventLike<int>);
static_assert(!EventLike<WithoutPolarity>);
static_assert(!EventLike<WithoutTime>);
static_assert(!EventLike<TextTime>);
static_assert(!EventLike<SecondsTime>, "seconds would silently become whole microseconds");
static_assert(!EventLike<AccessorsWithoutPolarity>);
static_assert(!EventLike<MutableAccessors>);

static_assert(std::is_trivially_copyable_v<Event>);
static_assert(sizeof(Event) == sizeof(EventCD));
static_assert(offsetof(Event, x) == offsetof(EventCD, x));
static_assert(offsetof(Event, y) == offsetof(EventCD, y));
static_assert(offsetof(Event, p) == offsetof(EventCD, p));
static_assert(offsetof(Event, t) == offsetof(EventCD, t));

TEST_CASE("events of other libraries are read as they are") {
  CHECK(to_event(EventCD{3, 4, 1, 5'000'000'000}) == Event{3, 4, 1, 5'000'000'000});
  CHECK(to_event(EventCD{3, 4, 0, -7}) == Event{3, 4, 0, -7});
  CHECK(to_event(AccessorEvent{12, 639, 479, true}) == Event{639, 479, 1, 12});
  CHECK(to_event(AccessorEvent{12, 639, 479, false}) == Event{639, 479, 0, 12});
  CHECK(to_event(PackedEvent{1234567890, 1279, 719, 1}) == Event{1279, 719, 1, 1234567890});
  CHECK(to_event(ForeignEvent{1, 2, true, 0.25}) == Event{1, 2, 1, 250000});
  CHECK(to_event(Event{1, 2, -1, 3}) == Event{1, 2, -1, 3});
}

TEST_CASE("both ways to write polarity mean the same") {
  CHECK(EventTraits<PlusMinusEvent>::on({0, 0, 1, 0}));
  CHECK_FALSE(EventTraits<PlusMinusEvent>::on({0, 0, -1, 0}));
  CHECK_FALSE(EventTraits<EventCD>::on({0, 0, 0, 0}));
  CHECK(to_event(PlusMinusEvent{0, 0, 1, 9}) == Event{0, 0, 1, 9});
  CHECK(to_event(PlusMinusEvent{0, 0, -1, 9}) == Event{0, 0, 0, 9});
}

TEST_CASE("a coordinate that 16 bits cannot hold stays off the sensor") {
  CHECK(to_event(PlusMinusEvent{-1, 65536, 1, 0}) == Event{65535, 65535, 1, 0});
  CHECK(to_event(PlusMinusEvent{std::numeric_limits<int>::min(), std::numeric_limits<int>::max(), 1, 0}) ==
        Event{65535, 65535, 1, 0});
  CHECK(to_event(PlusMinusEvent{65534, 0, 1, 0}) == Event{65534, 0, 1, 0});
}

TEST_CASE("a sensor contains its pixels and nothing else") {
  constexpr evmarker::SensorSize kSize{3, 2};
  int inside = 0;
  for (int y = -2; y < 5; ++y)
    for (int x = -2; x < 6; ++x) inside += kSize.contains(x, y);
  CHECK(inside == 6);
  static_assert(kSize.contains(0, 0) && kSize.contains(2, 1));
  static_assert(!kSize.contains(3, 0) && !kSize.contains(0, 2) && !kSize.contains(-1, 0) && !kSize.contains(0, -1));
  static_assert(!evmarker::SensorSize{}.contains(0, 0));
}
