#pragma once
// The paper's tracking loop for one marker: match, collect, update every n matched events.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "evmarker/base/so3.hpp"
#include "evmarker/matching/matching_share.hpp"
#include "evmarker/matching/model_matcher.hpp"
#include "evmarker/model/planar_ambiguity.hpp"
#include "evmarker/model/pose_perturbation.hpp"
#include "evmarker/tracking/background_share.hpp"
#include "evmarker/tracking/choice_lifetime.hpp"
#include "evmarker/tracking/edge_follower_settings.hpp"
#include "evmarker/tracking/edge_length.hpp"
#include "evmarker/tracking/pose_comparison.hpp"
#include "evmarker/tracking/update_interval.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

/// What one update rested on.
struct UpdateStatistics {
  int matched = 0;         ///< events that took part
  int offered = 0;         ///< events on or near the wireframe since the update before, taken or not
  double residual_px = 0;  ///< root mean square distance of the matched events to their segments [px]
};

/// Follows a wireframe from a known pose on. A copyable value that depends on nothing but the events pushed, so that a
/// copy can be run backwards to verify it.
template <PoseUpdateRule Rule>
class EdgeFollower {
 public:
  using Settings = EdgeFollowerSettings<Rule>;

  /// @throws std::invalid_argument naming the setting, or a pose that does not have the model in front of the camera
  EdgeFollower(MarkerModel model, double focal_length, const Eigen::Isometry3d& T_camera_marker,
               const Settings& settings)
      : interval_(settings.events_per_update),
        matcher_(std::move(model), focal_length, settings.matching),
        max_distance_px_(settings.matching.max_distance_px),
        edge_length_(matcher_.model(), focal_length),
        rule_(settings.update, interval_.events()),
        T_camera_marker_(T_camera_marker),
        middle_events_(matcher_.model().segments.size()),
        contrasts_(matcher_.model().segments.size(), 1.0f) {
    validate(settings);
    if (!is_finite(T_camera_marker) || !is_rotation(T_camera_marker.linear()))
      throw std::invalid_argument("T_camera_marker is no rotation and translation");
    if (!matcher_.project(T_camera_marker_))
      throw std::invalid_argument("T_camera_marker does not put the marker in front of the camera");
    set_events_per_update(interval_.events());
    adapt_to_edge_length();
  }

  struct Result {
    MatchResult match = MatchResult::far;
    bool updated = false;
    int segment = 0;  ///< of a matched event
  };

  /// Takes the event with line of sight (m; 1) at time t [us]; polarity 1 is brighter, -1 darker, 0 unknown.
  // Inlined, as the matching and the rule's `add` are, so that what one hands to the other stays in registers: that
  // saves a quarter of the time.
  [[gnu::always_inline]] Result push(Vec2 m, Timestamp t, double polarity = 0) noexcept {
    if (!matcher_.grid().on_grid()) [[unlikely]]
      return push_by_segments_or_board(m, t, polarity);
    return collect(m, t, polarity, matcher_.grid(), matcher_.grid().choose(m));
  }

  /// True if events can be pushed in groups at the present pose.
  bool accepts_groups() const noexcept { return matcher_.grid().on_grid() || matcher_.board() != nullptr; }

  /// Takes events of a group from number `first` on, faster than one by one; to be called again with the others.
  /// Requires `accepts_groups()`.
  /// @param after called with the number of each event and its Result; false ends the push after this event
  /// @return the number of the first event that was not taken
  template <typename After>
  [[gnu::always_inline]] std::size_t push(const EventGroup& events, std::size_t first,
                                          const After& after) noexcept(noexcept(after(first, Result()))) {
    const GridMatcher& grid = matcher_.grid();
    if (!grid.on_grid()) return push_to_board(events, first, after);
    const std::size_t end = std::min(events.count(), first + batch_size());
    GridMatcher::Choices choices;
    grid.choose_many(events, first, end - first, choices);
    const auto collect_chosen = [&](std::size_t i, Vec2 m) __attribute__((always_inline)) {
      return collect(m, events.t[i], events.polarity[i], grid, grid.choice(choices.stretch[i - first], m));
    };
    return collect_while_chosen(grid, events, first, end, collect_chosen, after);
  }

