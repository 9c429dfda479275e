#include "evmarker/opencv/code_book.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <random>

#include "evmarker/opencv/aruco_shim.hpp"

using namespace evmarker;
using opencv::CodeBook;
using opencv::DarkQuad;

namespace {

const DarkQuad kWhole{{Eigen::Vector2d(40, 40), {104, 40}, {104, 104}, {40, 104}}, 1};  // eight cells

CodeBook book_of(const char* name) {
  const auto dictionary = opencv::make_dictionary(name);
  CodeBook book;
  for (int id = 0; id < opencv::dictionary_size(dictionary); ++id) book.add(id, opencv::marker_bits(dictionary, id));
  return book;
}

// A marker of 6 x 6 cells in its border, upright in the quadrilateral.
cv::Mat_<uchar> printed(const CodeBits& bits) {
  cv::Mat_<uchar> image(144, 144, uchar{255});
  for (int y = 40; y < 104; ++y)
    for (int x = 40; x < 104; ++x) {
      const int row = (y - 40) / 8, column = (x - 40) / 8;
      const bool white = row > 0 && column > 0 && row < 7 && column < 7 && bits(row - 1, column - 1) != 0;
      image(y, x) = white ? 255 : 0;
    }
  return image;
}

void paint(cv::Mat_<uchar>& image, int row, int column, int colour) {
  cv::rectangle(image, cv::Rect(40 + 8 * column, 40 + 8 * row, 8, 8), colour, -1);
}

}  // namespace

TEST_CASE("a marker is read from whichever corner one begins, and its corners turned to begin with its top left") {
  const CodeBook book = book_of("DICT_APRILTAG_36h11");
  const auto dictionary = opencv::make_dictionary("DICT_APRILTAG_36h11");
  for (const int id : {0, 7, 586})
    for (std::size_t turn = 0; turn < 4; ++turn) {
      DarkQuad quad = kWhole;
      std::rotate(quad.corners.begin(), quad.corners.begin() + static_cast<std::ptrdiff_t>(turn), quad.corners.end());
      const auto reading = book.read(printed(opencv::marker_bits(dictionary, id)), quad);
      REQUIRE(reading);
      CHECK(reading->id == id);
      CHECK(reading->corners == kWhole.corners);
      CHECK(reading->clarity > 0.99);
    }
}

TEST_CASE("in a border of two cells, the code is read inside it, and the border must be dark") {
  CodeBook book(2);
  const auto dictionary = opencv::make_dictionary("DICT_6X6_250");
  for (int id = 0; id < 250; ++id) book.add(id, opencv::marker_bits(dictionary, id));
  const CodeBits code = opencv::marker_bits(dictionary, 42);
  cv::Mat_<uchar> image(140, 140, uchar{255});
  for (int y = 20; y < 120; ++y)
    for (int x = 20; x < 120; ++x) {
      const int row = (y - 20) / 10 - 2, column = (x - 20) / 10 - 2;
      const bool inside = row >= 0 && column >= 0 && row < 6 && column < 6;
      image(y, x) = inside && code(row, column) != 0 ? 255 : 0;
    }
  const DarkQuad quad{{Vec2(19.5, 19.5), Vec2(119.5, 19.5), Vec2(119.5, 119.5), Vec2(19.5, 119.5)}, 1};
  REQUIRE(book.read(image, quad));
  CHECK(book.read(image, quad)->id == 42);
  CHECK(book.read(image, quad)->clarity > 0.99);
  CHECK_FALSE(CodeBook(book_of("DICT_APRILTAG_36h11")).read(image, quad));
  cv::rectangle(image, cv::Rect(20, 30, 100, 10), 255, -1);  // 10 of the 64 cells of the border
  CHECK(book.read(image, quad));
  cv::rectangle(image, cv::Rect(20, 100, 100, 10), 255, -1);
  CHECK_FALSE(book.read(image, quad));
}

TEST_CASE("long codes may have two wrong cells and unseen ones, not four") {
  const CodeBook book = book_of("DICT_APRILTAG_36h11");
  const CodeBits bits = opencv::marker_bits(opencv::make_dictionary("DICT_APRILTAG_36h11"), 3);
  cv::Mat_<uchar> image = printed(bits);
  paint(image, 2, 3, bits(1, 2) != 0 ? 0 : 255);
  paint(image, 5, 5, bits(4, 4) != 0 ? 0 : 255);
  REQUIRE(book.read(image, kWhole));
  CHECK(book.read(image, kWhole)->id == 3);
  CHECK(book.read(image, kWhole)->clarity < 0.97);
  paint(image, 1, 1, bits(0, 0) != 0 ? 0 : 255);
  paint(image, 6, 1, bits(5, 0) != 0 ? 0 : 255);
  CHECK_FALSE(book.read(image, kWhole));

  cv::Mat_<uchar> half = printed(bits);
  for (int column = 1; column < 7; ++column) paint(half, 3, column, 128);
  REQUIRE(book.read(half, kWhole));
  CHECK(book.read(half, kWhole)->id == 3);
  for (int row = 1; row < 5; ++row)
    for (int column = 1; column < 7; ++column) paint(half, row, column, 128);
  CHECK_FALSE(book.read(half, kWhole));
}

TEST_CASE("a bright border, or a part of the outline that is missing around a short code, is no marker") {
  const CodeBook book = book_of("DICT_APRILTAG_36h11"), short_codes = book_of("DICT_4X4_50");
  cv::Mat_<uchar> image = printed(opencv::marker_bits(opencv::make_dictionary("DICT_APRILTAG_36h11"), 3));
  for (int i = 0; i < 8; ++i) paint(image, i, 0, 255);
  CHECK_FALSE(book.read(image, kWhole));

  const auto four = opencv::marker_bits(opencv::make_dictionary("DICT_4X4_50"), 5);
  cv::Mat_<uchar> small(144, 144, uchar{255});
  for (int y = 40; y < 88; ++y)
    for (int x = 40; x < 88; ++x) {
      const int row = (y - 40) / 8, column = (x - 40) / 8;
      const bool white = row > 0 && column > 0 && row < 5 && column < 5 && four(row - 1, column - 1) != 0;
      small(y, x) = white ? 255 : 0;
    }
  DarkQuad quad{{Eigen::Vector2d(40, 40), {88, 40}, {88, 88}, {40, 88}}, 1};
  REQUIRE(short_codes.read(small, quad));
  CHECK(short_codes.read(small, quad)->id == 5);
  quad.seen = 0.7;
  CHECK_FALSE(short_codes.read(small, quad));
}

TEST_CASE("random cells are hardly ever taken for a long code") {
  const CodeBook book = book_of("DICT_APRILTAG_36h11");
  std::mt19937 random(3);
  int read = 0;
  for (int i = 0; i < 20000; ++i) {
    CodeBits bits(6, 6);
    for (Eigen::Index k = 0; k < bits.size(); ++k) bits(k / 6, k % 6) = random() % 2;
    read += book.read(printed(bits), kWhole).has_value();
  }
  CHECK(read <= 6);  // 1e-4 each are allowed: 2 expected at most
}
