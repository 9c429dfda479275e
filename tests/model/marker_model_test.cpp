#include "evmarker/model/marker_model.hpp"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <numeric>
#include <random>

#include "evmarker/opencv/aruco_shim.hpp"
#include "message_of.hpp"

using Eigen::Vector3d;
using evmarker::CodeBits;
using evmarker::make_code_marker;
using evmarker::make_rectangle_marker;
using evmarker::make_square_marker;
using evmarker::MarkerModel;
using evmarker::MarkerSegment;

namespace {

CodeBits bits(int size, const std::vector<int>& rows) {
  CodeBits result(size, size);
  for (int i = 0; i < size * size; ++i)
    result(i / size, i % size) = static_cast<std::uint8_t>(rows[static_cast<std::size_t>(i)]);
  return result;
}

Vector3d start(const MarkerModel& model, const MarkerSegment& s) {
  return model.vertices[static_cast<std::size_t>(s.from)];
}
Vector3d end(const MarkerModel& model, const MarkerSegment& s) {
  return model.vertices[static_cast<std::size_t>(s.to)];
}
double length(const MarkerModel& model, const MarkerSegment& s) { return (end(model, s) - start(model, s)).norm(); }
double total_length(const MarkerModel& model) {
  return std::accumulate(model.segments.begin(), model.segments.end(), 0.0,
                         [&](double sum, const MarkerSegment& s) { return sum + length(model, s); });
}

// The printed marker, point by point: dark or not at (x right, y up) [m].
struct Print {
  double side;
  CodeBits code;
  bool dark(double x, double y) const {
    const int cells = static_cast<int>(code.rows()) + 2;
    const int column = static_cast<int>(std::floor((x + side / 2) / side * cells));
    const int row = static_cast<int>(std::floor((side / 2 - y) / side * cells));
    if (column < 0 || row < 0 || column >= cells || row >= cells) return false;
    if (column == 0 || row == 0 || column == cells - 1 || row == cells - 1) return true;
    return code(row - 1, column - 1) == 0;
  }
};

// Counts the edges of the print by walking over its cells, in cell lengths.
int count_cell_edges(const Print& print) {
  const int cells = static_cast<int>(print.code.rows()) + 2;
  const double cell = print.side / cells;
  const auto dark = [&](int row, int column) {
    return print.dark(-print.side / 2 + (column + 0.5) * cell, print.side / 2 - (row + 0.5) * cell);
  };
  int edges = 0;
  for (int row = -1; row < cells; ++row)
    for (int column = -1; column < cells; ++column)
      edges += (dark(row, column) != dark(row, column + 1)) + (dark(row, column) != dark(row + 1, column));
  return edges;
}

// Every segment borders dark on its dark side and bright on the other all along, and all edges are there once.
void check_against_print(const MarkerModel& model, const Print& print) {
  const double cell = print.side / static_cast<double>(print.code.rows() + 2);
  CHECK_NOTHROW(evmarker::validate(model));
  CHECK(total_length(model) == doctest::Approx(count_cell_edges(print) * cell).epsilon(1e-12));
  for (const MarkerSegment& s : model.segments) {
    const Vector3d along = end(model, s) - start(model, s);
    CHECK(s.dark_side.norm() == doctest::Approx(1));
    CHECK(std::abs(s.dark_side.dot(along)) < 1e-15);
    CHECK(s.face_normal == Vector3d::UnitZ());
    CHECK(along.z() == 0);
    const int steps = static_cast<int>(std::lround(along.norm() / cell));
    REQUIRE(steps >= 1);
    CHECK(along.norm() == doctest::Approx(steps * cell));
    for (int i = 0; i < steps; ++i) {
      const Vector3d middle = start(model, s) + (i + 0.5) / steps * along;
      const Vector3d inside = middle + 0.1 * cell * s.dark_side, outside = middle - 0.1 * cell * s.dark_side;
      CHECK(print.dark(inside.x(), inside.y()));
      CHECK_FALSE(print.dark(outside.x(), outside.y()));
    }
  }
  for (std::size_t i = 0; i < model.segments.size(); ++i)  // no two on the same stretch
    for (std::size_t j = 0; j < i; ++j) {
      const auto &a = model.segments[i], &b = model.segments[j];
      const Vector3d along = (end(model, a) - start(model, a)).normalized();
      const double b0 = (start(model, b) - start(model, a)).dot(along),
                   b1 = (end(model, b) - start(model, a)).dot(along);
      const bool same_line = (start(model, b) - start(model, a)).cross(along).norm() < 1e-9 &&
                             (end(model, b) - start(model, a)).cross(along).norm() < 1e-9;
      const double overlap = std::min(length(model, a), std::max(b0, b1)) - std::max(0.0, std::min(b0, b1));
      if (same_line) CHECK(overlap < 1e-9);
    }
  for (std::size_t i = 0; i < model.vertices.size(); ++i)  // no vertex twice
    for (std::size_t j = 0; j < i; ++j) CHECK((model.vertices[i] - model.vertices[j]).norm() > cell / 2);
}

}  // namespace