  /// Sets how many events a pixel makes while an edge passes over it. A SensorEstimatingRule bounds the motion by it,
  /// `events_per_update` follows it, and the first call measures the trail, which corrects state and pose; of a
  /// TrailTakingRule it only sets the trail. To be called directly after an update, while nothing has been collected.
  void set_events_per_passage(double events) noexcept {
    if constexpr (SensorEstimatingRule<Rule>) {
      const bool known = std::exchange(events_per_passage_, events) > 0;
      bound_motion(length_px());
      if (known) return;
      rule_.measure_trail(T_camera_marker_, events);
      start_from(T_camera_marker_);
    } else if constexpr (TrailTakingRule<Rule>) {
      rule_.set_trail_by_events_per_passage(events, matcher_.focal_length());
    }
  }
  /// Of each segment, the events in its middle half that took part in updates, modulo 2^32.
  std::span<const std::uint32_t> middle_events() const noexcept { return middle_events_; }
  /// Sets the contrast of each segment, relative to the mean of all.
  void set_contrasts(std::span<const float> contrasts) noexcept { std::ranges::copy(contrasts, contrasts_.begin()); }
  /// To be called once the pose is known to be right: many events beside the edges then mean that there is only
  /// background and the marker rests, see BackgroundShare.
  void enable_rest_detection() noexcept { may_rest_ = true; }
  int events_per_update() const noexcept { return interval_.events(); }

  /// How many events are enough to determine the pose: two per pixel of edge length, from 20 to 500.
  int events_to_fix_pose() const noexcept { return static_cast<int>(std::clamp(2 * length_px(), 20.0, 500.0)); }

  /// Matched events that the next update still needs.
  std::size_t until_update() const noexcept { return static_cast<std::size_t>(interval_.events() - matched_); }

  /// Goes on from another pose; the rule keeps its state and must hold no events since its last update.
  void start_from(const Eigen::Isometry3d& T_camera_marker) noexcept {
    T_camera_marker_ = T_camera_marker;
    in_front_ = matcher_.project(T_camera_marker_);
    start_collecting();
    adapt_to_edge_length();
  }

  /// Moves the pose on to a later time by the rule's motion model. Until `pushed_until` all events have been pushed, so
  /// that their number bounds the motion; from there on nothing is known.
  void extrapolate(Timestamp t, Timestamp pushed_until) noexcept requires MotionEstimatingRule<Rule> {
    if constexpr (MotionBoundingRule<Rule>) rule_.advance_by_event_count(T_camera_marker_, pushed_until);
    rule_.extrapolate(T_camera_marker_, t);
    start_from(T_camera_marker_);
  }

  /// Goes over to the mirrored pose and motion, at which a flat wireframe looks nearly the same.
  void mirror(const ModelPlane& plane) noexcept requires MirrorableRule<Rule> {
    rule_.transform(mirrored_motion(T_camera_marker_, plane));
    start_from(mirrored(T_camera_marker_, plane));
  }
  /// True once the pose follows the marker's motion since the start or since it was mirrored, where the rule can tell.
  bool follows_motion() const noexcept {
    if constexpr (MirrorableRule<Rule>)
      return rule_.follows_motion();
    else
      return true;
  }
  /// Says with which probability another pose is the right one, until the next call: the covariance then has the second
  /// moment of both about the present one. A rule that is no MirrorableRule ignores it.
  void set_other_pose(const Eigen::Isometry3d& T_camera_marker, double probability) noexcept {
    if constexpr (MirrorableRule<Rule>)
      rule_.set_other_pose(std::sqrt(probability) * Vec6(pose_difference(T_camera_marker_, T_camera_marker)));
  }
  void set_no_other_pose() noexcept {
    if constexpr (MirrorableRule<Rule>) rule_.set_other_pose({});
  }

  /// Prepares for past events, the newest first. The caller mirrors their times, so that they still increase.
  void reverse() noexcept {
    rule_.reverse();
    start_collecting();
  }

