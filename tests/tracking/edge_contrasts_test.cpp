#include "evmarker/tracking/edge_contrasts.hpp"

#include <doctest/doctest.h>

#include <vector>

using namespace evmarker;

namespace {

// Four edges of 20 px that move by a pixel in every interval; the last two into the dark, where there are more events.
std::vector<float> after(int intervals, const std::vector<double>& events_per_px2, double hidden_last = 0) {
  EdgeContrasts edges(4);
  for (int i = 0; i < intervals; ++i) {
    for (std::size_t edge = 0; edge < 4; ++edge) {
      const bool hidden = edge == 0 && i >= intervals - hidden_last;
      edges.add(edge, hidden ? 0 : 20 * events_per_px2[edge] * (edge >= 2 ? 1.5 : 1), 20, 20, edge >= 2);
    }
    edges.evaluate();
  }
  return {edges.contrasts().begin(), edges.contrasts().end()};
}

}  // namespace

TEST_CASE("edges of equal contrast have contrast 1, although ON and OFF events differ in number") {
  for (const float contrast : after(200, {4, 4, 4, 4})) CHECK(contrast == doctest::Approx(1).epsilon(1e-6));
}

TEST_CASE(
    "an edge's contrast is its share of the events of edges that move the same way, drawn to 1 by what is not known") {
  const auto contrasts = after(400, {6, 2, 4, 4});
  CHECK(contrasts[0] > 1.35);
  CHECK(contrasts[0] < 1.5);
  CHECK(contrasts[1] > 0.5);
  CHECK(contrasts[1] < 0.65);
  CHECK(contrasts[2] == doctest::Approx(1).epsilon(0.02));
  // A difference that is small beside what is not known is none.
  CHECK(after(400, {4.2, 3.8, 4, 4})[0] == doctest::Approx(1).epsilon(0.01));
}

TEST_CASE("before an edge has moved far enough, its contrast is not known") {
  CHECK(after(10, {6, 2, 4, 4})[0] < 1.1);
  CHECK(after(0, {6, 2, 4, 4})[0] == 1);
}

TEST_CASE("an edge that is hidden for a while keeps its contrast") {
  const float before = after(350, {6, 2, 4, 4})[0];
  REQUIRE(before > 1.3);
  CHECK(after(400, {6, 2, 4, 4}, 50)[0] == doctest::Approx(before).epsilon(0.05));
}
