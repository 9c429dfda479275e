#pragma once
// Compares the events of moving edges with what such edges make: how many, and of which polarity.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "evmarker/base/box.hpp"
#include "evmarker/base/vector.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/tracking/edge_contrasts.hpp"

namespace evmarker {

/// Compares each edge's events with that edge's own history. The number of an edge's events is the area that it sweeps
/// in the image, times a rate of its own: rates of printed edges differ by their contrast, those of a body's edges by
/// up to forty times. An edge that makes hardly any of the events that it used to make is hidden, or is not there, and
/// the wireframe follows something else. Of a board, each marker is judged by itself: a hand may cover some.
class EdgeActivity {
 public:
  /// @param focal_length [px]
  /// @param image lines of sight (X/Z, Y/Z) that are surely in the image: edges that are not wholly there are not
  /// judged
  EdgeActivity(const MarkerModel& model, double focal_length, const Box& image = Box::everywhere())
      : focal_length_(focal_length),
        image_(image),
        events_to_evaluate_(std::clamp(20 * static_cast<int>(model.segments.size()), 60, 400)),
        marker_of_(marker_of_segments(model)),
        markers_(std::max<std::size_t>(1, model.codes.size())),
        counts_(model.segments.size()),
        history_(counts_.size()),
        middle_events_(counts_.size()),
        contrasts_(counts_.size()),
        swept_before_(counts_.size()),
        begin_(counts_.size()),
        end_(counts_.size()) {
    for (const MarkerSegment& segment : model.segments)
      dark_sides_known_ = dark_sides_known_ && !segment.dark_side.isZero();
  }

  /// A marker of a board, or the whole of any other wireframe, in an interval.
  struct MarkerActivity {
    int in_sight = 0;  ///< how many of its edges were
    /// Logarithm of how much likelier its events are if half of its edges are hidden than if none is.
    double log_ratio_hidden = 0;
  };

  /// What the edges did from one evaluation to the next.
  struct Interval {
    std::span<const MarkerActivity> markers{};  ///< valid until the next evaluation
    double events = 0;         ///< of edges that moved to the same side as before, and whose dark side is known
    double contradicting = 0;  ///< how many of those do not have the polarity that the motion makes
    double duration_us = 0;
  };

  /// Counts an event that was matched to a segment.
  void add(int segment, bool on) noexcept {
    Count& count = counts_[static_cast<std::size_t>(segment)];
    ++count.events;
    count.on += on;
    ++total_;
  }

  /// True once there are enough events for `evaluate`, which costs as much as some hundred events.
  bool due() const noexcept { return total_ >= events_to_evaluate_; }

  /// Evaluates the events since the last evaluation, and begins a new interval. Returns nothing until the wireframe has
  /// moved by about a pixel; until then events add up, except that those of a rest are forgotten. Measures the edges'
  /// contrasts, too.
  /// @param middle_events of each segment, events in its middle half until now, modulo 2^32
  std::optional<Interval> evaluate(const MarkerModel& model, const Eigen::Isometry3d& T_camera_marker, Timestamp t,
                                   std::span<const std::uint32_t> middle_events) noexcept {
    for (std::size_t i = 0; i < end_.size(); ++i) end_[i] = project(model, model.segments[i], T_camera_marker);
    double swept_px2 = 0, length_px = 0;
    for (std::size_t i = 0; i < end_.size(); ++i) {
      if (!in_sight(i)) continue;
      swept_px2 += swept(i);
      length_px += norm(end_[i].along);
    }
    if (!std::isfinite(swept_px2)) {
      restart();
      return std::nullopt;
    }
    if (length_px == 0) {
      begin_interval(t, middle_events);
      return std::nullopt;
    }
    if (swept_px2 < kDistance_px * length_px) {
      total_ = 0;  // due again after as many more events, which count together with these
      if (events_are_background(swept_px2, length_px)) begin_interval(t, middle_events);
      return std::nullopt;
    }
    Interval interval = judge_motion(swept_px2);
    interval.duration_us = static_cast<double>(t) - static_cast<double>(begin_t_);
    measure_contrasts(middle_events);
    begin_interval(t, middle_events);
    return interval;
  }

  /// How many events a pixel makes while an edge passes over it, a running mean over all edges; 0 before it is known.
  double events_per_passage() const noexcept { return mean_rate_; }

  /// Contrast of each segment, relative to the mean of all.
  std::span<const float> contrasts() const noexcept { return contrasts_.contrasts(); }

  /// Forgets the events since the last evaluation; a new interval begins at the next one.
  void restart() noexcept {
    forget_events();
    std::ranges::fill(begin_, Edge());
  }

