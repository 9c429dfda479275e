#pragma once
// The image behind a frame of last polarities, guessed where no edge has passed yet.
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

// The last polarities without the noise, which would cast votes, too: a pixel keeps its polarity if two neighbours
// share it (the edge of a slow marker is a thin line), and takes the one that most of its neighbours have.
inline cv::Mat_<std::uint8_t> without_noise(const cv::Mat& pixels) {
  constexpr int kMost = 5, kLine = 3;  // of the 3x3 pixels
  const auto count = [&](std::uint8_t polarity) {
    cv::Mat_<std::uint8_t> sum;
    cv::boxFilter((pixels == polarity) / 255, sum, CV_8U, {3, 3}, {-1, -1}, false, cv::BORDER_CONSTANT);
    return sum;
  };
  const cv::Mat_<std::uint8_t> on = count(PolarityFrame::kOn), off = count(PolarityFrame::kOff);
  cv::Mat_<std::uint8_t> seen(pixels.size(), kUnseen);
  seen.setTo(PolarityFrame::kOn, (on >= kMost) | ((pixels == PolarityFrame::kOn) & (on >= kLine) & (off < kMost)));
  seen.setTo(PolarityFrame::kOff, (off >= kMost) | ((pixels == PolarityFrame::kOff) & (off >= kLine) & (on < kMost)));
  return seen;
}

// Low bits of two times, nearer than half an hour: how much later the first is [us].
inline float later_us(std::uint32_t a, std::uint32_t b) {
  constexpr float kAnotherPassage = 20000;  // [us]: two edges that passed at different times have no common direction
  return std::clamp(static_cast<float>(static_cast<std::int32_t>(a - b)), -kAnotherPassage, kAnotherPassage);
}

// Where the edges are going that left their polarity in these pixels: unit vectors toward the later events around each
// of them, averaged over four pixels to each side; one for every block. Averaged along an edge it is the edge's normal,
// near a corner the motion itself. Only among pixels of one polarity: the other one was left by another edge, or by
// this one before it turned back.
inline cv::Mat_<cv::Vec2f> motion_of_blocks(const cv::Mat_<std::uint8_t>& left, const PolarityFrame& frame) {
  constexpr int kWindow = 3;       // [blocks]
  constexpr float kAgreed = 0.2f;  // where the events do not agree, no direction is better than a wrong one
  const auto length_of = [](float x, float y) { return std::sqrt(x * x + y * y); };
  const int width = left.cols;
  const auto time = [&](int y, int x) { return frame.times()[static_cast<std::size_t>(y * width + x)]; };
  cv::Mat_<cv::Vec3f> sum((left.rows + kBlock - 1) / kBlock, (width + kBlock - 1) / kBlock, cv::Vec3f(0, 0, 0));
  for (int y = 1; y + 1 < left.rows; ++y)
    for (int x = 1; x + 1 < width; ++x) {
      if (!left(y, x)) continue;
      cv::Vec2f later(0, 0);
      for (int dy = -1; dy <= 1; ++dy)
        for (int dx = -1; dx <= 1; ++dx)
          if (left(y + dy, x + dx))
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

// Casts a vote for a brightness over the unseen pixels that follow from (x, y) in a direction; near ones count more.
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

/// The black-and-white image that the last polarities stand for: 255 bright, 0 dark, 128 unknown. The pixels that an
/// edge has swept show what it left behind it; ahead of it, where nothing happened yet, it must be the opposite, and
/// before the place where the edge came from, the same. The times decide which end of the swept strip is which. So a
/// marker is seen after a pixel of motion, while the polarities alone show it only when the motion exceeds its largest
/// plain area.
inline cv::Mat guess_image(const PolarityFrame& frame) {
  const SensorSize size = frame.sensor_size();
  const cv::Mat pixels(size.height, size.width, CV_8U,
                       const_cast<std::uint8_t*>(frame.pixels().data()));  // read only; cv::Mat has no const view
  const cv::Mat_<std::uint8_t> seen = detail::without_noise(pixels);
  const auto motion_of = [&](std::uint8_t polarity) {
    const cv::Mat left = (seen == polarity) & (pixels == polarity);
    return detail::motion_of_blocks(left, frame);
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
