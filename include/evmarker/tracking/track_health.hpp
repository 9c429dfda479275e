#pragma once
// Is a marker followed? The evidence for and against it, its probability, and the reason of a loss.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/require.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/tracking/edge_activity.hpp"
#include "evmarker/tracking/polarity_evidence.hpp"

namespace evmarker {

struct TrackHealthSettings {
  /// Upper bound of the probability, for each independent piece of evidence (a pixel that an edge passes), of giving up
  /// a marker that is followed and had full confidence. From even odds, as after `restart`, the bound is the square
  /// root of this setting. It does not hold for verifications: of these, two failures in a row lose a marker at once,
  /// see TrackProgress.
  double false_alarm_rate = 1e-6;
};

/// @throws std::invalid_argument naming the setting that is out of range
inline void validate(const TrackHealthSettings& settings) {
  Require("track health")(settings.false_alarm_rate > 0 && settings.false_alarm_rate < 0.1, "false_alarm_rate",
                          settings.false_alarm_rate);
}

/// How likely it is that a marker is where its tracker says, by four tests: do events near it lie on its edges, does
/// every edge make as many events as before, do their polarities fit its motion, does verification pass. Each test sums
/// log-likelihood ratios between two bounds (Page's cumulative sum test): from full confidence it takes evidence that
/// comes up by chance once in 1 / false_alarm_rate pieces of evidence to lose the marker. By polarities alone it is
/// never lost, but doubted: a broken column of the sensor contradicts the motion, too. The sums are kept apart, as one
/// test may pass where another fails: a half hidden marker still matches well.
class TrackHealth {
 public:
  /// @param image see EdgeActivity
  /// @throws std::invalid_argument naming the setting that is out of range
  TrackHealth(const MarkerModel& model, double focal_length, const TrackHealthSettings& settings,
              const Box& image = Box::everywhere())
      : bound_(-std::log(settings.false_alarm_rate) / 2),  // 2 bound_ from full confidence to a loss
        shown_log_odds_(std::max<std::size_t>(1, model.codes.size())),
        activity_(model, focal_length, image) {
    validate(settings);
    restart(0);
  }

  /// Counts an event on or near the wireframe; an ambiguous one as neither.
  [[gnu::always_inline]] void add(MatchResult match, int segment, bool on) noexcept {
    if (match == MatchResult::matched) {
      ++matched_;
      activity_.add(segment, on);
    } else if (match == MatchResult::near) {
      ++near_;
    }
  }

  /// True once there are enough events for `judge_matches`.
  bool due() const noexcept { return matched_ + near_ >= kEventsToJudge; }
  /// True if after `events` more events `judge_matches` is still not due.
  bool not_due_within(std::size_t events) const noexcept {
    return static_cast<std::size_t>(matched_ + near_) + events < static_cast<std::size_t>(kEventsToJudge);
  }