TEST_CASE("the square has its corners from the top left clockwise and is dark inside") {
  const MarkerModel model = make_square_marker(0.2);
  REQUIRE(model.vertices.size() == 4);
  CHECK(model.vertices[0] == Vector3d(-0.1, 0.1, 0));
  CHECK(model.vertices[1] == Vector3d(0.1, 0.1, 0));
  CHECK(model.vertices[2] == Vector3d(0.1, -0.1, 0));
  CHECK(model.vertices[3] == Vector3d(-0.1, -0.1, 0));
  REQUIRE(model.segments.size() == 4);
  for (int i = 0; i < 4; ++i) {
    const MarkerSegment& s = model.segments[static_cast<std::size_t>(i)];
    CHECK(s.from == i);
    CHECK(s.to == (i + 1) % 4);
    CHECK(length(model, s) == doctest::Approx(0.2));
    const Vector3d middle = (start(model, s) + end(model, s)) / 2;
    CHECK((s.dark_side + middle.normalized()).norm() < 1e-15);  // toward the centre
  }
  evmarker::validate(model);
}

TEST_CASE("a rectangle is a square that is as wide and as high as stated, and no grid") {
  const MarkerModel model = make_rectangle_marker(0.3, 0.2), square = make_square_marker(0.2);
  REQUIRE(model.vertices.size() == 4);
  CHECK((model.vertices[0] - Eigen::Vector3d(-0.15, 0.1, 0)).norm() < 1e-15);
  CHECK((model.vertices[1] - Eigen::Vector3d(0.15, 0.1, 0)).norm() < 1e-15);
  CHECK((model.vertices[2] - Eigen::Vector3d(0.15, -0.1, 0)).norm() < 1e-15);
  CHECK((model.vertices[3] - Eigen::Vector3d(-0.15, -0.1, 0)).norm() < 1e-15);
  REQUIRE(model.segments.size() == 4);
  for (std::size_t i = 0; i < 4; ++i) {
    CHECK(model.segments[i].from == square.segments[i].from);
    CHECK(model.segments[i].to == square.segments[i].to);
    CHECK(model.segments[i].dark_side == square.segments[i].dark_side);
    CHECK(model.segments[i].face_normal == square.segments[i].face_normal);
  }
  CHECK(model.cells == 0);
  CHECK(make_rectangle_marker(0.2, 0.2).vertices == square.vertices);
  CHECK_NOTHROW(validate(model));
}

TEST_CASE("a code of one black cell is the plain square") {
  const MarkerModel model = make_code_marker(0.3, bits(1, {0}));
  CHECK(model.segments.size() == 4);
  CHECK(model.vertices.size() == 4);
  CHECK(total_length(model) == doctest::Approx(1.2));
  check_against_print(model, {0.3, bits(1, {0})});
}

