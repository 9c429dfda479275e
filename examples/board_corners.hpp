#pragma once
// Where a recording shows the markers of a board in the image, at many instants.
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <utility>
#include <vector>

/// A marker as it is seen at an instant.
struct SeenMarker {
  const evmarker::BoardMarker* marker = nullptr;
  std::array<evmarker::Vec2, 4> corners_px;  ///< in the distorted image, from the marker's top left clockwise
  std::array<evmarker::Vec2, 4> px_per_s{};  ///< of the corners, once `measure_velocities` has been called
};

/// A view of a board: its markers that are tracked at an instant.
struct BoardCorners {
  evmarker::Timestamp t = 0;
  std::vector<SeenMarker> markers;
};

/// The corners of a marker [m, board frame].
/// @param pitch scale of the distances between the markers
inline std::array<evmarker::Vec3, 4> corners_of(const evmarker::BoardMarker& marker, double pitch) {
  const auto square = evmarker::make_square_marker(marker.length).vertices;
  const evmarker::Vec3 shift = (pitch - 1) * evmarker::translation(marker.T_board_marker);
  std::array<evmarker::Vec3, 4> corners;
  for (std::size_t i = 0; i < 4; ++i) corners[i] = evmarker::transform(marker.T_board_marker, square[i]) + shift;
  return corners;
}

/// Follows every marker of a board by itself: then each is seen where its own edges are, although the camera is not
/// known yet. A marker is small, and the edges of a small square fit nearly anywhere in the image of any lens; those of
/// a whole board do not.
class MarkerFollower {
 public:
  static constexpr evmarker::Timestamp kInterval_us = 10000;  ///< between views

  /// @param camera as far as it is known
  MarkerFollower(const evmarker::PinholeCamera& camera, const evmarker::Board& board, const std::string& dictionary,
                 int border_cells)
      : camera_(camera),
        board_(board),
        tracker_(camera, {camera, detector_settings(board, dictionary, border_cells)}, tracker_settings()) {}

  /// Takes events, and adds a view to `views` every `kInterval_us`.
  void push(std::span<const evmarker::Event> events, std::vector<BoardCorners>& views) {
    while (!events.empty()) {
      if (next_t_ == kNone) next_t_ = events.front().t + kInterval_us;
      const auto end = std::ranges::find_if(events, [&](const auto& event) { return event.t >= next_t_; });
      const auto before = events.first(static_cast<std::size_t>(end - events.begin()));
      tracker_.push(before, [](const evmarker::PoseEstimate&) {});
      events = events.subspan(before.size());
      if (events.empty()) return;
      if (BoardCorners view = view_at(next_t_); !view.markers.empty()) views.push_back(std::move(view));
      next_t_ = events.front().t + kInterval_us - (events.front().t - next_t_) % kInterval_us;
    }
  }

 private:
  static constexpr evmarker::Timestamp kNone = std::numeric_limits<evmarker::Timestamp>::min();

  static evmarker::opencv::ArucoDetectorSettings detector_settings(const evmarker::Board& board,
                                                                   const std::string& dictionary, int border_cells) {
    evmarker::opencv::ArucoDetectorSettings settings{.dictionary = dictionary, .border_cells = border_cells};
    for (const evmarker::BoardMarker& marker : board.markers) {
      settings.ids.push_back(marker.id);
      settings.lengths.emplace(marker.id, marker.length);
    }
    return settings;
  }

  // How far events trail behind their edges is not estimated: the estimates of small markers err by more than the
  // trail. Left alone it is nearly the same for all, as a delay, which moves the board along its path but not the lens.
  static evmarker::TrackerSettings<> tracker_settings() {
    evmarker::TrackerSettings<> settings;
    settings.marker.update.initial_sigma_trail_px = 1e-4;
    return settings;
  }

  BoardCorners view_at(evmarker::Timestamp t) const {
    BoardCorners view{t, {}};
    for (const auto& tracked : tracker_.markers()) {
      if (tracked.state() != evmarker::TrackingState::tracking) continue;
      const auto marker = std::ranges::find(board_.markers, tracked.id(), &evmarker::BoardMarker::id);
      const Eigen::Isometry3d T = tracked.pose_at(t).T_camera_marker;
      const auto square = evmarker::make_square_marker(marker->length).vertices;
      SeenMarker seen{&*marker, {}, {}};
      for (std::size_t i = 0; i < 4; ++i) seen.corners_px[i] = Eigen::Vector2d(camera_.project(T * square[i]));
      if (is_resolved(seen) && is_inside(seen)) view.markers.push_back(seen);
    }
    return view;
  }

