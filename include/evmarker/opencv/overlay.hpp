#pragma once
// Drawing of events, markers and poses.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <ranges>
#include <stdexcept>
#include <string>

#include "evmarker/base/require.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"

namespace evmarker::opencv {

/// Colours (blue, green, red) of events, markers and text on a dark background.
namespace color {
inline const cv::Scalar kGround(28, 24, 22);
inline const cv::Scalar kOn(178, 138, 84);
inline const cv::Scalar kOff(84, 72, 150);
inline const cv::Scalar kConverging(60, 190, 255);
inline const cv::Scalar kTracking(100, 255, 110);
inline const cv::Scalar kLost(90, 90, 255);
inline const cv::Scalar kText(240, 240, 240);
}  // namespace color

/// The colour of a marker in a tracking state.
inline cv::Scalar state_color(TrackingState state) {
  switch (state) {
    case TrackingState::converging: return color::kConverging;
    case TrackingState::tracking: return color::kTracking;
    case TrackingState::lost: return color::kLost;
  }
  return color::kText;
}

namespace detail {

constexpr int kSubpixelBits = 4;

// A sensor pixel in a picture that is `scale` times larger, as a fixed-point coordinate with kSubpixelBits for OpenCV.
// Integers are centres of pixels, so that pixel 0 does not stay at 0.
inline cv::Point fixed_point(const Eigen::Vector2d& pixel, double scale) {
  const auto fixed = [&](double v) {
    const double limited = std::clamp((v + 0.5) * scale - 0.5, -20000.0, 20000.0);
    return static_cast<int>(std::lround(limited * (1 << kSubpixelBits)));
  };
  return {fixed(pixel.x()), fixed(pixel.y())};
}

// Picture pixels per sensor pixel; throws std::invalid_argument if the picture does not fit the camera.
template <CameraModel Camera>
double scale_of(const cv::Mat& picture, const Camera& camera) {
  const SensorSize size = camera.sensor_size();
  if (picture.type() != CV_8UC3 || picture.empty() || picture.cols * size.height != picture.rows * size.width)
    throw std::invalid_argument("overlay: a picture of " + std::to_string(picture.cols) + " x " +
                                std::to_string(picture.rows) + " px is not an 8-bit colour picture of a camera of " +
                                std::to_string(size.width) + " x " + std::to_string(size.height) + " px");
  return static_cast<double>(picture.cols) / size.width;
}

// Draws an edge [m, camera frame] in pieces, as a straight edge is a curve behind a lens.
template <CameraModel Camera>
void draw_edge(cv::Mat& picture, const Camera& camera, const Eigen::Vector3d& from, const Eigen::Vector3d& to,
               const cv::Scalar& edge_color, int thickness, double scale) {
  constexpr int kPieces = 8;
  constexpr double kNearest = 1e-3;  // [m] in front of the camera: no closer piece is drawn
  for (int i = 0; i < kPieces; ++i) {
    const Eigen::Vector3d a = from + (to - from) * (static_cast<double>(i) / kPieces);
    const Eigen::Vector3d b = from + (to - from) * (static_cast<double>(i + 1) / kPieces);
    if (!(a.z() > kNearest && b.z() > kNearest)) continue;
    const Eigen::Vector2d p = camera.project(a), q = camera.project(b);
    if (!p.allFinite() || !q.allFinite()) continue;
    cv::line(picture, fixed_point(p, scale), fixed_point(q, scale), edge_color, thickness, cv::LINE_AA, kSubpixelBits);
  }
}

inline double text_scale(const cv::Mat& picture) { return std::clamp(picture.cols / 1600.0, 0.4, 1.5); }

inline int line_width(const cv::Mat& picture) { return std::clamp(picture.cols / 450, 1, 3); }

inline cv::Size text_size(const cv::Mat& picture, const std::string& text) {
  int below = 0;
  const cv::Size size =
      cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, text_scale(picture), line_width(picture), &below);
  return {size.width, size.height + below};
}

}  // namespace detail