 private:
  static constexpr double kDistance_px = 1;   // mean motion of the edges that is enough to evaluate them
  static constexpr double kRest_px = 0.1;     // by less, they are at rest
  static constexpr double kJitter_px = 0.5;   // by errors of the pose, an edge may seem to move so far
  static constexpr double kLong_px = 8;       // of a shorter edge, blur reaches the middle half
  static constexpr double kHidden = 0.1;      // share of its usual events seen at a hidden edge, made by what hides it
  static constexpr double kMost = 3;          // limit of an edge's log ratio if hidden: its contrast may have changed
  static constexpr double kKept = 0.9;        // of the history, at every evaluation
  static constexpr double kLeastRate = 1e-6;  // [1/px^2]
  static constexpr double kGrazing = 0.3;     // cosine of the angle between a side's normal and the line of sight

  // An edge in the image: its middle, and the vector from one end to the other; zero while it is not visible.
  struct Edge {
    Vec2 middle, along;  // [px]
    double dark = 0;     // positive if the dark side is on the right of `along` in the image, negative on the left
  };
  // Events matched to an edge, and how many of them are ON.
  struct Count {
    int events = 0, on = 0;
  };
  struct Activity {
    double events = 0, swept_px2 = 0;
  };

  // True if the edges rest and there are twice as many events as they make over a pixel of motion. If these were kept,
  // they would later be taken for the edges' own. False while edges move: a pixel may then make more events than
  // before.
  bool events_are_background(double swept_px2, double length_px) const noexcept {
    double all = 0;
    for (std::size_t i = 0; i < end_.size(); ++i)
      if (in_sight(i)) all += counts_[i].events;
    return mean_rate_ > 0 && swept_px2 < kRest_px * length_px && all > 2 * mean_rate_ * length_px;
  }

  // Sums up what all edges tell of the interval, and adds their events to their histories.
  Interval judge_motion(double swept_px2) noexcept {
    // All events, and those that confirm the motion: the sum of n min(1, n / expected) over edges of n events.
    double all = 0, confirming = 0;
    for (std::size_t i = 0; i < end_.size(); ++i) {
      if (!in_sight(i)) continue;
      all += counts_[i].events;
      if (swept(i) > 0) confirming += counts_[i].events * std::min(1.0, counts_[i].events / (rate(i) * swept(i)));
    }
    mean_rate_ += (mean_rate_ > 0 ? 0.1 : 1) * (all / swept_px2 - mean_rate_);
    // Motion counts only as far as the edges that do make events confirm it: after a motion that was only predicted, no
    // edge counts as silent.
    const double confirmed = all > 0 ? confirming / all : 0;
    std::ranges::fill(markers_, MarkerActivity());
    Interval interval{.markers = markers_};
    for (std::size_t i = 0; i < end_.size(); ++i) {
      MarkerActivity& marker = markers_[marker_of_[i]];
      marker.in_sight += in_sight(i);
      const double length_px = norm(end_[i].along), jitter = kJitter_px * length_px;
      const double swept = this->swept(i), confirmed_swept = confirmed * swept;
      // Of an edge that hardly moved across itself, neither its silence nor its rate is known.
      if (!(swept > jitter)) continue;
      if (end_[i].dark != 0 && goes_on(i)) {
        interval.events += counts_[i].events;
        interval.contradicting += contradicting(i);
      }
      const double log_ratio = confirmed_swept > jitter && expected_to_make_events(i, length_px)
                                   ? evidence_of_edge(i, confirmed_swept, jitter)
                                   : 0;
      marker.log_ratio_hidden += log_ratio;
      if (log_ratio > 0) continue;  // a hidden edge's events do not show its usual rate
      history_[i].events = kKept * history_[i].events + confirmed * counts_[i].events;
      history_[i].swept_px2 = kKept * history_[i].swept_px2 + confirmed_swept;
    }
    return interval;
  }

  // Log likelihood ratio of an edge's events: that half of the edges are hidden, and this one with even odds, against
  // that none is.
  // The events of one pixel in one passage come together, so that passed pixels are counted, Poisson distributed:
  // `swept` - `jitter` are expected at least of an edge in sight, kHidden times as many of a hidden one.
  double evidence_of_edge(std::size_t i, double swept, double jitter) const noexcept {
    const double passed = counts_[i].events / rate(i);
    const double log_ratio_if_hidden = (1 - kHidden) * (swept - jitter) + std::log(kHidden) * passed;
    return std::log(0.5 + 0.5 * std::exp(std::clamp(log_ratio_if_hidden, -kMost, kMost)));
  }

  // True if all of an edge moved to one side, which an edge that turns about its middle does not, and to the same as in
  // the interval before: just after the motion has turned, late events are still those of the way before.
  bool goes_on(std::size_t i) const noexcept {
    const double swept = swept_to_right(i);
    return swept * swept_before_[i] > 0 && swept * swept_to_right(i, -0.5) > 0 && swept * swept_to_right(i, 0.5) > 0;
  }

  // Events whose polarity contradicts the edge's motion. If there are surely more events than the motion makes, it went
  // to and fro, and half of those beyond come from the way back.
  double contradicting(std::size_t i) const noexcept {
    const double events = counts_[i].events, expected = rate(i) * swept(i);
    // Of a Poisson distributed number of passages with Poisson distributed numbers of events, mean_rate_ on average.
    const double deviation = std::sqrt((1 + mean_rate_) * expected);
    const double on_way_back = events > expected + 2 * deviation ? (events - expected) / 2 : 0;
    const bool toward_dark = swept_to_right(i) * end_[i].dark > 0;
    return std::max(0.0, (toward_dark ? events - counts_[i].on : counts_[i].on) - on_way_back);
  }

