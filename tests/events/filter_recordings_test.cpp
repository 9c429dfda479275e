// What the noise filter leaves of real edges' events, with the window that it comes with.
#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/io/csv_reader.hpp"
#include "evmarker/model/camera.hpp"
#include "real_data.hpp"

using namespace evmarker;
using namespace evmarker::test;

namespace {

struct Line {
  Eigen::Vector2d from, to;
  double distance(const Eigen::Vector2d& point) const {
    const Eigen::Vector2d way = to - from;
    const double share = std::clamp((point - from).dot(way) / way.squaredNorm(), 0.0, 1.0);
    return (point - from - share * way).norm();
  }
};

// The true edges in the image at a time, until `until` [us].
struct Truth {
  double t = 0, until = 0;
  std::vector<Line> edges;
};

// The numbers of a file's lines that begin with one.
std::vector<std::vector<double>> rows(const std::filesystem::path& file) {
  std::vector<std::vector<double>> rows;
  std::ifstream in(file);
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line.find_first_of("0123456789-") != 0) continue;
    std::stringstream fields(line);
    rows.emplace_back();
    for (std::string field; std::getline(fields, field, ',');) rows.back().push_back(std::atof(field.c_str()));
  }
  return rows;
}

void add_outline(std::vector<Line>& edges, const std::array<Eigen::Vector2d, 4>& corners) {
  for (std::size_t i = 0; i < 4; ++i) edges.push_back({corners[i], corners[(i + 1) % 4]});
}

struct Shares {
  double near = 0,
         paper = 0;        // of the events within 2 px of an edge: let through by the automatic and the paper's window
  std::size_t events = 0;  // that are that near
};

Shares shares(const std::filesystem::path& file, SensorSize size, const std::vector<Truth>& truth) {
  SpatiotemporalFilter filter(size), paper(size, kPaperWindow);
  io::CsvReader recording(file, {.sensor_size = size});
  std::size_t next = 0, passed = 0, passed_paper = 0;
  Shares shares;
  for_each_event(recording, [&](const Event& event) {
    const bool accepted = filter.accept(event), by_paper = paper.accept(event);
    const auto t = static_cast<double>(event.t);
    while (next < truth.size() && truth[next].until < t) ++next;
    if (next == truth.size() || t < truth[next].t) return;
    const Eigen::Vector2d point(event.x, event.y);
    if (std::ranges::none_of(truth[next].edges, [&](const Line& edge) { return edge.distance(point) <= 2; })) return;
    ++shares.events;
    passed += accepted;
    passed_paper += by_paper;
  });
  shares.near = static_cast<double>(passed) / static_cast<double>(shares.events);
  shares.paper = static_cast<double>(passed_paper) / static_cast<double>(shares.events);
  MESSAGE(shares.events << " events near edges, let through: " << shares.near << ", by the paper's window "
                        << shares.paper);
  return shares;
}

}  // namespace

TEST_CASE("nine in ten events at the outlines of the real tags pass the noise filter") {
  if (missing(kData / "tags")) return;
  std::vector<Truth> truth;
  for (const auto& row : rows(kData / "tags" / "corners.csv")) {
    if (truth.empty() || truth.back().t != row[0] - 1000) truth.push_back({row[0] - 1000, row[0] + 1000, {}});
    add_outline(truth.back().edges, {Eigen::Vector2d(row[2], row[3]), Eigen::Vector2d(row[4], row[5]),
                                     Eigen::Vector2d(row[6], row[7]), Eigen::Vector2d(row[8], row[9])});
  }
  REQUIRE(truth.size() > 400);
  const Shares tags = shares(kData / "tags" / "events.csv", {346, 260}, truth);
  REQUIRE(tags.events > 200000);
  CHECK(tags.paper < 0.6);
  CHECK(tags.near > 0.9);
}

TEST_CASE("nine in ten events at the edges of the real pyramid pass the noise filter") {
  if (missing(kData / "pyramid")) return;
  const PinholeCamera camera(
      {128, 128}, 151, 151, 64, 64,
      BrownConradyDistortion{.k1 = -0.3692, .k2 = 0.1812, .p1 = 0.0022, .p2 = 0.0003, .k3 = 0.0116});
  const std::array<Eigen::Vector3d, 4> vertices{Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.114893, 0, -0.041032),
                                                Eigen::Vector3d(-0.057447, 0.0995, -0.041032),
                                                Eigen::Vector3d(-0.057447, -0.0995, -0.041032)};
  std::vector<Truth> truth;
  for (const auto& row : rows(kData / "pyramid" / "reference.csv")) {
    if (!(row[8] > 0.6 && row[10] < 100)) continue;
    truth.push_back({row[0] - 10000, row[0] + 10000, {}});
    const Eigen::Quaterniond R(row[7], row[4], row[5], row[6]);
    const Eigen::Vector3d T(row[1], row[2], row[3]);
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = i + 1; j < 4; ++j) {
        constexpr int kPieces = 8;  // the lens bends the edge
        const auto point = [&](int piece) {
          return camera.project(R * (vertices[i] + (vertices[j] - vertices[i]) * piece / kPieces) + T);
        };
        for (int piece = 0; piece < kPieces; ++piece) truth.back().edges.push_back({point(piece), point(piece + 1)});
      }
  }
  REQUIRE(truth.size() > 400);
  const Shares pyramid = shares(kData / "pyramid" / "events.csv", {128, 128}, truth);
  REQUIRE(pyramid.events > 100000);
  CHECK(pyramid.paper < 0.25);
  CHECK(pyramid.near > 0.9);
}

TEST_CASE("nine in ten events at the edges of the real flip's square pass the noise filter") {
  if (missing(kData / "flip")) return;
  const auto fits = rows(kData / "flip" / "square_fit.csv");
  REQUIRE(fits.size() > 50);
  std::vector<Truth> truth;
  std::size_t before = 0;
  for (double t = fits.front()[0]; t < fits.back()[0]; t += 1000) {
    while (fits[before + 1][0] <= t) ++before;
    const double share = (t - fits[before][0]) / (fits[before + 1][0] - fits[before][0]);
    const auto at = [&](std::size_t i) { return fits[before][i] + share * (fits[before + 1][i] - fits[before][i]); };
    const Eigen::Vector2d centre(at(1), at(2));
    const Eigen::Rotation2Dd turn(at(4));
    const double half = at(3) / 2;
    truth.push_back({t, t + 1000, {}});
    add_outline(truth.back().edges,
                {centre + turn * Eigen::Vector2d(-half, -half), centre + turn * Eigen::Vector2d(half, -half),
                 centre + turn * Eigen::Vector2d(half, half), centre + turn * Eigen::Vector2d(-half, half)});
  }
  const Shares flip = shares(kData / "flip" / "events.csv", {128, 128}, truth);
  REQUIRE(flip.events > 25000);
  CHECK(flip.paper < 0.85);
  CHECK(flip.near > 0.9);
}