/// Draws text on a dark rectangle, so that it is legible over events.
/// @param at top left corner of the rectangle [px of the picture]
inline void draw_text(cv::Mat& picture, const std::string& text, cv::Point at, const cv::Scalar& text_color) {
  const cv::Size size = detail::text_size(picture, text);
  cv::rectangle(picture, {at.x, at.y, size.width + 8, size.height + 6}, color::kGround, cv::FILLED);
  cv::putText(picture, text, {at.x + 4, at.y + 1 + size.height * 4 / 5}, cv::FONT_HERSHEY_SIMPLEX,
              detail::text_scale(picture), text_color, detail::line_width(picture), cv::LINE_AA);
}

/// Draws lines of text in the picture's top left corner.
/// @returns y below them [px of the picture]
template <std::ranges::input_range Lines>
int draw_lines_of_text(cv::Mat& picture, const Lines& lines) {
  int y = 8;
  for (const std::string& line : lines) {
    draw_text(picture, line, {8, y}, color::kText);
    y += detail::text_size(picture, line).height + 6;
  }
  return y;
}

/// An empty dark picture with `scale` picture pixels to a sensor pixel, along each axis.
/// @throws std::invalid_argument if the size or the scale is not positive
inline cv::Mat make_picture(SensorSize size, int scale = 1) {
  if (size.width < 1 || size.height < 1 || scale < 1)
    throw std::invalid_argument("overlay: no picture of " + std::to_string(size.width) + " x " +
                                std::to_string(size.height) + " px at scale " + number_text(scale));
  return cv::Mat(size.height * scale, size.width * scale, CV_8UC3, color::kGround);
}

/// A picture of the frame of last polarities, with `scale` picture pixels to a sensor pixel, along each axis.
/// @param fade age at which an event has faded into the background; zero: events do not fade
/// @throws std::invalid_argument if the scale is not positive
inline cv::Mat draw_frame(const PolarityFrame& frame, int scale = 1, std::chrono::microseconds fade = {}) {
  const SensorSize size = frame.sensor_size();
  cv::Mat enlarged = make_picture(size, scale), picture = make_picture(size);
  constexpr std::uint32_t kShades = 64;
  std::array<std::array<cv::Vec3b, kShades>, 2> shades;  // of OFF and ON, by age [lifetime / kShades]
  for (std::uint32_t age = 0; age < kShades; ++age) {
    const double left = std::pow(1 - static_cast<double>(age) / kShades, 2);  // squared: the newest edge stands out
    const auto shade = [&](const cv::Scalar& c) {
      const cv::Scalar mixed = left * c + (1 - left) * color::kGround;
      return cv::Vec3b(cv::Vec4b(mixed).val);
    };
    shades[0][age] = shade(color::kOff);
    shades[1][age] = shade(color::kOn);
  }
  const auto newest = static_cast<std::uint32_t>(frame.t());  // with times of 32 bits, ages are right to 35 minutes
  const auto lifetime = static_cast<std::uint64_t>(std::max<std::int64_t>(fade.count(), 0));
  auto pixel = frame.pixels().begin();
  auto time = frame.times().begin();
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x, ++pixel, ++time) {
      if (*pixel == PolarityFrame::kUntouched) continue;
      const auto later = static_cast<std::int32_t>(newest - *time);  // negative where recordings step back
      const auto age_us = static_cast<std::uint64_t>(std::max(later, 0));
      const std::uint64_t age = lifetime == 0 ? 0 : age_us * kShades / lifetime;
      if (age < kShades) picture.at<cv::Vec3b>(y, x) = shades[*pixel == PolarityFrame::kOn ? 1 : 0][age];
    }
  cv::resize(picture, enlarged, enlarged.size(), 0, 0, cv::INTER_NEAREST);
  return enlarged;
}

/// Draws events into a picture from `make_picture`, except those off the sensor.
/// @throws std::invalid_argument if the picture is no colour picture of a multiple of the sensor's size
template <std::ranges::input_range Events>
requires EventLike<std::ranges::range_value_t<Events>>
void draw_events(cv::Mat& picture, SensorSize size, const Events& events) {
  if (size.width < 1 || picture.type() != CV_8UC3 || picture.cols % size.width != 0 ||
      picture.cols / size.width * size.height != picture.rows)
    throw std::invalid_argument("overlay: the picture is no multiple of the sensor's size");
  const int scale = picture.cols / size.width;
  using Traits = EventTraits<std::ranges::range_value_t<Events>>;
  for (const auto& event : events)
    if (const int x = Traits::x(event), y = Traits::y(event); size.contains(x, y))
      picture(cv::Rect(x * scale, y * scale, scale, scale)).setTo(Traits::on(event) ? color::kOn : color::kOff);
}