  /// How badly the present pose explains an event, at most 1 px: one farther away is noise or another edge's. For a
  /// rule without a motion model, whose pose lags, at most the matching distance.
  EdgeResidual residual(Vec2 m, double polarity) const noexcept {
    const double most_px = MotionEstimatingRule<Rule> ? 1 : matcher_.max_distance_px();
    Correspondence c;
    if (matcher_.match(m, c) != MatchResult::matched) return {.px = most_px};
    c.polarity = polarity;
    c.contrast = contrast(c.segment);
    if constexpr (SensorEstimatingRule<Rule>) c.distance_px = rule_.residual_px(c, T_camera_marker_);
    return {c.segment, std::clamp(c.distance_px, -most_px, most_px)};
  }

  const Eigen::Isometry3d& T_camera_marker() const noexcept { return T_camera_marker_; }
  const Rule& rule() const noexcept { return rule_; }
  const ModelMatcher& matcher() const noexcept { return matcher_; }
  const UpdateStatistics& last_update() const noexcept { return last_update_; }
  /// False once the marker is not wholly in front of the camera: nothing will match any more.
  bool in_front() const noexcept { return in_front_; }
  /// Updates whose events the rule could not use, see PoseUpdateRule.
  int skipped_updates() const noexcept { return skipped_updates_; }

 private:
  static constexpr int kFewestForBatch = 4;  // events per update: fewer fill too few of the lanes
  // The pose at which the edge of an event is chosen is renewed when a corner has moved farther than this [px]. Without
  // a motion model the pose moves to and fro more than the marker does: only a jump means something.
  static constexpr double kChoiceHolds_px = MotionEstimatingRule<Rule> ? 0.1 : 1;

  // Widens the matching distance as blur widens the edges, and by three times the spread that slow pixels give to
  // moving ones, to 0.3 cells at most.
  void adapt_to_spread() noexcept {
    if constexpr (SmearEstimatingRule<Rule>) {
      constexpr double kSmears = 3, kMostCells = 0.3;
      const double wide = std::hypot(rule_.blur() * max_distance_px_, kSmears * rule_.smear_px());
      const double distance = std::max(max_distance_px_, std::min(wide, kMostCells * matcher_.cell_px()));
      if (std::abs(distance - matcher_.max_distance_px()) > matcher_.max_distance_px() / 16)  // not every small change
        matcher_.set_max_distance_px(distance);
      rule_.set_max_distance_px(matcher_.max_distance_px());
    }
  }

  // Sets what depends on the projected length of the edges. Called where nothing has been collected.
  void adapt_to_edge_length() noexcept {
    adapt_to_spread();
    const double length_px = this->length_px();
    if (interval_.adapt(length_px, events_per_passage_)) set_events_per_update(interval_.events());
    if constexpr (NoiseAwareRule<Rule>)
      if (std::abs(length_px - measured_length_px_) > length_px / 8) {
        matching_share_.restart(matcher_);
        expect_matching();
        measured_length_px_ = length_px;
      }
    choice_lifetime_.begin(length_px, interval_.events());
    bound_motion(length_px);
  }

  void bound_motion(double length_px) noexcept {
    if constexpr (MotionBoundingRule<Rule>)
      if (events_per_passage_ > 0) rule_.bound_motion_by_events(events_per_passage_ * length_px, events_per_passage_);
  }

  double length_px() const noexcept { return edge_length_.px(T_camera_marker_); }

  void set_events_per_update(int events) noexcept {
    rule_.set_events_per_update(events);
    adds_in_batches_ = BatchUpdateRule<Rule> && events >= kFewestForBatch;
  }

  // For how many events to choose edges in one batch: as many as may still be matched until edges are chosen anew, a
  // quarter more for those that match none, in whole lanes. Choices for later ones would be outdated before use.
  std::size_t batch_size() const noexcept {
    const auto left = static_cast<std::size_t>(choice_lifetime_.events_left(interval_.events(), matched_));
    return std::min(GridMatcher::Choices::kMost, (left + left / 4 + simd::kLanes - 1) / simd::kLanes * simd::kLanes);
  }

