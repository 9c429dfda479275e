#pragma once
// A picture of a calibration: where the image was covered, how far off it is where, and where it is known worst.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdio>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "camera_fit.hpp"
#include "image_difference.hpp"

namespace detail {

// What the picture shows, in its last line, with an arrow of half a pixel of the sensor.
// @param px of the picture to a pixel of the sensor, for arrows
// @param worst_px how well the image is known where that is worst
inline void draw_legend(cv::Mat& picture, double px, const cv::Scalar& arrows, double worst_px) {
  const auto write = [&](const std::string& text, int x) {
    cv::putText(picture, text, {x, picture.rows - 9}, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(60), 1,
                cv::LINE_AA);
    return x + cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, 0.5, 1, nullptr).width + 8;
  };
  const int from = write("light: where corners were seen; arrows: mean of seen - calibrated,", 6);
  const int to = from + cvRound(px / 2);
  cv::arrowedLine(picture, {from, picture.rows - 13}, {to, picture.rows - 13}, arrows, 2, cv::LINE_AA, 0, 0.2);
  char end[80];
  std::snprintf(end, sizeof end, "= 0.5 px; circle: known worst, to %.2f px", worst_px);
  write(end, to + 8);
}

}  // namespace detail

/// Draws the pixels on which corners were seen, and over them, for each part of the image, the mean of how far from
/// there the calibration says they should be, as an arrow; the line below says how long that is. A circle is where the
/// calibration is the least certain.
/// @param sigma standard deviation of the image
inline cv::Mat draw_calibration(const std::vector<BoardCorners>& views, const CameraFit& fit,
                                const ImageDifference& sigma, LensModel model, evmarker::SensorSize size) {
  constexpr int kColumns = 16, kRows = 12, kText = 28;
  constexpr double kArrow = 100;  // of the picture's pixels to a pixel of the sensor
  const cv::Scalar red(40, 40, 200), green(40, 120, 40);
  const int zoom = std::max(1, 1280 / size.width);
  const auto place = [&](evmarker::Vec2 pixel) {
    return cv::Point(cvRound(zoom * (pixel.x + 0.5)), cvRound(zoom * (pixel.y + 0.5)));
  };
  cv::Mat picture(zoom * size.height + kText, zoom * size.width, CV_8UC3, cv::Scalar::all(255));
  struct Mean {
    evmarker::Vec2 at, off;
    int count = 0;
  };
  std::array<Mean, kColumns * kRows> means{};
  for (std::size_t view = 0; view < views.size(); ++view)
    for (const SeenMarker& seen : views[view].markers) {
      const Eigen::Matrix<double, 8, 1> projected =
          detail::project_marker(*seen.marker, fit.intrinsics.data(), fit.poses[view].data(), model).px +
          fit.errors.of(seen);
      for (std::size_t i = 0; i < 4; ++i) {
        const evmarker::Vec2 corner = seen.corners_px[i];
        const auto row = static_cast<Eigen::Index>(2 * i);
        cv::rectangle(picture, {zoom * cvRound(corner.x), zoom * cvRound(corner.y), zoom, zoom}, {225, 205, 180},
                      cv::FILLED);
        const int x = std::clamp(static_cast<int>(corner.x * kColumns / size.width), 0, kColumns - 1);
        const int y = std::clamp(static_cast<int>(corner.y * kRows / size.height), 0, kRows - 1);
        Mean& mean = means[static_cast<std::size_t>(kColumns * y + x)];
        mean.at = mean.at + corner;
        mean.off = mean.off + (corner - evmarker::Vec2(projected(row), projected(row + 1)));
        ++mean.count;
      }
    }
  for (const Mean& mean : means) {
    if (mean.count == 0) continue;
    const evmarker::Vec2 at = 1.0 / mean.count * mean.at, off = 1.0 / mean.count * mean.off;
    cv::arrowedLine(picture, place(at), place(at + kArrow / zoom * off), red, 2, cv::LINE_AA, 0, 0.2);
  }
  const std::size_t worst = sigma.worst();
  cv::Mat image = picture.rowRange(0, zoom * size.height);  // without the legend, into which a circle could reach
  cv::circle(image, place(evmarker::Vec2(ImageDifference::pixel(worst, size))), 60, green, 3, cv::LINE_AA);
  cv::rectangle(picture, {0, 0, picture.cols, zoom * size.height}, cv::Scalar::all(160));
  detail::draw_legend(picture, kArrow, red, sigma.px[worst]);
  return picture;
}
