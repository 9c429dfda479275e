#pragma once
// Errors that many events share, as far as their residuals show them: a delay, a trail, edges that are off.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "evmarker/matching/correspondence.hpp"
#include "evmarker/update/edge_blur.hpp"
#include "evmarker/update/edge_scatter.hpp"
#include "evmarker/update/kalman_measurements.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/model_misfit.hpp"
#include "evmarker/update/response_time.hpp"
#include "evmarker/update/unexplained_spread.hpp"

namespace evmarker {

/// What the residuals of events show beside the pose. A Kalman filter takes the errors of events as independent, so
/// that its own covariance lacks all that does not average out over them: by how much they are late, see ResponseTime,
/// what its model does not explain, see ModelMisfit, and how far off each edge is, see EdgeScatter.
class SystematicErrors {
 public:
  explicit SystematicErrors(const KalmanSettings& settings)
      : latency_s_(settings.latency_s),
        latency_sigma_s_(settings.latency_sigma_s),
        initial_trail_px_(settings.initial_trail_px) {}

  /// Adds the residual of an event.
  [[gnu::always_inline]] void add(int segment, double residual_px, double weight) noexcept {
    edges_.add(segment, residual_px, weight);
  }
  /// Adds the measurement of an event. A fair sample of them is enough.
  [[gnu::always_inline]] void add_sample(const MeasurementRow& row, double weight) noexcept {
    edges_.add_row({row[0], row[1], row[2], row[3], row[4], row[5], row[6]}, row[6 + kBiases], weight);
  }
  /// Adds an event of a moving edge, as ResponseTime::add. A sample is enough.
  [[gnu::always_inline]] void add_moving_sample(double residual_px, double px_per_s, double polarity) noexcept {
    response_time_.add(residual_px, px_per_s, polarity);
  }

  /// Adds an upper bound of the share of noise among the last events, 64 of them or more.
  void add_noise_share(double share) noexcept { noise_share_ += kNoiseGain * (share - noise_share_); }

  /// Adds a motion of the edges [px], and evaluates the residuals when they have moved by a few times their width.
  /// @param spread_px2 mean squared residual
  void add_motion(double px, double spread_px2) noexcept {
    // In root mean square residuals: an edge over which events lie evenly is sqrt(12) wide, and an evaluation takes a
    // little more than that twice.
    constexpr double kWidth = 3.5, kSpreads = 8;
    moved_px_ += px;
    have_moved_ |= moved_px_ > kWidth * std::sqrt(spread_px2);
    if (!edges_.in_second_half() && moved_px_ > kSpreads / 2 * std::sqrt(spread_px2)) edges_.end_first_half();
    if (moved_px_ > kSpreads * std::sqrt(spread_px2)) evaluate(spread_px2);
  }

  /// To be called when the pose becomes another one.
  void restart_motion() noexcept {
    moved_px_ = 0;
    have_moved_ = false;
  }
  /// True once the edges have moved by their own width, since the start or `restart_motion`.
  bool edges_have_moved() const noexcept { return have_moved_; }

  /// Measures what the model does not explain. It is slow: once in some updates is enough.
  /// @param spread_px2 mean squared residual
  /// @param px_per_s speed of the edges in the image
  /// @param moving true while the events are surely those of moving edges
  /// @param events_per_passage that one pixel makes while an edge passes over it; 0 if it is not known
  /// @param trail_px as the filter has it
  [[gnu::noinline]] void measure(double spread_px2, double px_per_s, bool moving, double events_per_passage,
                                 double trail_px) noexcept {
    // Unless the edges surely move, the noise's part is taken out, and the rest counts only if it still fills the
    // matching distance, as where the edges have been lost.
    const double of_edges_px2 = moving ? spread_px2 : without_noise_px2(spread_px2);
    if (moving || UnexplainedSpread::fills(of_edges_px2, max_distance_px_))
      misfit_.measure_spread(of_edges_px2, max_distance_px_, smear_px(px_per_s), blur_.factor());
    if (events_per_passage > 0) {
      const double by_width_px = trail_by_width_px(spread_px2, px_per_s, events_per_passage);
      // The trail by the width is half a contrast step, and a whole one is possible. What is not known of a delay looks
      // like a trail, too.
      most_trail_px_ =
          std::max(2 * by_width_px + std::sqrt(response_time_.delay_variance_s2()) * px_per_s, initial_trail_px_);
      // Where it is not known which side of an edge is dark, the filter takes its events to have no trail.
      misfit_.compare_trails(edges_.share_of_known_dark_sides() * trail_px, by_width_px);
    }
  }

