#pragma once
// Which of the events that match edges come from moving edges, and which are background.

namespace evmarker {

/// Share of the matched events that come from moving edges.
struct MovingShare {
  double likely = 0;  ///< as it was measured
  double least = 0;   ///< it surely is at least this much
};

/// Which of the matched events do not come from the edges that they match.
struct MatchedBackground {
  /// Weight of the matched events: 1 if at least half of them are surely of moving edges, 0 at rest.
  double signal_weight = 1;
  /// Events that match an edge by chance, whatever made them: noise, things around the marker, its other edges [1/s].
  double by_chance_per_s = 0;
  /// Those of them that are noise: they come while the marker is at rest, too [1/s].
  double noise_per_s = 0;
  /// Share of the matched events that are noise, at most.
  double noise_share = 0;
};

}  // namespace evmarker
