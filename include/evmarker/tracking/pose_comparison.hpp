#pragma once
// Compares which of two similar-looking poses explains the events better.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "evmarker/simd/pack.hpp"

namespace evmarker {

/// How far an event lies from where the nearest edge of a pose makes events.
struct EdgeResidual {
  int segment = -1;  ///< of the model; -1 where the pose has no edge near
  double px = 0;     ///< signed, and limited; the limit itself where there is no edge
};

/// Compares by how much nearer each event lies to the edges of one pose than to those of the other. The difference is
/// judged twice, and must be beyond chance both times:
///
/// By events, against the variance that their sum has if neither pose is nearer. Events of one passage of an edge err
/// together; sums of 64 events are assumed to be independent.
///
/// By edges, as no number of events averages out what a whole edge is off by. At the right pose, the mean residuals of
/// k edges are only these errors, of a variance that is not known. With S1 and S2 the mean squares at the two poses,
/// and that variance fitted to each, the logarithm of the likelihood ratio is k / 2 ln(S2 / S1). As for a normal
/// distribution, z^2 / 2 of it stands for z standard deviations. Once events are averaged out, it goes up and down only
/// as the errors change with the motion. Each doubling of the events makes nearly new means, and so is another test:
/// the evidence that is asked for rises by the logarithm of the number of tests. An event counts for the edges of those
/// poses only that have an edge near it.
class PoseComparison {
 public:
  /// Adds one event, by its residuals at the first and at the second pose. An event at equal distances does not count.
  void add(const EdgeResidual& first, const EdgeResidual& second) noexcept {
    const double difference_px2 = second.px * second.px - first.px * first.px;
    if (difference_px2 == 0) return;
    first_.add(first);
    second_.add(second);
    group_ += difference_px2;
    if (++events_ % kTogether != 0) return;
    sum_ += group_;
    variance_ += group_ * group_;
    group_ = 0;
  }

  /// How many events count.
  std::int64_t events() const noexcept { return events_; }
  bool second_is_nearer() const noexcept { return sum_ < 0; }

  /// True once events and edges both are beyond chance, and agree.
  bool decided() const noexcept {
    if (std::abs(z_by_events()) < kBeyondChance) return false;
    const double by_edges = z_by_edges(),
                 tests = 1 + std::max(0.0, std::log2(static_cast<double>(events_) / kAveragedOut));
    return by_edges * by_edges / 2 > kLogRatioOfEdges + std::log(tests) && (by_edges < 0) == second_is_nearer();
  }
  /// Probability that the second pose is the right one; 1/2 while there are too few events, or events and edges
  /// disagree.
  double probability_of_second() const noexcept {
    const double by_events = z_by_events(), by_edges = z_by_edges();
    if (by_events * by_edges <= 0) return 0.5;
    const double z = std::min(std::abs(by_events), std::abs(by_edges));
    return std::erfc(std::copysign(z, by_events) / std::numbers::sqrt2) / 2;
  }

 private:
  static constexpr double kBeyondChance = 4;     // standard deviations
  static constexpr double kLogRatioOfEdges = 2;  // two standard deviations, at the first opportunity
  static constexpr double kAveragedOut = 16384;  // events: some hundred passages of every edge
  static constexpr int kTogether = 64;
  static constexpr int kFewest = 16 * kTogether;  // with fewer sums, z cannot reach kBeyondChance
  static constexpr double kSmallest = 1e-12;

  // Sums of the residuals of each edge; those whose numbers are equal modulo 64 count as one.
  class Edges {
   public:
    void add(const EdgeResidual& residual) noexcept {
      if (residual.segment >= 0)
        edges_[static_cast<std::size_t>(residual.segment) % kEdges] += simd::Pair{residual.px, 1};
    }
    struct Scatter {
      double px2;    // mean over the events of the squared mean residual of their edge
      double edges;  // how many edges this effectively is of
    };
    Scatter scatter() const noexcept {
      double squares = 0, events = 0, events2 = 0;
      for (const simd::Pair& edge : edges_)
        if (edge[1] > 0) {
          squares += edge[0] * edge[0] / edge[1];
          events += edge[1];
          events2 += edge[1] * edge[1];
        }
      return events > 0 ? Scatter{squares / events, events * events / events2} : Scatter{0, 0};
    }

   private:
    static constexpr std::size_t kEdges = 64;
    std::array<simd::Pair, kEdges> edges_{};  // of each, the sum of its residuals [px], and their number
  };

  // By how many standard deviations the first pose is better; 0 while there are too few events.
  double z_by_events() const noexcept { return events_ >= kFewest ? sum_ / std::sqrt(variance_ + kSmallest) : 0; }
  double z_by_edges() const noexcept {
    const auto [px2, edges] = first_.scatter();
    const auto [other_px2, other_edges] = second_.scatter();
    const double log_ratio = std::log((other_px2 + kSmallest) / (px2 + kSmallest));
    return std::copysign(std::sqrt(std::min(edges, other_edges) * std::abs(log_ratio)), log_ratio);
  }

  Edges first_, second_;
  std::int64_t events_ = 0;
  double group_ = 0, sum_ = 0, variance_ = 0;
};

}  // namespace evmarker
