#include "evmarker/simulation/printed_marker.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

namespace {

CodeBits small_code() {
  CodeBits bits(3, 3);
  bits << 1, 0, 1, 0, 0, 1, 0, 1, 1;
  return bits;
}

constexpr double kInk = 0.1, kPaper = 0.8;

/// The sheet's light at a point without any blur, as printed: 3 x 3 cells, a black border, 1.5 cells of paper around.
/// Negative beside the sheet.
double printed(double a, double b) {
  if (a < -1.5 || a >= 6.5 || b < -1.5 || b >= 6.5) return -1;
  const int column = static_cast<int>(std::floor(a)), row = static_cast<int>(std::floor(b));
  if (column < 0 || column >= 5 || row < 0 || row >= 5) return kPaper;
  if (column == 0 || column == 4 || row == 0 || row == 4) return kInk;
  return small_code()(row - 1, column - 1) != 0 ? kPaper : kInk;
}

}  // namespace

TEST_CASE("the profile of an edge is the integral of the normal distribution") {
  for (double x = -6; x <= 6; x += 0.0137)
    CHECK(std::abs(edge_profile(x) - 0.5 * std::erfc(-x / std::sqrt(2.0))) < 4e-5);
  for (double x = -3.9; x <= 3.9; x += 0.0137)
    CHECK(std::abs(edge_profile(x) - 0.5 * std::erfc(-x / std::sqrt(2.0))) < 1e-6);
  CHECK(edge_profile(-kEdgeReach) == 0);
  CHECK(edge_profile(kEdgeReach) == 1);
  CHECK(edge_profile(std::nan("")) == 0);
}

TEST_CASE("the blurred sheet is the printed one averaged over a Gaussian") {
  const PrintedMarker marker(small_code(), 1.5, kInk, kPaper);
  CHECK(marker.cells() == 5);
  const double sigma_a = 0.25, sigma_b = 0.4;
  for (const double a : {-2.0, -1.4, 0.1, 0.9, 1.5, 2.2, 3.95, 5.2, 6.4, 7.0})
    for (const double b : {-1.6, 0.0, 0.7, 1.9, 3.1, 4.4, 6.6}) {
      double coverage = 0, radiance = 0, weight = 0;
      constexpr int kSteps = 200;
      for (int i = -kSteps; i < kSteps; ++i)
        for (int j = -kSteps; j < kSteps; ++j) {
          const double u = (i + 0.5) * 4.0 / kSteps, v = (j + 0.5) * 4.0 / kSteps;
          const double w = std::exp(-(u * u + v * v) / 2), light = printed(a + u * sigma_a, b + v * sigma_b);
          weight += w;
          if (light >= 0) {
            coverage += w;
            radiance += w * light;
          }
        }
      const auto sample = marker.front(a, b, sigma_a, sigma_b);
      CHECK(std::abs(sample.coverage - coverage / weight) < 5e-3);
      CHECK(std::abs(sample.radiance - radiance / weight) < 5e-3);
    }
}

TEST_CASE("nothing changes within the clearance") {
  const PrintedMarker marker(small_code(), 1.5, kInk, kPaper);
  const double sigma = 1e-3;
  int rest = 0;
  for (double a = -3; a < 8; a += 0.31)
    for (double b = -3; b < 8; b += 0.29) {
      const auto sample = marker.front(a, b, sigma, sigma);
      if (sample.coverage == 1 || sample.coverage == 0) CHECK(sample.clearance > 0);
      rest += sample.clearance > 0.2;
      for (const double da : {-0.99, 0.0, 0.99})
        for (const double db : {-0.99, 0.0, 0.99}) {
          if (sample.clearance == 0) continue;
          const double a1 = a + da * sample.clearance, b1 = b + db * sample.clearance;
          CHECK(printed(a1, b1) == printed(a, b));
        }
    }
  CHECK(rest > 100);
}

TEST_CASE("the back is blank paper") {
  const PrintedMarker marker(small_code(), 1.5, kInk, kPaper);
  const auto middle = marker.back(0.5, 0.5, 0.1, 0.1);
  CHECK(middle.coverage == 1);
  CHECK(middle.radiance == doctest::Approx(kPaper));
  CHECK(middle.clearance == doctest::Approx(2.0));
  CHECK(marker.back(-1.5, 2, 0.1, 0.1).coverage == doctest::Approx(0.5));
  const auto beside = marker.back(-3, 2, 0.1, 0.1);
  CHECK(beside.coverage == 0);
  CHECK(beside.clearance == doctest::Approx(1.5));
}

TEST_CASE("a sheet may end at the black square") {
  const PrintedMarker marker(small_code(), 0, kInk, kPaper);
  const auto sample = marker.front(0, 2.5, 0.1, 0.1);
  CHECK(sample.coverage == doctest::Approx(0.5));
  CHECK(sample.radiance == doctest::Approx(0.5 * kInk));
}

TEST_CASE("cells may have shades of their own, rim and border too, and the back has not") {
  CellShades shades(7, 7);
  for (Eigen::Index i = 0; i < shades.size(); ++i) shades(i / 7, i % 7) = 0.1 + 0.01 * static_cast<double>(i);
  const PrintedMarker marker(small_code(), 1, kInk, kPaper, shades);
  for (int row = 0; row < 7; ++row)
    for (int column = 0; column < 7; ++column) {
      const auto sample = marker.front(column - 0.5, row - 0.5, 0.05, 0.05);
      CHECK(sample.radiance == shades(row, column));
      CHECK(sample.clearance == doctest::Approx(0.5));
    }
  const auto border = marker.front(2, 2.5, 0.05, 0.05);  // between the cells (3, 2) and (3, 3)
  CHECK(border.radiance == doctest::Approx(0.5 * (shades(3, 2) + shades(3, 3))));
  CHECK(marker.back(2.5, 2.5, 0.05, 0.05).radiance == doctest::Approx(kPaper));
}

TEST_CASE("prints that make no sense are named") {
  CHECK_THROWS_WITH_AS(PrintedMarker(small_code(), -1, kInk, kPaper), "printed marker: quiet_zone_cells is -1",
                       std::invalid_argument);
  CHECK_THROWS_WITH_AS(PrintedMarker(small_code(), 1, 0, kPaper), "printed marker: black is 0", std::invalid_argument);
  CHECK_THROWS_AS(PrintedMarker(CodeBits(2, 3), 1, kInk, kPaper), std::invalid_argument);
  CHECK_THROWS_AS(PrintedMarker(CodeBits(), 1, kInk, kPaper), std::invalid_argument);
  CHECK_THROWS_AS(PrintedMarker(CodeBits(61, 61), 1, kInk, kPaper), std::invalid_argument);
  CellShades shades = CellShades::Constant(7, 7, 0.5);
  shades(2, 3) = -0.5;
  CHECK_THROWS_WITH_AS(PrintedMarker(small_code(), 1, kInk, kPaper, shades),
                       "printed marker: shade in row 2, column 3 is -0.5", std::invalid_argument);
  CHECK_THROWS_WITH_AS(PrintedMarker(small_code(), 1, kInk, kPaper, CellShades::Constant(6, 7, 0.5)),
                       "printed marker: number of shade rows is 6", std::invalid_argument);
}
