#pragma once
// How far apart in the image two calibrations of one camera are.
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cstddef>
#include <evmarker/evmarker.hpp>
#include <string>
#include <vector>

/// Distances between where two calibrations of one camera see the same directions, all over the sensor.
struct ImageDifference {
  static constexpr int kColumns = 9, kRows = 7;  ///< of points, from the upper left corner to the lower right one
  std::array<double, kColumns * kRows> px{};

  double mean() const {
    double sum = 0;
    for (const double distance : px) sum += distance;
    return sum / static_cast<double>(px.size());
  }

  /// The point where the distance is greatest.
  std::size_t worst() const { return static_cast<std::size_t>(std::ranges::max_element(px) - px.begin()); }

  static Eigen::Vector2d pixel(std::size_t point, evmarker::SensorSize size) {
    return {static_cast<double>(point % kColumns) * (size.width - 1.0) / (kColumns - 1),
            static_cast<double>(point / kColumns) * (size.height - 1.0) / (kRows - 1)};
  }

  /// As "upper left".
  static std::string name_of(std::size_t point) {
    const auto third = [](std::size_t i, int count) { return 3 * static_cast<int>(i) / count; };
    const std::size_t row = point / kColumns, column = point % kColumns;
    const std::array rows{"upper ", "", "lower "}, columns{"left", "middle", "right"};
    const std::string name = std::string(rows[static_cast<std::size_t>(third(row, kRows))]) +
                             columns[static_cast<std::size_t>(third(column, kColumns))];
    return name;
  }
};

/// The camera's axes are no part of its calibration: it is turned so that the differences are least.
inline ImageDifference image_difference(const evmarker::PinholeCamera& a, const evmarker::PinholeCamera& b) {
  const evmarker::SensorSize size = a.sensor_size();
  std::vector<Eigen::Vector2d> pixels;
  std::vector<Eigen::Vector3d> directions;
  for (std::size_t point = 0; point < ImageDifference{}.px.size(); ++point) {
    pixels.push_back(ImageDifference::pixel(point, size));
    directions.push_back(a.line_of_sight(pixels.back()));
  }
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  ImageDifference difference;
  for (int iteration = 0; iteration < 8; ++iteration) {
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      constexpr double kStep = 1e-6;
      const Eigen::Vector2d there = b.project(R * directions[i]), residual = pixels[i] - there;
      difference.px[i] = residual.norm();
      Eigen::Matrix<double, 2, 3> J;
      for (int k = 0; k < 3; ++k)
        J.col(k) = (b.project(evmarker::so3_exp(kStep * Eigen::Vector3d::Unit(k)) * R * directions[i]) - there) / kStep;
      if (!residual.allFinite() || !J.allFinite()) continue;  // one of them has no line of sight there
      H += J.transpose() * J;
      g += J.transpose() * residual;
    }
    R = evmarker::so3_exp(Eigen::Vector3d(H.ldlt().solve(g))) * R;
  }
  return difference;
}
