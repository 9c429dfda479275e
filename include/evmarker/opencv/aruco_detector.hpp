#pragma once
// Detector of ArUco and AprilTag markers in a frame of last polarities.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <map>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/planar_ambiguity.hpp"
#include "evmarker/opencv/aruco_detector_settings.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/opencv/code_book.hpp"
#include "evmarker/opencv/dark_quads.hpp"
#include "evmarker/opencv/frame_fit.hpp"
#include "evmarker/opencv/guessed_image.hpp"
#include "evmarker/opencv/planar_pnp.hpp"

namespace evmarker::opencv {

/// A `MarkerDetector` for the markers of OpenCV's ArUco dictionaries. Frames of last polarities are ragged and half
/// empty; OpenCV's own detector finds wrong ids in them, and corners with errors of pixels. This detector fits the pose
/// of every candidate to all edges of its code, and reports it only if the frame shows these edges and the cells of the
/// code there, and contradicts at most one edge. Copyable; not thread-safe.
template <CameraModel Camera>
class ArucoDetector {
 public:
  /// @throws std::invalid_argument naming an unknown dictionary, a marker length that is not positive, an id that the
  /// dictionary does not have, or a setting out of its range
  ArucoDetector(Camera camera, ArucoDetectorSettings settings)
      : camera_(std::move(camera)),
        settings_(std::move(settings)),
        dictionary_(make_dictionary(settings_.dictionary)),
        codes_(settings_.border_cells) {
    evmarker::detail::require_marker_length(settings_.marker_length);
    const Require require("detector");
    require(settings_.border_cells >= 1 && settings_.border_cells <= kMostBorderCells, "border_cells",
            settings_.border_cells);
    for (const MarkerId id : settings_.ids) require_known(id);
    for (const auto& [id, length] : settings_.lengths) {
      require_known(id);
      evmarker::detail::require_marker_length(length, (std::to_string(id) + " length").c_str());
    }
    const auto is_share = [](double value) { return value >= 0 && value <= 1; };
    require(settings_.min_side_px >= 4 && std::isfinite(settings_.min_side_px), "min_side_px", settings_.min_side_px);
    require(is_share(settings_.min_agreement), "min_agreement", settings_.min_agreement);
    require(is_share(settings_.min_edge_support), "min_edge_support", settings_.min_edge_support);
    require(settings_.max_alternative_ratio >= 0, "max_alternative_ratio", settings_.max_alternative_ratio);

    for (MarkerId id = 0; id < dictionary_size(dictionary_); ++id)
      if (is_wanted(id)) codes_.add(id, marker_bits(dictionary_, id));
  }

  /// The markers in a frame of the camera's size, each id at most once.
  /// @param tracked markers that are tracked already: no pose is fitted to those that are seen there
  /// @throws std::invalid_argument if the frame has another size
  std::vector<MarkerDetection> detect(const PolarityFrame& frame, std::span<const PlacedMarker> tracked = {}) {
    require_size(frame.sensor_size());
    image_ = guess_image(frame);
    t_ = frame.t();
    std::map<MarkerId, std::vector<CodeBook::Reading>> readings;  // several quadrilaterals may fit one outline
    const auto read_quads = [&](const cv::Mat& dark) {
      for (const DarkQuad& quad : find_dark_quads(dark, settings_.min_side_px))
        if (const auto reading = codes_.read(image_, quad)) readings[reading->id].push_back(*reading);
    };
    const cv::Mat dark = image_ == PolarityFrame::kOff;
    cv::Mat opened;  // without the thin lines of noise that may connect an outline to its surroundings
    cv::morphologyEx(dark, opened, cv::MORPH_OPEN, cv::Mat());
    read_quads(dark);
    read_quads(opened);

    std::vector<MarkerDetection> detections;
    for (auto& [id, readings_of_id] : readings) {
      const auto known = std::ranges::find(tracked, id, &PlacedMarker::id);
      if (known != tracked.end() && is_read_at(*known, readings_of_id))
        detections.push_back(make_detection(id, known->T_camera_marker));
      else if (const auto candidate = best_candidate(id, readings_of_id))
        detections.push_back(candidate->detection);
    }
    return detections;
  }