TEST_CASE("a code of one white cell is a square in a square") {
  const MarkerModel model = make_code_marker(0.3, bits(1, {1}));
  CHECK(model.vertices.size() == 8);
  REQUIRE(model.segments.size() == 8);
  int inner = 0;
  for (const MarkerSegment& s : model.segments) {
    const Vector3d middle = (start(model, s) + end(model, s)) / 2;
    if (middle.norm() < 0.1) {  // a white cell inside black: dark lies outward
      ++inner;
      CHECK(length(model, s) == doctest::Approx(0.1));
      CHECK((s.dark_side - middle.normalized()).norm() < 1e-9);
    } else {
      CHECK(length(model, s) == doctest::Approx(0.3));
      CHECK((s.dark_side + middle.normalized()).norm() < 1e-9);
    }
  }
  CHECK(inner == 4);
  check_against_print(model, {0.3, bits(1, {1})});
}

TEST_CASE("2x2 codes worked by hand") {
  // Cells of 1 m in a marker of 4 m. Outline: 4 segments of 4 m.
  const auto lengths = [](const MarkerModel& model) {
    std::vector<int> result;
    for (const MarkerSegment& s : model.segments) result.push_back(static_cast<int>(std::lround(length(model, s))));
    std::ranges::sort(result);
    return result;
  };
  using Lengths = std::vector<int>;
  CHECK(lengths(make_code_marker(4, bits(2, {0, 0, 0, 0}))) == Lengths{4, 4, 4, 4});
  CHECK(lengths(make_code_marker(4, bits(2, {1, 1, 1, 1}))) == Lengths{2, 2, 2, 2, 4, 4, 4, 4});
  CHECK(lengths(make_code_marker(4, bits(2, {1, 0, 0, 0}))) == Lengths{1, 1, 1, 1, 4, 4, 4, 4});
  CHECK(lengths(make_code_marker(4, bits(2, {1, 1, 0, 0}))) == Lengths{1, 1, 2, 2, 4, 4, 4, 4});
  // An L: two outer sides of 2, two ends of 1, two inner sides of 1.
  CHECK(lengths(make_code_marker(4, bits(2, {1, 0, 1, 1}))) == Lengths{1, 1, 1, 1, 2, 2, 4, 4, 4, 4});
  // A diagonal: the two squares meet in one point, where the dark side changes and the lines must not be joined.
  CHECK(lengths(make_code_marker(4, bits(2, {1, 0, 0, 1}))) == Lengths{1, 1, 1, 1, 1, 1, 1, 1, 4, 4, 4, 4});
}

TEST_CASE("the first bit is the top left cell") {
  const MarkerModel model = make_code_marker(4, bits(2, {1, 0, 0, 0}));
  for (const MarkerSegment& s : model.segments)
    if (length(model, s) < 2) {
      const Vector3d middle = (start(model, s) + end(model, s)) / 2;
      CHECK((middle - Vector3d(-0.5, 0.5, 0)).norm() == doctest::Approx(0.5));
    }
}

TEST_CASE("random codes of every size have all the edges of the print and no others") {
  std::mt19937 random(4);
  for (int size = 1; size <= 8; ++size)
    for (int repeat = 0; repeat < 5; ++repeat) {
      CodeBits code(size, size);
      for (int i = 0; i < size * size; ++i) code(i / size, i % size) = random() % 2;
      CAPTURE(size);
      check_against_print(make_code_marker(0.1, code), {0.1, code});
    }
}

TEST_CASE("an ArUco marker has the edges of the picture that OpenCV draws of it") {
  const cv::aruco::Dictionary dictionary = evmarker::opencv::make_dictionary("DICT_4X4_50");
  for (const int id : {0, 7, 23}) {
    cv::Mat picture;
    cv::Mat drawn;
#if CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR >= 7)
    dictionary.generateImageMarker(id, 60, drawn, 1);
#else
    const_cast<cv::aruco::Dictionary&>(dictionary).drawMarker(id, 60, drawn, 1);
#endif
    cv::copyMakeBorder(drawn, picture, 10, 10, 10, 10, cv::BORDER_CONSTANT, 255);
    int pixel_edges = 0;
    for (int y = 0; y + 1 < picture.rows; ++y)
      for (int x = 0; x + 1 < picture.cols; ++x)
        pixel_edges += (picture.at<uchar>(y, x) != picture.at<uchar>(y, x + 1)) +
                       (picture.at<uchar>(y, x) != picture.at<uchar>(y + 1, x));
    CodeBits code(4, 4);
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 4; ++column)
        code(row, column) = picture.at<uchar>(25 + 10 * row, 25 + 10 * column) > 127;
    const MarkerModel model = make_code_marker(0.06, code);
    CHECK(pixel_edges > 240);
    CHECK(total_length(model) == doctest::Approx(pixel_edges * 0.001));
    check_against_print(model, {0.06, code});
  }
}

