#pragma once
// Do the polarities of events fit the motion of the edges that they are matched to?
#include <algorithm>
#include <cmath>

namespace evmarker {

/// Judges a pose by how many events contradict its motion: an edge makes ON events while it moves toward its dark side,
/// OFF events while it moves away from it. At a wrong pose some of the events come from other edges than those that
/// they are matched to, and contradict the motion as often as not, even where all of them lie on edges.
class PolarityEvidence {
 public:
  /// Judges the events of an interval. Returns the logarithm of how much likelier they are at a wrong pose than at the
  /// right one; 0 in the first interval, which tells how many contradict by noise or flicker.
  /// @param events of edges that moved
  /// @param contradicting how many of them have the wrong polarity
  /// @param events_per_passage of one pixel, which come together and are one piece of evidence
  /// @param surely_followed learn the share of these events that contradicts as the usual one
  double log_likelihood_ratio(double events, double contradicting, double events_per_passage,
                              bool surely_followed) noexcept {
    if (events == 0) return 0;
    const double share = contradicting / events;
    const double right = std::clamp(usual_share_, kLeastUsual, kContradictByChance);
    const double wrong = right + kFromOtherEdges * (kContradictByChance - right);
    const double of_one = share * std::log(wrong / right) + (1 - share) * std::log((1 - wrong) / (1 - right));
    const bool first = known_events_ == 0;
    if (first || surely_followed) {
      known_events_ = std::min(known_events_ + events, kMemory);
      usual_share_ += std::min(1.0, events / known_events_) * (share - usual_share_);
    }
    return first ? 0 : events / std::max(1.0, events_per_passage) * of_one;
  }

 private:
  static constexpr double kFromOtherEdges = 0.2;      // least share of other edges' events at a wrong pose
  static constexpr double kContradictByChance = 0.5;  // share of those that contradict
  static constexpr double kLeastUsual = 0.01;
  static constexpr double kMemory = 50000;  // of usual_share_ [events]

  double usual_share_ = 0;   // of contradicting events
  double known_events_ = 0;  // it was measured with so many, limited to kMemory
};

}  // namespace evmarker
