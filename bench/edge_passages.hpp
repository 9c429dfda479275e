#pragma once
// What a recording says about a marker: the passages of its edges over the pixels, with the truth known.
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "evmarker/base/median.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "scenarios.hpp"

namespace evmarker::bench {

/// One passage of an edge over a pixel: the mean of its events.
struct Passage {
  double t_s = 0;
  int profile = 0;         ///< passages of equal number have the same edge, part of it (corner or not), and polarity
  double distance_px = 0;  ///< from the true edge, along its normal
  double speed_px_s = 0;   ///< of the true edge, along its normal
  Vector6d row = Vector6d::Zero();  ///< derivative of `distance_px` by the pose, order as in PoseEstimate
  int events = 0;
};

/// Velocity of the true pose [m/s, rad/s].
inline Vector6d true_twist(const Situation& situation, std::size_t marker, double t_s) {
  constexpr double kStep_s = 1e-5;
  const auto& motion = situation.scene.markers[marker].T_camera_marker;
  const Eigen::Isometry3d before = motion(t_s - kStep_s), after = motion(t_s + kStep_s);
  Vector6d twist;
  twist << after.translation() - before.translation(), so3_log(after.linear() * before.linear().transpose());
  return twist / (2 * kStep_s);
}

/// Groups the events beside the true edges of a marker by pixel, edge and polarity.
class PassageFinder {
 public:
  PassageFinder(const Situation& situation, std::size_t marker, MarkerModel model)
      : situation_(situation),
        marker_(marker),
        matcher_(std::move(model), situation.camera.focal_length(), {.max_distance_px = kGate_px}) {}

  /// Events must come in order of time.
  void add(const Event& event) {
    const double t_s = static_cast<double>(event.t) * 1e-6;
    const Eigen::Isometry3d T = situation_.truth(marker_, event.t);
    const Eigen::Vector3d M = situation_.camera.line_of_sight({1.0 * event.x, 1.0 * event.y});
    Correspondence c;
    if (!matcher_.project(T) || matcher_.match({M.x(), M.y()}, c) != MatchResult::matched) return;
    Passage passage{.t_s = t_s, .profile = profile(c, event), .distance_px = c.distance_px, .events = 1};
    passage.row << c.gradient, (c.E - T.translation()).cross(c.gradient);
    passage.speed_px_s = passage.row.dot(true_twist(situation_, marker_, t_s));
    const auto [open, is_new] = open_.try_emplace({event.x, event.y}, passage);
    if (is_new) return;
    if (!continues(open->second, passage)) {
      done_.push_back(open->second);
      open->second = passage;
    } else {
      join(open->second, passage);
    }
  }

  /// All passages; ends the search.
  std::vector<Passage> passages() && {
    for (const auto& [pixel, passage] : open_) done_.push_back(passage);
    return std::move(done_);
  }

 private:
  static constexpr double kGate_px = 3, kCorner_px = 1.5;

  // Corners are round, so that events beside them lie elsewhere.
  static int profile(const Correspondence& c, const Event& event) {
    const bool corner = c.from_end_px2 < kCorner_px * kCorner_px;
    return 4 * c.segment + 2 * static_cast<int>(corner) + static_cast<int>(event.p > 0);
  }

  // The edge has not left the reach of the pixel since the passage's mean time.
  static bool continues(const Passage& open, const Passage& next) {
    return open.profile == next.profile && (next.t_s - open.t_s) * std::abs(next.speed_px_s) < 2 * kGate_px &&
           open.speed_px_s * next.speed_px_s > 0;
  }

  static void join(Passage& open, const Passage& next) {
    const double share = 1.0 / ++open.events;
    open.t_s += share * (next.t_s - open.t_s);
    open.distance_px += share * (next.distance_px - open.distance_px);
    open.speed_px_s += share * (next.speed_px_s - open.speed_px_s);
    open.row += share * (next.row - open.row);
  }

  const Situation& situation_;  // must outlive this
  std::size_t marker_;
  SegmentMatcher matcher_;
  std::map<std::pair<std::uint16_t, std::uint16_t>, Passage> open_;  // by pixel
  std::vector<Passage> done_;
};

/// What passages of known edge profiles say about the place of an edge.
struct Profile {
  double information_px2 = 0;  ///< of a passage, the inverse of the variance that an estimator attains [1/px^2]
  double scale_px = 1;         ///< of that estimator's Cauchy weights
};

namespace detail {

// Subtracts a weighted straight line through the distances over the speed.
inline void subtract_line(std::vector<Passage*>& passages, double scale_px) {
  constexpr int kRounds = 6;
  const auto row = [](const Passage& passage) { return Eigen::Vector2d(1, 1e-3 * passage.speed_px_s); };
  Eigen::Vector2d line(0, 0);
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix2d squares = Eigen::Vector2d(1e-6, 1).asDiagonal();  // no slope from a few passages
    Eigen::Vector2d products(0, 0);
    for (const Passage* passage : passages) {
      const double r = (passage->distance_px - row(*passage).dot(line)) / scale_px, weight = 1 / (1 + r * r);
      squares += weight * row(*passage) * row(*passage).transpose();
      products += weight * passage->distance_px * row(*passage);
    }
    line = squares.ldlt().solve(products);
  }
  for (Passage* passage : passages) passage->distance_px -= row(*passage).dot(line);
}

// Of the location of the residuals, by an M-estimator with psi(r) = r / (1 + (r / scale)^2): E[psi']^2 / E[psi^2].
inline double information(const std::vector<Passage>& passages, double scale_px) {
  double slope = 0, square = 0;
  for (const Passage& passage : passages) {
    const double x = passage.distance_px / scale_px, weight = 1 / (1 + x * x);
    slope += (1 - x * x) * weight * weight;
    square += passage.distance_px * passage.distance_px * weight * weight;
  }
  return square > 0 ? slope * slope / (square * static_cast<double>(passages.size())) : 0;
}

}  // namespace detail

/// Makes residuals of the distances: subtracts from those of each profile its offset and delay, which a limit may take
/// for known. Returns what the residuals say; there must be at least one.
inline Profile subtract_profiles(std::vector<Passage>& passages) {
  std::vector<double> sizes;
  for (const Passage& passage : passages) sizes.push_back(std::abs(passage.distance_px));
  const double scale_px = median(sizes);
  std::map<int, std::vector<Passage*>> by_profile;
  for (Passage& passage : passages) by_profile[passage.profile].push_back(&passage);
  for (auto& [number, of_profile] : by_profile) detail::subtract_line(of_profile, scale_px);
  Profile best;
  for (double scale = 0.25; scale < 16; scale *= 1.2)
    if (const double found = detail::information(passages, scale * scale_px); found > best.information_px2)
      best = {found, scale * scale_px};
  return best;
}

}  // namespace evmarker::bench
