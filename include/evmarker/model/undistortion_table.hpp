#pragma once
// A table of the lines of sight of all pixels: a look-up for each event in place of a computation.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/require.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// Lines of sight of a camera as a table: (X/Z, Y/Z) for every pixel, lens distortion removed. Copies share the table.
class UndistortionTable {
 public:
  /// @throws std::invalid_argument naming the sensor size or focal length that is not valid
  template <CameraModel Camera>
  explicit UndistortionTable(const Camera& camera)
      : size_(camera.sensor_size()), focal_length_(static_cast<double>(camera.focal_length())) {
    if (size_.width < 1 || size_.height < 1)
      throw std::invalid_argument("camera: sensor size is " + std::to_string(size_.width) + " x " +
                                  std::to_string(size_.height));
    if (!(std::isfinite(focal_length_) && focal_length_ > 0))
      throw std::invalid_argument("camera: focal length is " + number_text(focal_length_));
    auto lines = std::make_shared<std::vector<Line>>();
    lines->reserve(static_cast<std::size_t>(size_.width) * static_cast<std::size_t>(size_.height));
    for (int y = 0; y < size_.height; ++y)
      for (int x = 0; x < size_.width; ++x) {
        const Vec2 m = on_plane(Eigen::Vector3d(camera.line_of_sight(Eigen::Vector2d(x, y))));
        lines->push_back({static_cast<float>(m.x), static_cast<float>(m.y)});
        if (const Vec2 line{lines->back().x, lines->back().y}; is_finite(line)) {
          image_.extend(line);
          keep_inside_of_border(x, y, line);
        }
      }
    inner_image_ = inner_image_.intersection(image_);  // where a whole side of the border has no lines of sight
    lines_ = std::move(lines);
  }

  SensorSize sensor_size() const noexcept { return size_; }
  /// Pixels per unit of tangent.
  double focal_length() const noexcept { return focal_length_; }

  /// The smallest box that contains all lines of sight (X/Z, Y/Z) that exist; empty if none does.
  const Box& image() const noexcept { return image_; }

  /// The largest box of lines of sight that the sensor's border does not cross: what is in it is in the image.
  const Box& inner_image() const noexcept { return inner_image_; }

  /// Line of sight m = (X/Z, Y/Z) of an event, which must lie on the sensor: M = (m; 1) of Eq. (2) of the paper. NaN
  /// where the lens model has no inverse.
  Vec2 operator()(const Event& event) const noexcept {
    const Line& line = (*lines_)[pixel(event)];
    return {line.x, line.y};
  }

  /// Prefetches the memory for the line of sight of an event, which must lie on the sensor.
  void prefetch(const Event& event) const noexcept { __builtin_prefetch(&(*lines_)[pixel(event)]); }

  /// A line of sight that matches no marker: NaN.
  static constexpr Vec2 nowhere() noexcept {
    return {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::quiet_NaN()};
  }

 private:
  struct Line {
    float x, y;
  };

  // Cuts off of inner_image_ what lies beyond a pixel of the border.
  void keep_inside_of_border(int x, int y, Vec2 line) noexcept {
    if (x == 0) inner_image_.low.x = std::max(inner_image_.low.x, line.x);
    if (y == 0) inner_image_.low.y = std::max(inner_image_.low.y, line.y);
    if (x == size_.width - 1) inner_image_.high.x = std::min(inner_image_.high.x, line.x);
    if (y == size_.height - 1) inner_image_.high.y = std::min(inner_image_.high.y, line.y);
  }

  std::size_t pixel(const Event& event) const noexcept {
    return static_cast<std::size_t>(event.y) * static_cast<std::size_t>(size_.width) + event.x;
  }

  SensorSize size_;
  double focal_length_;
  Box image_, inner_image_ = Box::everywhere();
  std::shared_ptr<const std::vector<Line>> lines_;
};

}  // namespace evmarker
