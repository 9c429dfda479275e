#include "evmarker/events/camera_time.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <limits>
#include <vector>

using evmarker::CameraTime;
using evmarker::Timestamp;

namespace {

std::uint64_t passed_us(const std::vector<Timestamp>& times) {
  CameraTime time;
  std::uint64_t sum = 0;
  for (const Timestamp t : times) sum += time.advance(t);
  return sum;
}

}  // namespace

TEST_CASE("camera time is that from the first event to the last, whatever its sign") {
  CHECK(passed_us({}) == 0);
  CHECK(passed_us({-500}) == 0);
  CHECK(passed_us({-500, 200, 200, 1000}) == 1500);
  constexpr Timestamp kLeast = std::numeric_limits<Timestamp>::min(), kMost = std::numeric_limits<Timestamp>::max();
  CHECK(passed_us({kLeast, kMost}) == std::numeric_limits<std::uint64_t>::max());
}

TEST_CASE("events in disorder add nothing, and a clock that was set back goes on from there") {
  CHECK(passed_us({0, 700, 400, 1100, 800, 1500}) == 1500);
  CHECK(passed_us({3'600'000'000, 3'600'000'100, 0, 50}) == 150);
}
