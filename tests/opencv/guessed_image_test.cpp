#include "evmarker/opencv/guessed_image.hpp"

#include <doctest/doctest.h>

#include <Eigen/Core>
#include <cmath>
#include <vector>

using namespace evmarker;
using opencv::guess_image;

namespace {

constexpr int kWidth = 160, kHeight = 120;
// A 60 px square of 5 x 5 cells; '#' black. Around it all is white.
constexpr const char* kCells[5] = {"#####", "#  ##", "## ##", "##  #", "#####"};
constexpr double kCell = 12;

bool white(double x, double y) {
  const int column = static_cast<int>(std::floor(x / kCell)), row = static_cast<int>(std::floor(y / kCell));
  return column < 0 || row < 0 || column >= 5 || row >= 5 || kCells[row][column] == ' ';
}

// Position of the square's corner [px] at a time.
using Motion = Eigen::Vector2d (*)(double ms);

// What an ideal sensor sees: an event at every pixel whose brightness changes.
PolarityFrame watch(Motion motion, int until_ms) {
  PolarityFrame frame({kWidth, kHeight});
  const auto bright = [&](int x, int y, double ms) {
    const Eigen::Vector2d corner = motion(ms);
    return white(x - corner.x(), y - corner.y());
  };
  constexpr double kStep = 0.1;  // [ms]
  for (double ms = 0; ms < until_ms; ms += kStep)
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if (const bool now = bright(x, y, ms + kStep); now != bright(x, y, ms))
          frame.update({static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y),
                        static_cast<std::int16_t>(now ? 1 : 0), static_cast<Timestamp>(1000 * (ms + kStep))});
  return frame;
}

struct Shares {
  double right = 0, wrong = 0;
};

// Of the square's pixels.
Shares compare(const cv::Mat& image, const Eigen::Vector2d& corner) {
  Shares shares;
  int pixels = 0;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const double u = x - corner.x(), v = y - corner.y();
      if (u < 0 || v < 0 || u >= 5 * kCell || v >= 5 * kCell) continue;
      ++pixels;
      const int seen = image.at<std::uint8_t>(y, x);
      if (seen == PolarityFrame::kUntouched) continue;
      (white(u, v) == (seen > 128) ? shares.right : shares.wrong) += 1;
    }
  return {shares.right / pixels, shares.wrong / pixels};
}

cv::Mat polarities(const PolarityFrame& frame) {
  return {kHeight, kWidth, CV_8U, const_cast<std::uint8_t*>(frame.pixels().data())};
}

}  // namespace

TEST_CASE("three pixels of motion show the whole square, though they touched little of it") {
  const Motion motions[] = {[](double ms) -> Eigen::Vector2d {
                              return {50 + 0.3 * ms, 30};
                            },
                            [](double ms) -> Eigen::Vector2d {
                              return {50, 30 - 0.3 * ms};
                            },
                            [](double ms) -> Eigen::Vector2d {
                              return {50 - 0.25 * ms, 30 + 0.2 * ms};
                            }};
  for (const Motion motion : motions) {
    const PolarityFrame frame = watch(motion, 10);
    const Shares touched = compare(polarities(frame), motion(10)), guessed = compare(guess_image(frame), motion(10));
    REQUIRE(touched.right > 0.05);
    CHECK(touched.right < 0.5);
    CHECK(guessed.right > 0.95);
    CHECK(guessed.wrong < 0.05);
  }
}

TEST_CASE("a motion that turned back is understood at once: the strips before and after are told apart") {
  const Motion motion = [](double ms) -> Eigen::Vector2d {
    const double way = ms < 15 ? 0.4 * ms : 6 - 0.4 * (ms - 15);
    return {50 + way, 30 + 0.8 * way};
  };
  for (const int ms : {18, 22, 45}) {
    CAPTURE(ms);
    const Shares guessed = compare(guess_image(watch(motion, ms)), motion(ms));
    CHECK(guessed.right > 0.95);
    CHECK(guessed.wrong < 0.03);
  }
}

TEST_CASE("nothing seen, nothing guessed, and lone events are noise") {
  PolarityFrame frame({kWidth, kHeight});
  CHECK(cv::countNonZero(guess_image(frame) != PolarityFrame::kUntouched) == 0);
  for (int i = 0; i < 100; ++i)
    frame.update({static_cast<std::uint16_t>(5 + 15 * (i % 10)), static_cast<std::uint16_t>(5 + 11 * (i / 10)),
                  static_cast<std::int16_t>(i % 2), 100 * i});
  CHECK(cv::countNonZero(guess_image(frame) != PolarityFrame::kUntouched) == 0);
}

TEST_CASE("times whose 32 bits wrap in the middle of the motion make no difference") {
  const Motion motion = [](double ms) -> Eigen::Vector2d { return {50 + 0.3 * ms, 30 + 0.2 * ms}; };
  const PolarityFrame frame = watch(motion, 10);
  PolarityFrame late({kWidth, kHeight});
  const Timestamp wrap = (Timestamp{1} << 32) - 5000;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) {
      const auto i = static_cast<std::size_t>(y * kWidth + x);
      if (frame.pixels()[i] == PolarityFrame::kUntouched) continue;
      late.update({static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y),
                   static_cast<std::int16_t>(frame.pixels()[i] > 128 ? 1 : 0), wrap + frame.times()[i]});
    }
  CHECK(cv::countNonZero(guess_image(frame) != guess_image(late)) == 0);
}