  /// Judges the events since the last call. At the right pose most lie on an edge; at a wrong one they are spread
  /// evenly, and a third matches by chance. Background up to twice its usual rate is no evidence: its near events are
  /// left out, and so are as many matches as come by chance with them. At rest, all events are background.
  [[gnu::noinline]] void judge_matches(Timestamp t) noexcept {
    if (matched_ + near_ == 0) return;
    const double dt_us = std::max(0.0, static_cast<double>(t) - t_us_);
    const double background = near_per_us_ * dt_us;
    // Beyond twice the usual background, and twice the standard deviation of its number.
    const double excess_near = std::max(0.0, near_ - 2 * background - 2 * std::sqrt(background));
    const double chance_matches = kMatchedToNear * (near_ - excess_near);
    // Of the difference between the matches by chance, c of them, and their estimate by the near events, r times c / r:
    // their variances are c and r c.
    const double deviation = std::sqrt((1 + kMatchedToNear) * chance_matches);
    const double excess_matched = std::max(0.0, matched_ - chance_matches - 3 * deviation);
    // The share that the likelihood assumes of a marker that is followed: half way from the usual one to chance, so
    // that a share a little below the usual one is not yet a loss.
    const double expected = (usual_share_ + kChanceShare) / 2;
    // The events of one pixel in one passage come together and are one piece of evidence.
    const double pieces_per_event = 1 / std::clamp(activity_.events_per_passage(), 1.0, 10.0);
    judge(pieces_per_event * (excess_matched * std::log(kChanceShare / expected) +
                              excess_near * std::log((1 - kChanceShare) / (1 - expected))),
          LossReason::inconsistent);
    const double share = matched_ / static_cast<double>(matched_ + near_);
    const double share_weight = sure() ? std::min((matched_ + near_) / kShareMemory, 1.0) : 0;
    usual_share_ = std::clamp(usual_share_ + share_weight * (share - usual_share_), kLeastUsual, kMostUsual);
    // While the marker is surely followed, what lies beside its edges is background: its rate is the mean over the
    // time surely followed, at most kRateMemory_us. Otherwise the rate changes only slowly, with that whole
    // memory, as the near events may be the marker's own.
    if (sure()) known_us_ = std::min(known_us_ + dt_us, kRateMemory_us);
    // Events of one time stamp have no rate.
    const double rate_weight = dt_us > 0 ? dt_us / (sure() ? std::max(known_us_, dt_us) : dt_us + kRateMemory_us) : 0;
    near_per_us_ += rate_weight * (near_ / std::max(dt_us, 1.0) - near_per_us_);
    t_us_ = static_cast<double>(t);
    forget_matches();
  }

  /// True once the edges have made events enough to be judged.
  bool edges_due() const noexcept { return activity_.due(); }
  /// Judges each edge's events since the last call, if the wireframe has moved.
  /// @param middle_events see EdgeFollower
  void judge_edges(const MarkerModel& model, const Eigen::Isometry3d& T_camera_marker, Timestamp t,
                   std::span<const std::uint32_t> middle_events) noexcept {
    const auto interval = activity_.evaluate(model, T_camera_marker, t, middle_events);
    if (!interval) return;
    judge_hidden(interval->markers);
    // Half of the background that matches by chance contradicts.
    const double by_background = 0.5 * kMatchedToNear * near_per_us_ * interval->duration_us;
    const double contradicting = std::max(0.0, interval->contradicting - by_background);
    const double evidence =
        polarities_.log_likelihood_ratio(interval->events, contradicting, activity_.events_per_passage(), sure());
    polarity_log_odds_ = std::clamp(polarity_log_odds_ - std::clamp(evidence, -bound_, bound_), -bound_ / 2, bound_);
    summarise();
  }
  /// Forgets the edges' events since the last judgement; to be called when a correction has moved the pose although the
  /// marker has not moved.
  void restart_edges() noexcept { activity_.restart(); }

  /// Takes the result of a verification.
  void judge_verification(bool passed) noexcept {
    judge(passed ? -kVerificationEvidence : kVerificationEvidence, LossReason::verification);
  }

  /// Starts anew: even odds for the tests that show a wrong start pose (inconsistent, verification), full confidence
  /// for the others.
  void restart(Timestamp t) noexcept {
    log_odds_.fill(bound_);
    std::ranges::fill(shown_log_odds_, bound_);
    polarity_log_odds_ = bound_;
    log_odds_[static_cast<std::size_t>(LossReason::inconsistent)] = 0;
    log_odds_[static_cast<std::size_t>(LossReason::verification)] = 0;
    summarise();
    t_us_ = static_cast<double>(t);
    forget_matches();
    activity_.restart();
  }

