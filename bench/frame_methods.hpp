#pragma once
// The frame methods of the accuracy comparison, as usual with OpenCV: find corners, solve for the pose.
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "grey_camera.hpp"
#include "scenarios.hpp"
#include "verdict.hpp"

namespace evmarker::bench {

/// Corners of a marker in the (distorted) image, from its top left clockwise.
struct PlanarHypotheses {
  MarkerId id;
  std::array<cv::Point2d, 4> corners;
};

/// IPPE_SQUARE's better solution at the minimum of its reprojection error.
inline std::optional<Eigen::Isometry3d> solve_square(const PinholeCamera& camera, double length,
                                                     const std::array<cv::Point2d, 4>& corners) {
  const double h = length / 2;
  const std::vector<cv::Point3d> points{{-h, h, 0}, {h, h, 0}, {h, -h, 0}, {-h, -h, 0}};
  std::vector<cv::Point2d> undistorted;
  for (const cv::Point2d& corner : corners) {
    const Eigen::Vector3d M = camera.line_of_sight({corner.x, corner.y});
    if (!M.allFinite()) return std::nullopt;
    undistorted.emplace_back(M.x(), M.y());
  }
  const cv::Matx33d identity = cv::Matx33d::eye();
  cv::Vec3d r, t;
  if (!cv::solvePnP(points, undistorted, identity, cv::noArray(), r, t, false, cv::SOLVEPNP_IPPE_SQUARE))
    return std::nullopt;
  cv::solvePnPRefineLM(points, undistorted, identity, cv::noArray(), r, t);
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = so3_exp({r[0], r[1], r[2]});
  T.translation() << t[0], t[1], t[2];
  if (!T.matrix().allFinite() || !(t[2] > 0)) return std::nullopt;
  return T;
}

/// OpenCV's detector with its defaults and sub-pixel corners.
class Aruco {
 public:
  explicit Aruco(const Situation& situation) : dictionary_(opencv::make_dictionary(situation.dictionary)) {
    parameters_.cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
  }

  std::vector<PlanarHypotheses> find(const cv::Mat& image) const {
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    opencv::detail::detect_markers(image, dictionary_, parameters_, corners, ids);
    std::vector<PlanarHypotheses> found;
    for (std::size_t i = 0; i < ids.size(); ++i)
      found.push_back({ids[i], {corners[i][0], corners[i][1], corners[i][2], corners[i][3]}});
    return found;
  }

 private:
  cv::aruco::Dictionary dictionary_;
  cv::aruco::DetectorParameters parameters_;
};

inline void add_found(Run& run, const Situation& situation, Timestamp t, const std::vector<PlanarHypotheses>& found) {
  for (const PlanarHypotheses& marker : found)
    if (const auto T = solve_square(situation.camera, situation.marker_length(), marker.corners)) {
      PoseEstimate pose;
      pose.id = marker.id;
      pose.t = t;
      pose.T_camera_marker = *T;
      pose.quality.state = TrackingState::tracking;
      run.add(situation, pose);
    }
}

/// ArUco every 5 ms on the frame of the last polarities behind the noise filter, median 3x3.
inline Run aruco_on_polarity(const Situation& situation, const std::vector<Event>& events) {
  constexpr Timestamp kInterval = 5000;
  Run run(situation.scene.markers.size());
  run.pose_interval_us = kInterval;
  const SensorSize size = situation.camera.sensor_size();
  SpatiotemporalFilter filter(size);
  PolarityFrame frame(size);
  const Aruco aruco(situation);
  Timestamp next = kInterval;
  cv::Mat median;
  for (const Event& event : events) {
    for (; event.t >= next; next += kInterval) {
      const cv::Mat pixels(size.height, size.width, CV_8U, const_cast<std::uint8_t*>(frame.pixels().data()));
      cv::medianBlur(pixels, median, 3);
      add_found(run, situation, next, aruco.find(median));
    }
    if (filter.accept(event)) frame.update(event);
  }
  return run;
}

/// A detector on the images of a frame camera; a pose's time is the middle of the exposure.
/// @param stride only every stride-th image is made and used
template <typename Finder>
Run run_grey(const Situation& situation, const GreySettings& settings, int stride, const Finder& finder) {
  Run run(situation.scene.markers.size());
  run.pose_interval_us = 1e6 / settings.rate_hz * stride;
  GreyCamera camera(situation, settings);
  for (int i = 0;; i += stride) {
    const double middle_s = i / settings.rate_hz + settings.exposure_s / 2;
    if (middle_s + settings.exposure_s / 2 > situation.simulator.duration_s) return run;
    add_found(run, situation, static_cast<Timestamp>(std::llround(middle_s * 1e6)),
              finder.find(camera.image(middle_s)));
  }
}

}  // namespace evmarker::bench
