#include "evmarker/events/polarity_frame.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <string>

using evmarker::PolarityFrame;

TEST_CASE("a new frame is grey") {
  const PolarityFrame frame({5, 3});
  CHECK(frame.sensor_size() == evmarker::SensorSize{5, 3});
  REQUIRE(frame.pixels().size() == 15);
  CHECK(std::ranges::count(frame.pixels(), PolarityFrame::kUntouched) == 15);
  CHECK(frame.t() == 0);
}

TEST_CASE("a pixel shows its last polarity, and only that pixel") {
  PolarityFrame frame({5, 3});
  frame.update({4, 1, 1, 100});
  CHECK(frame.pixels()[9] == 255);
  frame.update({0, 0, 0, 101});
  CHECK(frame.pixels()[0] == 0);
  frame.update({4, 2, -1, 102});  // -1 is OFF as 0 is
  CHECK(frame.pixels()[14] == 0);
  CHECK(std::ranges::count(frame.pixels(), PolarityFrame::kUntouched) == 12);
  CHECK(frame.t() == 102);

  frame.update({4, 1, 0, 103});
  CHECK(frame.pixels()[9] == 0);
  frame.update({4, 1, 1, 104});
  frame.update({4, 1, 1, 105});
  CHECK(frame.pixels()[9] == 255);
  CHECK(frame.t() == 105);
  CHECK(std::ranges::count(frame.pixels(), PolarityFrame::kUntouched) == 12);
}

TEST_CASE("a copy is a frame of its own") {
  PolarityFrame frame({2, 1});
  const PolarityFrame before = frame;
  frame.update({1, 0, 1, 7});
  CHECK(before.pixels()[1] == PolarityFrame::kUntouched);
  CHECK(before.t() == 0);
}

TEST_CASE("a cleared frame is grey, and takes events as a new one does") {
  PolarityFrame frame({3, 2});
  frame.update({1, 0, 1, 100});
  frame.update({2, 1, 0, 200});
  frame.clear();
  CHECK(frame.clears() == 1);
  CHECK(std::ranges::all_of(frame.pixels(), [](std::uint8_t pixel) { return pixel == PolarityFrame::kUntouched; }));
  frame.update({0, 1, 1, 300});
  CHECK(frame.pixels()[3] == PolarityFrame::kOn);
  CHECK(frame.times()[3] == 300);
  CHECK(std::ranges::count(frame.pixels(), PolarityFrame::kUntouched) == 5);
}

TEST_CASE("an impossible size is refused with its value") {
  for (const evmarker::SensorSize size : {evmarker::SensorSize{0, 3}, {5, 0}, {-5, 3}, {5, -3}}) {
    try {
      PolarityFrame frame(size);
      FAIL("a frame of " << size.width << " x " << size.height << " was accepted");
    } catch (const std::invalid_argument& error) {
      CHECK(std::string(error.what()) ==
            "polarity frame: sensor size is " + std::to_string(size.width) + " x " + std::to_string(size.height));
    }
  }
}
