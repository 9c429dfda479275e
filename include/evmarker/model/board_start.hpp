#pragma once
// Where the calibration of a board starts: rough places of its markers on it, and of the board in a view.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/base/median.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/model/board_adjustment.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/projection.hpp"

namespace evmarker {

/// The corners of a square marker in the undistorted image.
struct MarkerImage {
  double length;        ///< side of the square [m]
  double focal_length;  ///< [px]

  /// From the top left clockwise [px from the principal point].
  std::array<Vec2, 4> corners(const Eigen::Isometry3d& T_camera_marker) const {
    const double h = length / 2;
    std::array<Vec2, 4> image;
    std::size_t i = 0;
    for (const Vec3 corner : {Vec3(-h, h, 0), Vec3(h, h, 0), Vec3(h, -h, 0), Vec3(-h, -h, 0)})
      image[i++] = image_point(transform(T_camera_marker, corner), focal_length);
    return image;
  }

  /// How far the corners of a marker at one pose are from those at another in the image; the farthest of the four.
  double distance_px(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) const {
    const auto at_a = corners(a), at_b = corners(b);
    double farthest = 0;
    for (std::size_t i = 0; i < 4; ++i) farthest = std::max(farthest, norm(at_a[i] - at_b[i]));
    return farthest;
  }
};

/// Rough places of markers on a board, by the poses of two markers at a time that were seen together.
class BoardStart {
 public:
  using View = std::vector<MarkerSighting>;  ///< markers seen at one time
  /// How often two markers must have been seen together.
  static constexpr std::size_t kLeastViews = 20;

  /// @param ids of the markers, for errors; `ids` and `views` are used by the constructor only
  /// @throws std::runtime_error in one sentence if a marker was not seen together with others
  BoardStart(std::span<const MarkerId> ids, MarkerImage image, const std::vector<View>& views)
      : image_(image), markers_(place_markers(ids, views)) {}

  /// T_board_marker of each marker; the frame of the first is that of the board.
  const std::vector<Eigen::Isometry3d>& markers() const noexcept { return markers_; }

  /// T_camera_board of a view. Each of its markers implies one: that with the least sum of distances to all markers.
  Eigen::Isometry3d locate(const View& view) const {
    Eigen::Isometry3d best = Eigen::Isometry3d::Identity();
    double least = std::numeric_limits<double>::infinity();
    for (const MarkerSighting& by : view) {
      const Eigen::Isometry3d T = by.T_camera_marker * markers_[by.marker].inverse();
      double sum = 0;
      for (const MarkerSighting& other : view)
        sum += image_.distance_px(T * markers_[other.marker], other.T_camera_marker);
      if (sum < least) best = T;
      least = std::min(least, sum);
    }
    return best;
  }

 private:
  // How two markers lie to each other, by the poses in one view.
  struct Link {
    std::size_t from, to;
    Eigen::Isometry3d T_from_to;
  };

  static constexpr std::size_t kMostLinksTried = 40;

  // Places the markers one after the other, from the first on: next comes the one that was most often seen together
  // with one that has been placed.
  std::vector<Eigen::Isometry3d> place_markers(std::span<const MarkerId> ids, const std::vector<View>& views) const {
    std::vector<Eigen::Isometry3d> poses(ids.size(), Eigen::Isometry3d::Identity());
    std::vector<bool> placed(ids.size(), false);
    placed[0] = true;
    for (std::size_t count = 1; count < ids.size(); ++count) {
      std::vector<Link> best;
      for (std::size_t to = 0; to < ids.size(); ++to)
        for (std::size_t from = 0; from < ids.size(); ++from)
          if (placed[from] && !placed[to])
            if (auto found = links(views, from, to); found.size() > best.size()) best = std::move(found);
      if (best.size() < kLeastViews) throw std::runtime_error(unconnected(ids, views, placed));
      const Link& link = link_of_least_median_error(views, best);
      poses[link.to] = poses[link.from] * link.T_from_to;
      placed[link.to] = true;
    }
    return poses;
  }

  static const MarkerSighting* find(const View& view, std::size_t marker) {
    const auto found =
        std::ranges::find_if(view, [&](const MarkerSighting& sighting) { return sighting.marker == marker; });
    return found == view.end() ? nullptr : &*found;
  }

  static std::vector<Link> links(const std::vector<View>& views, std::size_t from, std::size_t to) {
    std::vector<Link> links;
    for (const View& view : views)
      if (const MarkerSighting* a = find(view, from), *b = find(view, to); a != nullptr && b != nullptr)
        links.push_back({from, to, a->T_camera_marker.inverse() * b->T_camera_marker});
    return links;
  }

  // Of links between the same two markers, at most kMostLinksTried of them, the one that predicts the second marker
  // with the least median error over all views: a mirrored tilt fits only the view that it is from.
  const Link& link_of_least_median_error(const std::vector<View>& views, const std::vector<Link>& links) const {
    const Link* best = nullptr;
    double least = std::numeric_limits<double>::infinity();
    const std::size_t every = (links.size() + kMostLinksTried - 1) / kMostLinksTried;
    for (std::size_t i = 0; i < links.size(); i += every) {
      std::vector<double> errors;
      for (const View& view : views)
        if (const MarkerSighting* a = find(view, links[i].from), *b = find(view, links[i].to);
            a != nullptr && b != nullptr)
          errors.push_back(image_.distance_px(a->T_camera_marker * links[i].T_from_to, b->T_camera_marker));
      const double error = median(std::move(errors));
      if (best == nullptr || error < least) {
        best = &links[i];
        least = error;
      }
    }
    return *best;
  }

  // The message that says which markers could not be placed.
  static std::string unconnected(std::span<const MarkerId> ids, const std::vector<View>& views,
                                 const std::vector<bool>& placed) {
    std::string names;
    for (std::size_t m = 0; m < ids.size(); ++m)
      if (!placed[m]) names += (names.empty() ? "" : ", ") + std::to_string(ids[m]);
    const bool one = std::ranges::count(placed, false) == 1;
    const bool seen = std::ranges::any_of(views, [&](const View& view) {
      return std::ranges::any_of(view, [&](const MarkerSighting& sighting) { return !placed[sighting.marker]; });
    });
    names = (one ? "marker " : "markers ") + names + (one ? " was " : " were ");
    const std::string how = seen ? "not tracked together with marker " + std::to_string(ids[0]) +
                                       ", or one that was, at " + std::to_string(kLeastViews) + " places"
                                 : "never tracked together with another one";
    return names + how + ": show them side by side for longer";
  }

  MarkerImage image_;
  std::vector<Eigen::Isometry3d> markers_;
};

}  // namespace evmarker