  // `push` of a group, on a board.
  template <typename After>
  [[gnu::noinline]] std::size_t push_to_board(const EventGroup& events, std::size_t first, const After& after) {
    const std::size_t end = std::min(events.count(), first + batch_size());
    const BoardMatcher& board = *matcher_.board();
    BoardMatcher::Choices choices;
    board.choose_many(events, first, end - first, choices);
    const auto collect_chosen = [&](std::size_t i, Vec2 m) __attribute__((always_inline)) {
      const int stretch = choices.stretch[i - first];  // or a code, see GridMatcher::Choices
      if (const BoardMatcher::Marker* const marker = choices.marker[i - first])
        return collect(m, events.t[i], events.polarity[i], *marker, marker->matcher.choice(stretch, m));
      if (stretch == GridMatcher::Choices::kFar) return Result{MatchResult::far};
      return push_by_segments_or_board(m, events.t[i], events.polarity[i]);
    };
    return collect_while_chosen(board, events, first, end, collect_chosen, after);
  }

  // Collects the events from `first` to `end` until `after` returns false, or the matcher chooses edges anew. Returns
  // the number of the first event that was not collected.
  template <typename Matcher, typename Collect, typename After>
  [[gnu::always_inline]] static std::size_t collect_while_chosen(const Matcher& matcher, const EventGroup& events,
                                                                 std::size_t first, std::size_t end,
                                                                 const Collect& collect, const After& after) {
    const unsigned times_chosen = matcher.times_edges_chosen();
    for (std::size_t i = first; i < end; ++i) {
      const Result result = collect(i, Vec2(events.x[i], events.y[i]));
      const bool go_on = after(i, result);
      if (!go_on || matcher.times_edges_chosen() != times_chosen) return i + 1;
    }
    return end;
  }

  [[gnu::always_inline]] Result collect(Vec2 m, Timestamp t, double polarity, const BoardMatcher::Marker& marker,
                                        const GridMatcher::Choice& choice) noexcept {
    return collect(m, t, polarity, marker.matcher, choice, marker.number, marker.first_segment);
  }

  // Collects an event that was matched on a grid, and updates if it is the last one that was needed. On a board, the
  // grid has a number, and a first segment among the model's.
  [[gnu::always_inline]] Result collect(Vec2 m, Timestamp t, double polarity, const GridMatcher& grid,
                                        const GridMatcher::Choice& choice, std::size_t number = 0,
                                        int first_segment = 0) noexcept {
    if (choice.result == MatchResult::far) return {choice.result};
    if (choice.result != MatchResult::matched) {
      ++offered_;
      return {choice.result};
    }
    if (adds_in_batches_) {
      ++offered_;
      matches_.set(matches_.count++, m, t, polarity, number, first_segment, *choice.edge,
                   contrast(first_segment + choice.edge->segment));
      const bool enough = ++matched_ == interval_.events();
      if (matches_.count == simd::kLanes) add_matches();
      return {choice.result, enough && update(t), first_segment + choice.edge->segment};
    }
    Correspondence correspondence;
    const MatchResult match = grid.correspond(*choice.edge, m, correspondence);
    correspondence.segment += first_segment;
    return collect(match, correspondence, t, polarity);
  }

  [[gnu::always_inline]] Result collect(MatchResult match, Correspondence& correspondence, Timestamp t,
                                        double polarity) noexcept {
    if (match == MatchResult::far) return {match};
    ++offered_;
    if (match != MatchResult::matched) return {match};
    correspondence.t = t;
    correspondence.polarity = polarity;
    correspondence.contrast = contrast(correspondence.segment);
    count_in_middle(correspondence.segment, correspondence.from_end_px2);
    rule_.add(correspondence, T_camera_marker_);
    squared_px_ += correspondence.squared_px;
    const bool enough = ++matched_ == interval_.events();
    return {match, enough && update(t), correspondence.segment};
  }

  [[gnu::noinline]] Result push_by_segments_or_board(Vec2 m, Timestamp t, double polarity) noexcept {
    if (const BoardMatcher* const board = matcher_.board()) {
      const auto [sure, marker] = board->marker_at(m);
      if (sure && marker == nullptr) return {MatchResult::far};
      if (sure) return collect(m, t, polarity, *marker, marker->matcher.choose(m));
    }
    Correspondence correspondence;
    return collect(matcher_.match(m, correspondence), correspondence, t, polarity);
  }