  /// True if the last frame given to `detect` shows most of a marker's code at a pose, and the opposite in no cell.
  bool shows(MarkerId id, const Eigen::Isometry3d& T_camera_marker) const {
    constexpr double kLeastAgreement = 0.75;
    const CodeReading code = read_code(camera_, image_, bits(id), settings_.length(id), T_camera_marker);
    return code.contradicted == 0 && code.agreement >= kLeastAgreement;
  }

  /// Searches the last frame given to `detect` for a marker near a pose; empty if it is not seen.
  std::optional<MarkerDetection> search(MarkerId id, const Eigen::Isometry3d& T_camera_marker) const {
    const auto fit = fit_pose(id, model(id), T_camera_marker);
    return fit && is_marker(id, *fit) ? std::optional(make_detection(id, fit->T_camera_marker)) : std::nullopt;
  }

  /// All markers that `detect` may find.
  std::vector<MarkerId> ids() const {
    if (!settings_.ids.empty()) return settings_.ids;
    std::vector<MarkerId> all(static_cast<std::size_t>(dictionary_size(dictionary_)));
    std::iota(all.begin(), all.end(), MarkerId(0));
    return all;
  }

  /// The code of a marker, with all of the black border around it but the outermost ring.
  /// @throws std::invalid_argument if the dictionary has no such id
  CodeBits bits(MarkerId id) const {
    return with_border(marker_bits(dictionary_, id, settings_.dictionary), settings_.border_cells);
  }

  /// The wireframe of a marker: its outline and the edges of its cells.
  /// @throws std::invalid_argument if the dictionary has no such id
  MarkerModel model(MarkerId id) const { return make_code_marker(settings_.length(id), bits(id)); }

  const ArucoDetectorSettings& settings() const noexcept { return settings_; }

 private:
  static constexpr double kGoodCost_px = 0.75;  // largest cost of a fit in which nearly all edges are right
  // One edge may be too weak for the sensor. More are contradicted where a pose is fitted to more than the marker, such
  // as to the marker and a dark rim beside it.
  static constexpr int kMostContradictedEdges = 1;

  struct Candidate {
    MarkerDetection detection;
    double cost_px;
  };

  // Fits poses to the clearest readings of a marker. Returns the best fit; empty if none is good enough.
  std::optional<Candidate> best_candidate(MarkerId id, std::vector<CodeBook::Reading>& readings) const {
    constexpr int kMostFitted = 3;
    std::ranges::stable_sort(readings, std::greater<>(), &CodeBook::Reading::clarity);
    std::optional<Candidate> best;
    int fitted = 0;
    for (auto reading = readings.begin(); reading != readings.end() && fitted < kMostFitted; ++reading) {
      const auto same = [&](const CodeBook::Reading& other) { return nearly_equal(reading->corners, other.corners); };
      if (std::any_of(readings.begin(), reading, same)) continue;
      ++fitted;
      const auto candidate = make_candidate(id, reading->corners);
      if (candidate && (!best || candidate->cost_px < best->cost_px)) best = candidate;
      if (best && best->cost_px < kGoodCost_px) break;  // no other reading is needed
    }
    return best;
  }

  // True if two quadrilaterals are so similar that a fit leads from both to the same pose.
  static bool nearly_equal(const Quad& a, const Quad& b) {
    constexpr double kSame_px = 2;
    double farthest = 0;
    for (std::size_t i = 0; i < 4; ++i) farthest = std::max(farthest, norm(a[i] - b[i]));
    return farthest < kSame_px;
  }

  // True if a marker is read so near to a pose that a fit would lead to it.
  bool is_read_at(const PlacedMarker& marker, const std::vector<CodeBook::Reading>& readings) const {
    const Quad corners = corners_px(marker.id, marker.T_camera_marker);
    return std::ranges::any_of(readings, [&](const auto& reading) { return nearly_equal(reading.corners, corners); });
  }

  // The corners of a marker in the distorted image, from its top left clockwise.
  Quad corners_px(MarkerId id, const Eigen::Isometry3d& T_camera_marker) const {
    const auto square = make_square_marker(settings_.length(id)).vertices;
    Quad corners;
    for (std::size_t i = 0; i < 4; ++i) corners[i] = detail::project(camera_, transform(T_camera_marker, square[i]));
    return corners;
  }

  // Throws if the dictionary has no such id.
  void require_known(MarkerId id) const { static_cast<void>(bits(id)); }