/// Draws the edges of a model at a pose, through the camera's lens, except those on faces turned away from the camera.
/// @throws std::invalid_argument if the picture is no 8-bit colour picture of the camera's shape
template <CameraModel Camera>
void draw_wireframe(cv::Mat& picture, const Camera& camera, const MarkerModel& model,
                    const Eigen::Isometry3d& T_camera_marker, const cv::Scalar& edge_color, int thickness = 1) {
  const double scale = detail::scale_of(picture, camera);
  for (const MarkerSegment& segment : model.segments) {
    const Eigen::Vector3d from = T_camera_marker * model.vertices.at(static_cast<std::size_t>(segment.from));
    const Eigen::Vector3d to = T_camera_marker * model.vertices.at(static_cast<std::size_t>(segment.to));
    if (faces_camera(segment, from, T_camera_marker))
      detail::draw_edge(picture, camera, from, to, edge_color, thickness, scale);
  }
}

/// Draws the marker's axes: x red, y green, z (out of the marker) blue, each `length` [m] long.
/// @throws std::invalid_argument if the picture is no 8-bit colour picture of the camera's shape
template <CameraModel Camera>
void draw_axes(cv::Mat& picture, const Camera& camera, const Eigen::Isometry3d& T_camera_marker, double length) {
  const double scale = detail::scale_of(picture, camera);
  const std::array<cv::Scalar, 3> colors{cv::Scalar(60, 60, 255), cv::Scalar(80, 220, 80), cv::Scalar(255, 130, 70)};
  for (int axis = 0; axis < 3; ++axis)
    detail::draw_edge(picture, camera, T_camera_marker.translation(),
                      T_camera_marker * (length * Eigen::Vector3d::Unit(axis)), colors[static_cast<std::size_t>(axis)],
                      2 * detail::line_width(picture) + 1, scale);
}

/// Draws a tracked marker: its edges in the colour of its state, its axes, and beside it its id, its state and a note.
/// @param text_top least y of this text, which then lies below others [px of the picture]
/// @throws std::invalid_argument if the picture is no 8-bit colour picture of the camera's shape
template <CameraModel Camera>
void draw_marker(cv::Mat& picture, const Camera& camera, const MarkerModel& model, const PoseEstimate& pose,
                 const std::string& note = "", int text_top = 0) {
  const Eigen::Isometry3d& T = pose.T_camera_marker;
  const double scale = detail::scale_of(picture, camera);
  const cv::Scalar shade = state_color(pose.quality.state);
  draw_wireframe(picture, camera, model, T, shade, detail::line_width(picture));
  double radius = 0;
  Eigen::Vector2d left_end(1e9, 0), right_end(-1e9, 0);
  for (const Eigen::Vector3d& vertex : model.vertices) {
    radius = std::max(radius, vertex.norm());
    const Eigen::Vector3d P = T * vertex;
    if (!(P.z() > 1e-3)) continue;
    const Eigen::Vector2d p = camera.project(P);
    if (p.allFinite() && p.x() > right_end.x()) right_end = p;
    if (p.allFinite() && p.x() < left_end.x()) left_end = p;
  }
  draw_axes(picture, camera, T, radius / 2);
  if (right_end.x() < -1e8) return;
  const std::string label =
      "id " + std::to_string(pose.id) + " " + to_string(pose.quality.state) + (note.empty() ? "" : "  " + note);
  const cv::Size text = detail::text_size(picture, label);
  const auto inside = [](double v, int least, int most) {
    return static_cast<int>(std::lround(std::clamp(v, 1.0 * least, 1.0 * std::max(least, most))));
  };
  // Right of the marker, or left of it where there is no room.
  constexpr double kGap_px = 10;
  double x = (right_end.x() + kGap_px) * scale;
  const bool fits = x + text.width + 8 <= picture.cols;
  if (!fits) x = (left_end.x() - kGap_px) * scale - text.width - 8;
  draw_text(
      picture, label,
      {inside(x, 0, picture.cols - text.width - 8),
       inside((fits ? right_end : left_end).y() * scale - text.height / 2.0, text_top, picture.rows - text.height - 6)},
      shade);
}

}  // namespace evmarker::opencv