  [[gnu::noinline]] void add_matches() noexcept {
    if constexpr (BatchUpdateRule<Rule>) {
      simd::in_wide_vectors([&]() __attribute__((always_inline)) {
        Correspondences c;
        const auto grid_of = [&](std::size_t number) -> const ProjectedGrid& { return matcher_.projected(number); };
        correspond(matches_, grid_of, matcher_.focal_length(), c);
        for (std::size_t i = 0; i < c.count; ++i) count_in_middle(c.segment[i], c.from_end_px2[i]);
        rule_.add(c, T_camera_marker_);
        alignas(64) simd::Lanes squared_px;
        for (std::size_t i = 0; i < simd::kLanes; ++i)
          squared_px[i] = c.is_event[i] * c.distance_px[i] * c.distance_px[i];
        squared_px_ += simd::sum(squared_px);
      });
      matches_.count = 0;
    }
  }

  // Not inlined, which would take registers from every event: 5 to 10 % faster at n = 100, 3 % slower at n = 1.
  [[gnu::noinline]] bool update(Timestamp t) noexcept {
    if (matches_.count > 0) add_matches();
    last_update_ = {matched_, offered_, std::sqrt(squared_px_ / matched_)};
    if (may_rest_) measure_background(t);
    start_collecting();
    const bool updated = rule_.update(T_camera_marker_, t);
    skipped_updates_ += !updated;
    // Edges are chosen anew where their choice is too old, or the pose has moved too far since.
    const unsigned times_chosen = matcher_.times_edges_chosen();
    in_front_ = choice_lifetime_.count_update() ? matcher_.project(T_camera_marker_)
                                                : matcher_.move(T_camera_marker_, kChoiceHolds_px);
    if (matcher_.times_edges_chosen() != times_chosen) adapt_to_edge_length();
    return updated;
  }

  void measure_background(Timestamp t) noexcept {
    if constexpr (NoiseAwareRule<Rule>) {
      background_.add(matched_, offered_ - matched_, t);
      if (!background_.due()) return;
      rule_.set_background(background_.measure(t, rule_.moving_share()));
      if (matching_share_.is_refined()) return;
      matching_share_.refine(matcher_);
      expect_matching();
    }
  }

  void expect_matching() noexcept {
    if (const auto share = matching_share_.share()) background_.expect_matching(*share);
  }

  double contrast(int segment) const noexcept { return contrasts_[static_cast<std::size_t>(segment)]; }

  // Counts an event in an edge's middle half, where from_end_px2 is infinite. Not for rules without a motion model.
  [[gnu::always_inline]] void count_in_middle(int segment, double from_end_px2) noexcept {
    if constexpr (MotionEstimatingRule<Rule>)
      middle_events_[static_cast<std::size_t>(segment)] += from_end_px2 > std::numeric_limits<double>::max();
  }

  void start_collecting() noexcept {
    matched_ = offered_ = 0;
    squared_px_ = 0;
    matches_.count = 0;
  }

  UpdateInterval interval_;
  double events_per_passage_ = 0;  // 0: not known
  ModelMatcher matcher_;
  double max_distance_px_;  // of events whose edges do not move
  EdgeLength edge_length_;
  Rule rule_;
  Eigen::Isometry3d T_camera_marker_;
  bool in_front_ = true;
  int matched_ = 0, offered_ = 0, skipped_updates_ = 0;
  double squared_px_ = 0;
  GridMatches matches_;
  UpdateStatistics last_update_;
  BackgroundShare background_;
  bool may_rest_ = false;
  MatchingShare matching_share_;
  double measured_length_px_ = 0;  // of the edges when the matching share began to be measured
  bool adds_in_batches_ = false;
  ChoiceLifetime choice_lifetime_;
  std::vector<std::uint32_t> middle_events_;  // by segment
  std::vector<float> contrasts_;              // by segment
};

}  // namespace evmarker