  bool lost() const noexcept { return lost_; }
  /// True while no test speaks against the marker, and its matches speak for it.
  bool sure() const noexcept { return least() >= 0 && log_odds(LossReason::inconsistent) > bound_ / 2; }
  /// True while one of the tests speaks more against it than for it.
  bool doubtful() const noexcept { return probability_ < 0.5; }
  /// Probability that the marker is followed, by the test that speaks most against it.
  double probability() const noexcept { return probability_; }
  /// What speaks most for its loss.
  LossReason reason() const noexcept {
    return static_cast<LossReason>(std::min_element(log_odds_.begin() + 1, log_odds_.end()) - log_odds_.begin());
  }
  /// Events that a pixel makes while an edge passes over it; 0 before it is known.
  double events_per_passage() const noexcept { return activity_.events_per_passage(); }
  /// Contrast of each segment, relative to the mean of all.
  std::span<const float> contrasts() const noexcept { return activity_.contrasts(); }

 private:
  static constexpr int kEventsToJudge = 64;
  static constexpr double kVerificationEvidence =
      3;  // log odds: of twenty wrong poses one passes, of twenty right ones one fails
  static constexpr double kChanceShare =
      1.0 / 3;  // of evenly spread events within three matching distances, those that match
  static constexpr double kMatchedToNear = kChanceShare / (1 - kChanceShare);
  static constexpr double kLeastUsual = 0.7, kMostUsual = 0.98;
  static constexpr double kShareMemory = 50000;     // of usual_share_ [events]
  static constexpr double kRateMemory_us = 500000;  // of near_per_us_

  double least() const noexcept {
    return std::min(polarity_log_odds_, *std::min_element(log_odds_.begin() + 1, log_odds_.end()));
  }
  double log_odds(LossReason reason) const noexcept { return log_odds_[static_cast<std::size_t>(reason)]; }

  // @param evidence_of_loss logarithm of how much likelier the evidence is if the marker is lost
  void judge(double evidence_of_loss, LossReason reason) noexcept {
    double& log_odds = log_odds_[static_cast<std::size_t>(reason)];
    log_odds = std::min(log_odds - evidence_of_loss, bound_);
    summarise();
  }

  // A board is in sight as long as one of its markers is, by evidence that would do for that marker alone.
  void judge_hidden(std::span<const EdgeActivity::MarkerActivity> markers) noexcept {
    double most = -std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < markers.size(); ++i) {
      if (markers[i].in_sight == 0) continue;
      // Where the motion turns or a lamp goes on, all edges may seem wrong for a moment: one interval is not enough.
      const double evidence = std::clamp(markers[i].log_ratio_hidden, -bound_, bound_);
      shown_log_odds_[i] = std::min(std::max(shown_log_odds_[i], -bound_) - evidence, bound_);
      most = std::max(most, shown_log_odds_[i]);
    }
    if (std::isfinite(most)) log_odds_[static_cast<std::size_t>(LossReason::hidden)] = most;
  }

  // Here and not in `probability`, which is called with every event.
  void summarise() noexcept {
    lost_ = least() <= -bound_;
    probability_ = 1 / (1 + std::exp(-least()));
  }

  void forget_matches() noexcept { matched_ = near_ = 0; }

  double bound_;  // of the logarithm of the odds, to both sides
  // That it is not lost, by LossReason; bound_ for a reason without a test.
  std::array<double, kLossReasons> log_odds_{};
  std::vector<double> shown_log_odds_;  // of each marker of a board, that it is not hidden
  double polarity_log_odds_ = 0;        // that the pose is right, by the polarities; it stays above -bound_
  bool lost_ = false;
  double probability_ = 0.5;
  EdgeActivity activity_;
  PolarityEvidence polarities_;
  int matched_ = 0, near_ = 0;  // events since the last judgement
  double t_us_ = 0;             // time of that judgement [us]
  double usual_share_ = 0.9;    // of the events near edges that lie on them
  double near_per_us_ = 0;      // usual rate of the others
  double known_us_ = 0;         // time surely followed, limited to kRateMemory_us
};

}  // namespace evmarker