TEST_CASE("an impossible length is refused with its value") {
  CHECK(message_of([] { make_square_marker(0); }) == "marker length must be a positive number of metres, not 0");
  CHECK(message_of([] { make_square_marker(-0.1); }) == "marker length must be a positive number of metres, not -0.1");
  CHECK(message_of([] { make_square_marker(std::nan("")); }) ==
        "marker length must be a positive number of metres, not nan");
  CHECK(message_of([] { make_code_marker(-1, bits(1, {0})); }) ==
        "marker length must be a positive number of metres, not -1");
  CHECK(message_of([] { make_rectangle_marker(-1, 2); }) == "marker width must be a positive number of metres, not -1");
  CHECK(message_of([] { make_rectangle_marker(1, 0); }) == "marker height must be a positive number of metres, not 0");
  CHECK(message_of([] { make_rectangle_marker(1, std::nan("")); }) ==
        "marker height must be a positive number of metres, not nan");
}

TEST_CASE("a code that is not a square of cells is refused with its size") {
  CHECK(message_of([] { make_code_marker(1, CodeBits::Zero(2, 3)); }) ==
        "marker code must be a square of cells, not 2 x 3");
  CHECK(message_of([] { make_code_marker(1, CodeBits()); }) == "marker code must be a square of cells, not 0 x 0");
}

TEST_CASE("a wireframe that cannot be tracked is refused with what is wrong") {
  const MarkerModel good = make_square_marker(1);
  const auto message = [&](auto change) {
    MarkerModel model = good;
    change(model);
    return message_of([&] { evmarker::validate(model); });
  };
  CHECK(message([](MarkerModel&) {}) == "nothing thrown");
  CHECK(message([](MarkerModel& m) { m.segments.clear(); }) == "marker model: no segments");
  CHECK(message([](MarkerModel& m) { m = {}; }) == "marker model: no segments");
  CHECK(message([](MarkerModel& m) { m.segments[2].to = 4; }) == "marker model: segment 2 joins vertices 2 and 4 of 4");
  CHECK(message([](MarkerModel& m) { m.segments[1].from = -1; }) ==
        "marker model: segment 1 joins vertices -1 and 2 of 4");
  CHECK(message([](MarkerModel& m) { m.segments[1].to = 1; }) == "marker model: segment 1 has no length");
  CHECK(message([](MarkerModel& m) { m.vertices[1] = m.vertices[0]; }) == "marker model: segment 0 has no length");
  CHECK(message([](MarkerModel& m) { m.vertices[3].y() = std::nan(""); }) == "marker model: vertex 3 is not finite");
  CHECK(message([](MarkerModel& m) { m.segments[3].dark_side.x() = std::nan(""); }) ==
        "marker model: segment 3: dark_side has length nan, not 1 or, where unknown, 0");
  CHECK(message([](MarkerModel& m) { m.segments[3].face_normal.z() = std::nan(""); }) ==
        "marker model: segment 3: face_normal has length nan, not 1 or, where unknown, 0");
  CHECK(message([](MarkerModel& m) { m.segments[3].dark_side *= 2; }) ==
        "marker model: segment 3: dark_side has length 2, not 1 or, where unknown, 0");
  CHECK(message([](MarkerModel& m) { m.segments[0].face_normal *= 0.5; }) ==
        "marker model: segment 0: face_normal has length 0.5, not 1 or, where unknown, 0");
  CHECK(message([](MarkerModel& m) { m.segments[3].dark_side.setZero(); }) == "nothing thrown");  // not known
}