  // False if the edges of the marker's cells are so near to each other in the image that events of one may be taken for
  // another's: then the marker may slip by a cell.
  static bool is_resolved(const SeenMarker& seen) {
    constexpr double kLeastCell_px = 2.5;
    const double cells = static_cast<double>(seen.marker->bits.rows() + 2);
    double shortest = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < 4; ++i)
      shortest = std::min(shortest, norm(seen.corners_px[i] - seen.corners_px[(i + 1) % 4]));
    return shortest >= kLeastCell_px * cells;
  }

  // False if a corner is outside the image: its place is concluded from the others.
  bool is_inside(const SeenMarker& seen) const {
    const evmarker::SensorSize size = camera_.sensor_size();
    return std::ranges::all_of(seen.corners_px, [&](evmarker::Vec2 corner) {
      return corner.x >= 0 && corner.y >= 0 && corner.x <= size.width - 1 && corner.y <= size.height - 1;
    });
  }

  evmarker::PinholeCamera camera_;
  const evmarker::Board& board_;
  evmarker::Tracker<evmarker::opencv::ArucoDetector<evmarker::PinholeCamera>> tracker_;
  evmarker::Timestamp next_t_ = kNone;
};

inline constexpr std::size_t kFewestMarkers = 4;  ///< of a view that tells of the camera

/// How many views have so many markers or more.
inline std::size_t with_enough_markers(const std::vector<BoardCorners>& views) {
  return static_cast<std::size_t>(
      std::ranges::count_if(views, [](const BoardCorners& view) { return view.markers.size() >= kFewestMarkers; }));
}

/// Drops markers that are not where the others of a view say, and views of less than four: a marker may have been taken
/// for its neighbour. By the homography of the flat board, after the lens as far as it is known.
/// @param pitch scale of the distances between the markers
/// @param tolerance_px how far a corner may be off
inline void drop_outliers(std::vector<BoardCorners>& views, const evmarker::PinholeCamera& camera, double pitch,
                          double tolerance_px) {
  for (BoardCorners& view : views) {
    std::vector<cv::Point2d> on_board, in_image;
    for (const SeenMarker& seen : view.markers)
      for (std::size_t i = 0; const evmarker::Vec3 corner : corners_of(*seen.marker, pitch)) {
        const evmarker::Vec2 m = on_plane(evmarker::Vec3(camera.line_of_sight(seen.corners_px[i++])));
        on_board.emplace_back(corner.x, corner.y);
        in_image.emplace_back(camera.focal_length() * m.x, camera.focal_length() * m.y);
      }
    std::vector<uchar> fits(on_board.size());
    if (view.markers.size() >= kFewestMarkers) cv::findHomography(on_board, in_image, cv::RANSAC, tolerance_px, fits);
    std::size_t number = 0;
    std::erase_if(view.markers, [&](const SeenMarker&) {
      const auto first = fits.begin() + static_cast<std::ptrdiff_t>(4 * number++);
      return std::find(first, first + 4, 0) != first + 4;
    });
  }
  std::erase_if(views, [](const BoardCorners& view) { return view.markers.size() < kFewestMarkers; });
}

