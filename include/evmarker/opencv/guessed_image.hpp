#pragma once
// Reconstruction of a black-and-white image from a frame of last polarities.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include "evmarker/events/polarity_frame.hpp"

namespace evmarker::opencv {

namespace detail {

inline constexpr std::uint8_t kUnseen = PolarityFrame::kUntouched;
inline constexpr int kBlock = 3;  // side [px] of the blocks whose motion is estimated

// The last polarities without noise. A pixel takes the polarity that at least five of the 3 x 3 pixels around it have,
// or else keeps its own if at least two neighbours share it, as the edge of a slow marker is a thin line.
inline cv::Mat_<std::uint8_t> without_noise(const cv::Mat& pixels) {
  constexpr int kMajority = 5, kLine = 3;  // of the 3 x 3 pixels
  const auto count = [&](std::uint8_t polarity) {
    cv::Mat_<std::uint8_t> sum;
    cv::boxFilter((pixels == polarity) / 255, sum, CV_8U, {3, 3}, {-1, -1}, false, cv::BORDER_CONSTANT);
    return sum;
  };
  const cv::Mat_<std::uint8_t> on = count(PolarityFrame::kOn), off = count(PolarityFrame::kOff);
  cv::Mat_<std::uint8_t> seen(pixels.size(), kUnseen);
  seen.setTo(PolarityFrame::kOn,
             (on >= kMajority) | ((pixels == PolarityFrame::kOn) & (on >= kLine) & (off < kMajority)));
  seen.setTo(PolarityFrame::kOff,
             (off >= kMajority) | ((pixels == PolarityFrame::kOff) & (off >= kLine) & (on < kMajority)));
  return seen;
}

// How much later time a is than time b [us], limited to 20 ms. Both are low 32 bits of times at most 35 minutes apart.
inline float later_us(std::uint32_t a, std::uint32_t b) {
  constexpr float kAnotherPassage = 20000;  // [us]: longer differences are those between two edges
  return std::clamp(static_cast<float>(static_cast<std::int32_t>(a - b)), -kAnotherPassage, kAnotherPassage);
}

// Directions of motion of the edges that passed these pixels, as unit vectors, one for every block; zero where unknown.
// Each is the mean, over 3 x 3 blocks, of the pixels' directions toward the later events among their neighbours:
// along an edge its normal, near a corner the motion itself.
// @param passed pixels (not 0) of one polarity: the other one is due to another edge, or to this one before it turned
// back
inline cv::Mat_<cv::Vec2f> motion_of_blocks(const cv::Mat_<std::uint8_t>& passed, const PolarityFrame& frame) {
  constexpr int kWindow = 3;       // [blocks]
  constexpr float kAgreed = 0.2f;  // least length of the mean; if pixels disagree, no direction beats a wrong one
  const auto length_of = [](float x, float y) { return std::sqrt(x * x + y * y); };
  const int width = passed.cols;
  const auto time = [&](int y, int x) { return frame.times()[static_cast<std::size_t>(y * width + x)]; };
  cv::Mat_<cv::Vec3f> sum((passed.rows + kBlock - 1) / kBlock, (width + kBlock - 1) / kBlock, cv::Vec3f(0, 0, 0));
  for (int y = 1; y + 1 < passed.rows; ++y)
    for (int x = 1; x + 1 < width; ++x) {
      if (!passed(y, x)) continue;
      cv::Vec2f later(0, 0);
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
          if (passed(y + dy, x + dx))
            later +=
                later_us(time(y + dy, x + dx), time(y, x)) * cv::Vec2f(static_cast<float>(dx), static_cast<float>(dy));
      const float length = length_of(later[0], later[1]);
      if (length > 0) sum(y / kBlock, x / kBlock) += cv::Vec3f(later[0] / length, later[1] / length, 1);
    }
  cv::blur(sum, sum, {kWindow, kWindow});
  cv::Mat_<cv::Vec2f> motion(sum.size(), cv::Vec2f(0, 0));
  std::transform(sum.begin(), sum.end(), motion.begin(), [&](const cv::Vec3f& s) {
    const float length = length_of(s[0], s[1]);
    return length > kAgreed * s[2] ? cv::Vec2f(s[0] / length, s[1] / length) : cv::Vec2f(0, 0);
  });
  return motion;
}

// Votes for a brightness of the unseen pixels that follow (x, y) in a direction, up to the first seen one. The vote
// gets weaker with the distance.
inline void cast_votes(const cv::Mat_<std::uint8_t>& seen, int x, int y, const cv::Vec2f& direction, float brightness,
                       int reach_px, cv::Mat_<float>& votes) {
  constexpr float kNear = 5;  // [px]
  for (int i = 1; i <= reach_px; ++i) {
    const int u = cvRound(static_cast<float>(x) + static_cast<float>(i) * direction[0]);
    const int v = cvRound(static_cast<float>(y) + static_cast<float>(i) * direction[1]);
    if (u < 0 || v < 0 || u >= seen.cols || v >= seen.rows || seen(v, u) != kUnseen) return;
    votes(v, u) += brightness / (kNear + static_cast<float>(i));
  }
}

}  // namespace detail

/// Reconstructs a black-and-white image from the last polarities: 255 bright, 0 dark, 128 unknown. The pixels that an
/// edge has swept have the brightness behind the edge. The unseen pixels ahead of it must have the opposite one, and
/// those behind the swept strip the same. The times of the events give the direction of motion. So a marker is seen
/// after a pixel of motion; the polarities alone show it only when the motion exceeds its largest plain area.
inline cv::Mat guess_image(const PolarityFrame& frame) {
  const SensorSize size = frame.sensor_size();
  const cv::Mat pixels(size.height, size.width, CV_8U,
                       const_cast<std::uint8_t*>(frame.pixels().data()));  // read only; cv::Mat has no const view
  const cv::Mat_<std::uint8_t> seen = detail::without_noise(pixels);
  const auto motion_of = [&](std::uint8_t polarity) {
    const cv::Mat passed = (seen == polarity) & (pixels == polarity);
    return detail::motion_of_blocks(passed, frame);
  };
  const cv::Mat_<cv::Vec2f> motion_on = motion_of(PolarityFrame::kOn), motion_off = motion_of(PolarityFrame::kOff);
  const int reach_px = std::max(size.width, size.height) / 5;  // half of the largest plain area that matters
  cv::Mat_<float> votes(seen.size(), 0.0f);
  for (int y = 0; y < seen.rows; ++y)
    for (int x = 0; x < seen.cols; ++x) {
      if (seen(y, x) == detail::kUnseen) continue;
      const bool on = seen(y, x) == PolarityFrame::kOn;
      const cv::Vec2f& direction = (on ? motion_on : motion_off)(y / detail::kBlock, x / detail::kBlock);
      if (direction == cv::Vec2f(0, 0)) continue;
      const float left_behind = on ? 1.0f : -1.0f;
      detail::cast_votes(seen, x, y, direction, -left_behind, reach_px, votes);
      detail::cast_votes(seen, x, y, -direction, left_behind, reach_px, votes);
    }
  cv::Mat_<std::uint8_t> image = seen.clone();
  for (int y = 0; y < seen.rows; ++y)
    for (int x = 0; x < seen.cols; ++x)
      if (votes(y, x) != 0) image(y, x) = votes(y, x) > 0 ? PolarityFrame::kOn : PolarityFrame::kOff;
  cv::medianBlur(image, image, 3);
  return image;
}

}  // namespace evmarker::opencv
