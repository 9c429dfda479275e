#include "evmarker/search/distinct_best.hpp"

#include <doctest/doctest.h>

#include <cstdlib>
#include <random>

using namespace evmarker;

TEST_CASE("of nodes beside each other the best is kept, and the best come first") {
  DistinctBest best;
  best.restart(1);
  best.add({{0, 0, 0, 0}, 10});
  best.add({{1, 0, 0, 1}, 12});
  REQUIRE(best.size() == 1);
  CHECK(best[0].score == 12);
  best.add({{0, 1, 0, 0}, 11});
  CHECK(best.size() == 1);
  best.add({{5, 0, 0, 0}, 20});
  best.add({{1, 0, 2, 1}, 3});
  REQUIRE(best.size() == 3);
  CHECK(best[0].score == 20);
  CHECK(best[2].score == 3);
  best.restart(1);
  CHECK(best.size() == 0);
}

TEST_CASE("many nodes leave the best, sorted, and the best of all is always among them") {
  std::mt19937 random(2);
  for (int run = 0; run < 50; ++run) {
    DistinctBest best;
    best.restart(2);
    int highest = -1;
    for (int i = 0; i < 3000; ++i) {
      const auto step = [&] { return static_cast<int>(random() % 21); };
      const DistinctBest::Node node{{step(), step(), step(), step()}, static_cast<int>(random() % 100000)};
      highest = std::max(highest, node.score);
      best.add(node);
    }
    REQUIRE(best.size() == DistinctBest::kMost);
    CHECK(best[0].score == highest);
    for (std::size_t i = 1; i < best.size(); ++i) CHECK(best[i].score <= best[i - 1].score);
  }
}