namespace detail {

// The image of a plane moves by eight numbers (Longuet-Higgins): a field of that form through the velocities of all
// corners has less noise than each.
inline void smooth_velocities(BoardCorners& view) {
  constexpr double kUnit_px = 100;  // of about the size of a board, so that the equations are well conditioned
  const auto rows = static_cast<Eigen::Index>(8 * view.markers.size());
  Eigen::Matrix<double, Eigen::Dynamic, 8> field(rows, 8);
  Eigen::VectorXd px_per_s(rows);
  const evmarker::Vec2 origin = view.markers[0].corners_px[0];
  Eigen::Index row = 0;
  for (const SeenMarker& seen : view.markers)
    for (std::size_t i = 0; i < 4; ++i, row += 2) {
      const evmarker::Vec2 m = 1 / kUnit_px * (seen.corners_px[i] - origin);
      field.row(row) << 1, m.x, m.y, 0, 0, 0, m.x * m.x, m.x * m.y;
      field.row(row + 1) << 0, 0, 0, 1, m.x, m.y, m.x * m.y, m.y * m.y;
      px_per_s.segment<2>(row) = Eigen::Vector2d(seen.px_per_s[i]);
    }
  const Eigen::VectorXd smooth = field * field.colPivHouseholderQr().solve(px_per_s);
  row = 0;
  for (SeenMarker& seen : view.markers)
    for (std::size_t i = 0; i < 4; ++i, row += 2) seen.px_per_s[i] = Eigen::Vector2d(smooth.segment<2>(row));
}

}  // namespace detail

/// Sets how fast the corners move, by where they are seen one view before and one after. Not by the trackers' own
/// velocities: a marker that is seen too far ahead is taken for faster, too. Drops markers that are not seen in both,
/// and views of less than four.
inline void measure_velocities(std::vector<BoardCorners>& views) {
  const auto marker_in = [](const BoardCorners& view, const SeenMarker& seen) {
    const auto found = std::ranges::find(view.markers, seen.marker, &SeenMarker::marker);
    return found == view.markers.end() ? nullptr : &*found;
  };
  std::vector<BoardCorners> moving;
  for (std::size_t i = 1; i + 1 < views.size(); ++i) {
    const BoardCorners &before = views[i - 1], &after = views[i + 1];
    const evmarker::Timestamp between = after.t - before.t;
    if (between != 2 * MarkerFollower::kInterval_us) continue;  // views between were dropped
    BoardCorners view{views[i].t, {}};
    for (SeenMarker seen : views[i].markers) {
      const SeenMarker *const was = marker_in(before, seen), *const will_be = marker_in(after, seen);
      if (was == nullptr || will_be == nullptr) continue;
      for (std::size_t k = 0; k < 4; ++k)
        seen.px_per_s[k] = 1e6 / static_cast<double>(between) * (will_be->corners_px[k] - was->corners_px[k]);
      view.markers.push_back(seen);
    }
    if (view.markers.size() < kFewestMarkers) continue;
    detail::smooth_velocities(view);
    moving.push_back(std::move(view));
  }
  views = std::move(moving);
}

/// Chooses views that differ as much as they can in place, distance and tilt of the board: each next one is the one
/// that looks least like any chosen before.
/// @return in the order of time
inline std::vector<BoardCorners> spread(const std::vector<BoardCorners>& views, std::size_t most) {
  if (views.size() <= most) return views;
  const auto outline = [](const BoardCorners& view) {  // the middle, and ten times a marker's sides
    const double share = 1 / static_cast<double>(view.markers.size());
    evmarker::Vec2 middle, right, down;
    for (const SeenMarker& seen : view.markers) {
      const auto& c = seen.corners_px;
      middle = middle + share / 4 * (c[0] + c[1] + c[2] + c[3]);
      right = right + 10 * share * (c[1] - c[0]);
      down = down + 10 * share * (c[3] - c[0]);
    }
    return std::array{middle, right, down};
  };
  std::vector<std::array<evmarker::Vec2, 3>> outlines;
  for (const BoardCorners& view : views) outlines.push_back(outline(view));
  std::vector<double> to_nearest(views.size(), std::numeric_limits<double>::infinity());
  std::vector<std::size_t> chosen{0};
  while (chosen.size() < most) {
    for (std::size_t i = 0; i < views.size(); ++i) {
      double squares = 0;
      for (std::size_t k = 0; k < 3; ++k) squares += squared_norm(outlines[i][k] - outlines[chosen.back()][k]);
      to_nearest[i] = std::min(to_nearest[i], squares);
    }
    chosen.push_back(static_cast<std::size_t>(std::ranges::max_element(to_nearest) - to_nearest.begin()));
  }
  std::ranges::sort(chosen);
  std::vector<BoardCorners> result;
  for (const std::size_t i : chosen) result.push_back(views[i]);
  return result;
}