  void require_size(SensorSize size) const {
    const SensorSize expected = camera_.sensor_size();
    if (size == expected) return;
    const auto show = [](SensorSize s) { return std::to_string(s.width) + " x " + std::to_string(s.height); };
    throw std::invalid_argument("detector: frame is " + show(size) + " px, the camera " + show(expected) + " px");
  }

  bool is_wanted(MarkerId id) const {
    return settings_.ids.empty() || std::ranges::find(settings_.ids, id) != settings_.ids.end();
  }

  // Fits poses to the frame, starting from both planar solutions for the corners. Empty if the frame supports none.
  std::optional<Candidate> make_candidate(MarkerId id, const Quad& corners) const {
    const MarkerModel wireframe = model(id);
    std::vector<FrameFit> fits;
    const auto fit_from = [&](const Eigen::Isometry3d& T) {
      if (const auto fit = fit_pose(id, wireframe, T)) fits.push_back(*fit);
    };
    std::ranges::for_each(solve_planar_pnp(camera_, corners, settings_.length(id)), fit_from);
    if (fits.empty()) return std::nullopt;
    constexpr double kSamePose = 0.1;  // [rad]
    const auto differ = [&](const FrameFit& a, const FrameFit& b) {
      return geodesic_angle(a.T_camera_marker.linear(), b.T_camera_marker.linear()) > kSamePose;
    };
    // If the starts led to one pose only, try its mirror image.
    if (!differ(fits.front(), fits.back())) fit_from(mirrored(fits[0].T_camera_marker));
    std::ranges::sort(fits, {}, &FrameFit::cost_px);
    const auto fit = std::ranges::find_if(fits, [&](const FrameFit& any) { return is_marker(id, any); });
    if (fit == fits.end()) return std::nullopt;

    MarkerDetection detection = make_detection(id, fit->T_camera_marker);
    // That this is the marker does not say that this is the pose: of the other one, only the cost counts.
    const auto other = std::ranges::find_if(fits, [&](const FrameFit& any) { return differ(any, *fit); });
    // If only one of the two poses has been fitted, and badly, the other one may still be the true one.
    if (other != fits.end() && other->cost_px <= settings_.max_alternative_ratio * fit->cost_px)
      detection.T_camera_marker_alternative = other->T_camera_marker;
    else if (other == fits.end() && fit->cost_px > kGoodCost_px)
      detection.T_camera_marker_alternative = mirrored(fit->T_camera_marker);
    return Candidate{detection, fit->cost_px};
  }

  MarkerDetection make_detection(MarkerId id, const Eigen::Isometry3d& T_camera_marker) const {
    MarkerDetection detection;
    detection.id = id;
    detection.t = t_;
    detection.T_camera_marker = T_camera_marker;
    std::ranges::copy(corners_px(id, T_camera_marker), detection.corners_px.begin());
    return detection;
  }

  // How far to each side of an edge its step is searched [px]: less than the distance to the next edge of the code.
  double reach_px(MarkerId id, const Eigen::Isometry3d& T) const {
    const double marker_px = camera_.focal_length() * settings_.length(id) / translation(T).z;
    return std::clamp(0.4 * marker_px / (dictionary_.markerSize + 2 * settings_.border_cells), 1.5, 4.0);
  }

  // Fits a pose to the frame, starting from T.
  std::optional<FrameFit> fit_pose(MarkerId id, const MarkerModel& wireframe, const Eigen::Isometry3d& T) const {
    return fit_to_frame(camera_, image_, wireframe, T, reach_px(id, T));
  }

  // True if the frame shows enough of the marker's edges and code at a pose.
  bool is_marker(MarkerId id, const FrameFit& fit) const {
    if (fit.support < settings_.min_edge_support || fit.contradicted_edges > kMostContradictedEdges) return false;
    return read_code(camera_, image_, bits(id), settings_.length(id), fit.T_camera_marker).agreement >=
           settings_.min_agreement;
  }

  Camera camera_;
  ArucoDetectorSettings settings_;
  cv::aruco::Dictionary dictionary_;
  CodeBook codes_;
  cv::Mat image_;    // guessed from the last frame
  Timestamp t_ = 0;  // of the last frame
};

}  // namespace evmarker::opencv