  // Events per swept area: by the edge's own history, and before there is enough of it by the mean of all edges.
  double rate(std::size_t i) const noexcept {
    const double prior_px2 = 0.5 * norm(end_[i].along);  // worth half a pixel of motion
    return std::max(kLeastRate, (history_[i].events + prior_px2 * mean_rate_) / (history_[i].swept_px2 + prior_px2));
  }
  // True if an edge without events is evidence: at once on a printed marker, on any other body after enough motion.
  bool expected_to_make_events(std::size_t i, double length_px) const noexcept {
    return dark_sides_known_ || history_[i].swept_px2 > 3 * length_px;
  }

  // An edge in the image. Without length if a part of it is out of the image, or if its face is turned away, or nearly
  // so: edges of such a face are too close to each other to know which of them made an event.
  Edge project(const MarkerModel& model, const MarkerSegment& segment, const Eigen::Isometry3d& T) const noexcept {
    const Vec3 from = model.vertices[static_cast<std::size_t>(segment.from)],
               to = model.vertices[static_cast<std::size_t>(segment.to)], seen_at = transform(T, from),
               face_normal = segment.face_normal;
    const double toward_camera = -dot(rotate(T, face_normal), seen_at);
    if (face_normal != Vec3() && toward_camera < kGrazing * norm(seen_at)) return {};
    const Vec2 m_from = on_plane(seen_at), m_to = on_plane(transform(T, to));
    if (!(image_.contains(m_from) && image_.contains(m_to))) return {};
    const Vec2 a = focal_length_ * m_from, b = focal_length_ * m_to;
    const double dark = dot(rotate(T, cross(to - from, segment.dark_side)), seen_at);
    return {(a + b) / 2, b - a, dark};
  }

  // True if an edge was in sight at the begin of the interval, and is at its end.
  bool in_sight(std::size_t i) const noexcept { return begin_[i].along != Vec2() && end_[i].along != Vec2(); }

  // Area that an edge swept [px^2]: its length times the motion of its middle along its normal.
  double swept(std::size_t i) const noexcept { return std::abs(swept_to_right(i)); }
  // The same, positive if the edge moved to the right of its direction; by the motion of the point that lies the share
  // `place` of its length from its middle.
  double swept_to_right(std::size_t i, double place = 0) const noexcept {
    if (!in_sight(i)) return 0;
    const Edge &end = end_[i], &begin = begin_[i];
    const Vec2 way = end.middle + place * end.along - begin.middle - place * begin.along;
    return way.y * end.along.x - way.x * end.along.y;
  }

  void measure_contrasts(std::span<const std::uint32_t> middle_events) noexcept {
    for (std::size_t i = 0; i < end_.size(); ++i) {
      const double length_px = norm(end_[i].along), swept = swept_to_right(i);
      if (end_[i].dark == 0 || length_px < kLong_px || !(std::abs(swept) > kJitter_px * length_px)) continue;
      contrasts_.add(i, middle_events[i] - middle_events_[i], std::abs(swept) / 2, length_px / 2,
                     swept * end_[i].dark > 0);
    }
    contrasts_.evaluate();
  }

  // Begins a new interval with the edges in `end_`.
  void begin_interval(Timestamp t, std::span<const std::uint32_t> middle_events) noexcept {
    forget_events();
    for (std::size_t i = 0; i < end_.size(); ++i) swept_before_[i] = swept_to_right(i);
    std::swap(begin_, end_);
    begin_t_ = t;
    std::ranges::copy(middle_events, middle_events_.begin());
  }

  void forget_events() noexcept {
    total_ = 0;
    std::ranges::fill(counts_, Count());
  }

  double focal_length_;
  Box image_;
  int events_to_evaluate_;              // from one evaluation to the next: some for every edge
  bool dark_sides_known_ = true;        // of all edges, as on printed markers: one mean rate will do for all
  std::vector<std::size_t> marker_of_;  // of every segment
  std::vector<MarkerActivity> markers_;
  std::vector<Count> counts_;  // of every segment, in this interval
  std::vector<Activity> history_;
  std::vector<std::uint32_t> middle_events_;  // of every segment, at the begin of the interval, modulo 2^32
  EdgeContrasts contrasts_;
  std::vector<double> swept_before_;  // by every edge in the interval before, as `swept_to_right`
  std::vector<Edge> begin_, end_;     // the edges at the begin and the end of the interval; none before the first
  Timestamp begin_t_ = 0;
  double mean_rate_ = 0;  // events per swept px^2, so per pixel passed; 0 before the first evaluation
  int total_ = 0;         // events since the last call of `evaluate` or `restart`
};

}  // namespace evmarker