  /// Forgets what the residuals showed of a delay while the start pose was still off. From now on, they show blur, too.
  void forget_start() noexcept {
    response_time_ = ResponseTime(max_distance_px_);
    blur_ = EdgeBlur();
    start_is_over_ = true;
  }
  /// Sets within which distance of an edge events are matched; 2 at first.
  void set_max_distance_px(double distance_px) noexcept {
    max_distance_px_ = distance_px;
    response_time_.set_max_distance_px(distance_px);
  }

  /// By how much events are late: the sensor's known delay and its response time [s].
  double delay_s() const noexcept { return latency_s_ + response_time_.delay_s(); }
  /// The part of it that also spreads them in time [s].
  double response_s() const noexcept { return response_time_.delay_s(); }
  /// Standard deviation [px] by which the response time spreads the events of edges that move at `px_per_s`. Averaged
  /// over edges of all directions, the squared speed along the normal is half of the squared speed.
  double smear_px(double px_per_s) const noexcept {
    return std::numbers::sqrt2 / 2 * response_time_.delay_s() * px_per_s;
  }
  /// By how much wider edges are than those of a focused sensor, see EdgeBlur.
  double blur() const noexcept { return blur_.factor(); }
  /// Variance of the time by which the pose is late [s^2], of which the filter itself knows nothing: a delay
  /// looks like a pose a little farther back along the motion.
  double delay_variance_s2(double px_per_s) const noexcept {
    const double lag_s2 = px_per_s > 0 ? misfit_.along_motion_px2() / (px_per_s * px_per_s) : 0;
    return squared(latency_sigma_s_) + response_time_.delay_variance_s2() + lag_s2;
  }

  /// The trail that follows from the edges' width, which the spread of the residuals shows.
  double trail_by_width_px(double spread_px2, double px_per_s, double events_per_passage) const noexcept {
    return expected_trail_px(edge_width_px(spread_px2, px_per_s), events_per_passage);
  }
  /// The longest trail that pixels can make: a whole contrast step, and what an unknown delay may add; infinite while
  /// it is not known.
  double most_trail_px() const noexcept { return most_trail_px_; }

  /// Covariance of the pose by edges whose mean squared error is 1 px^2, see EdgeScatter.
  const Matrix6d& covariance_per_edge_px2() const noexcept { return edges_.covariance_per_px2(); }
  /// Mean squared error of an edge [px^2], as the residuals show it.
  double edge_variance_px2() const noexcept { return edges_.variance_px2(); }
  /// What the model does not explain may add to it [px^2].
  double misfit_px2() const noexcept { return misfit_.of_edge_px2(); }
  /// See EdgeScatter.
  double event_noise() const noexcept { return edges_.event_noise(); }
  /// See ModelMisfit.
  bool events_fill_distance() const noexcept { return misfit_.events_fill_distance(); }

  static constexpr double kPixelVariance = 1.0 / 12;  ///< of a coordinate that is rounded to whole pixels [px^2]

 private:
  static constexpr double kMostNoise = 0.5;       // share of the events
  static constexpr double kNoiseGain = 1.0 / 16;  // weight of a new share of 64 events: over 1000, as for the spread
  static constexpr double squared(double x) noexcept { return x * x; }

  [[gnu::noinline]] void evaluate(double spread_px2) noexcept {
    edges_.evaluate();
    response_time_.evaluate();
    if (start_is_over_ && noise_share_ <= kMostNoise) blur_.add(without_noise_px2(spread_px2));
    moved_px_ = 0;
  }

  // Noise lies evenly over the matching distance. Where it may be most of the events, they tell nothing of the edges.
  double without_noise_px2(double spread_px2) const noexcept {
    if (noise_share_ > kMostNoise) return 0;
    return (spread_px2 - noise_share_ * squared(max_distance_px_) / 3) / (1 - noise_share_);
  }

  // Events lie evenly over the edge's width w, variance w^2 / 12, and each is known to a pixel only; slow pixels smear
  // them.
  double edge_width_px(double spread_px2, double px_per_s) const noexcept {
    const double of_edge = spread_px2 - kPixelVariance - squared(smear_px(px_per_s));
    return std::sqrt(12 * std::max(of_edge, kPixelVariance));  // at least a pixel
  }

  double latency_s_, latency_sigma_s_, initial_trail_px_;  // see KalmanSettings
  EdgeScatter edges_;
  ResponseTime response_time_;
  EdgeBlur blur_;
  ModelMisfit misfit_;
  double max_distance_px_ = 2;  // of matched events
  double moved_px_ = 0;         // by the edges, since the residuals were evaluated
  bool have_moved_ = false;     // by their width
  bool start_is_over_ = false;
  double noise_share_ = 0;  // of the events, lately
  double most_trail_px_ = std::numeric_limits<double>::infinity();
};

}  // namespace evmarker
