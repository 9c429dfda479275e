#include "evmarker/simulation/event_queue.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

namespace {

Event at(int x, int y, Timestamp t) { return {static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y), 1, t}; }

}  // namespace

TEST_CASE("events leave in order of exact time, those of one instant by row and column, and not before their time") {
  EventQueue queue;
  queue.push(30.5, at(1, 1, 30));
  queue.push(10.7, at(2, 1, 10));
  queue.push(10.2, at(3, 1, 10));
  queue.push(20, at(5, 4, 20));
  queue.push(20, at(4, 4, 20));
  queue.push(20, at(9, 3, 20));
  std::vector<Event> out;
  queue.release(30, out);
  CHECK(out == std::vector<Event>{at(3, 1, 10), at(2, 1, 10), at(9, 3, 20), at(4, 4, 20), at(5, 4, 20)});
  out.clear();
  queue.release(30.5, out);
  CHECK(out.empty());
  queue.release(31, out);
  CHECK(out == std::vector<Event>{at(1, 1, 30)});
}
