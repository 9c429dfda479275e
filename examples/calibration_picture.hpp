#pragma once
// A picture of a calibration: where the image was covered, and how far off it is where.
#include <algorithm>
#include <array>
#include <cstddef>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "camera_fit.hpp"

/// Draws every corner that was seen as a dot, and over it, for each part of the image, the mean of how far from there
/// the calibration says it should be, as an arrow 100 times as long.
inline cv::Mat draw_calibration(const std::vector<BoardCorners>& views, const CameraFit& fit, LensModel model,
                                evmarker::SensorSize size) {
  constexpr int kColumns = 16, kRows = 12, kArrow = 100;
  const int zoom = std::max(1, 1280 / size.width);
  const auto place = [&](evmarker::Vec2 pixel) {
    return cv::Point(cvRound(zoom * (pixel.x + 0.5)), cvRound(zoom * (pixel.y + 0.5)));
  };
  cv::Mat picture(zoom * size.height + 24, zoom * size.width, CV_8UC3, cv::Scalar::all(255));
  struct Mean {
    evmarker::Vec2 at, off;
    int count = 0;
  };
  std::array<Mean, kColumns * kRows> means{};
  for (std::size_t view = 0; view < views.size(); ++view)
    for (const SeenMarker& seen : views[view].markers) {
      const auto projected =
          detail::project_marker(*seen.marker, fit.intrinsics.data(), fit.poses[view].data(), model).px;
      for (std::size_t i = 0; i < 4; ++i) {
        const evmarker::Vec2 corner = seen.corners_px[i];
        const auto row = static_cast<Eigen::Index>(2 * i);
        cv::circle(picture, place(corner), 1, {225, 205, 180}, cv::FILLED);
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
    cv::arrowedLine(picture, place(at), place(at + kArrow / double(zoom) * off), {40, 40, 200}, 2, cv::LINE_AA, 0, 0.2);
  }
  cv::rectangle(picture, {0, 0, picture.cols, zoom * size.height}, cv::Scalar::all(160));
  cv::putText(picture, "dots: corners seen; arrows: mean of seen - calibrated, " + std::to_string(kArrow) + " x",
              {6, picture.rows - 7}, cv::FONT_HERSHEY_SIMPLEX, 0.5, cv::Scalar::all(60), 1, cv::LINE_AA);
  return picture;
}
