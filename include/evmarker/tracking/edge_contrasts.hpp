#pragma once
// Contrast of each edge beside that of the others, from the events that pixels make while it passes.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <span>
#include <vector>

namespace evmarker {

/// Measures the contrast of each edge, relative to the mean of all. A pixel makes an event for each step of the
/// logarithm of light, so that the events of an edge per area that it sweeps are proportional to the logarithm of its
/// contrast, and so is the edge offset: 0.28 times the blur (standard deviation) and the logarithm of the contrast,
/// within a twentieth from 1.3:1 to 40:1. ON and OFF steps differ, so that edges are compared with those that move the
/// same way: into their dark side, which makes ON events, or out of it.
class EdgeContrasts {
 public:
  explicit EdgeContrasts(std::size_t edges) : edges_(edges), differences_(edges), contrasts_(edges, 1.0f) {}

  /// Adds what an edge did in an interval in which it moved.
  /// @param events in the middle half of the edge: blur rounds its ends
  /// @param swept_px2 area that the middle half swept
  /// @param length_px of the middle half
  void add(std::size_t edge, double events, double swept_px2, double length_px, bool into_dark) noexcept {
    Edge& e = edges_[edge];
    Sums& all = all_[into_dark];
    const double usual = all.swept_px2 > 0 ? all.events / all.swept_px2 : events / swept_px2;
    // What hides an edge does not show its contrast.
    if (e.swept_px2 > kKnown_px * length_px && events < kHidden * e.contrast() * usual * swept_px2) return;
    all.events += events;
    all.swept_px2 += swept_px2;
    e.length_px = length_px;
    e.events = kKept * e.events + events;
    e.expected = kKept * e.expected + usual * swept_px2;
    e.swept_px2 = kKept * e.swept_px2 + swept_px2;
  }

  /// Ends an interval.
  void evaluate() noexcept {
    for (Sums& sums : all_) {
      sums.events *= kKept;
      sums.swept_px2 *= kKept;
    }
    double contrast_px = 0, length_px = 0;
    for (const Edge& e : edges_) {
      contrast_px += e.contrast() * e.length_px;
      length_px += e.length_px;
    }
    const double inverse_mean = contrast_px > 0 ? length_px / contrast_px : 0;
    double squares_px = 0;
    for (std::size_t i = 0; i < edges_.size(); ++i) {
      differences_[i] = difference(edges_[i], inverse_mean);
      squares_px += square(differences_[i]) * edges_[i].length_px;
    }
    // All edges of most markers have one contrast. What seems to be a difference there is error, and stays small.
    const double spread2 = length_px > 0 ? squares_px / length_px : 0;
    const double uneven = square(spread2) / (square(spread2) + square(square(kEven)));
    for (std::size_t i = 0; i < edges_.size(); ++i)
      if (const double contrast = 1 + uneven * differences_[i]; std::isfinite(contrast))
        contrasts_[i] = static_cast<float>(contrast);
  }

  /// Of each edge, 1 in the mean.
  std::span<const float> contrasts() const noexcept { return contrasts_; }

 private:
  static constexpr double kKept = 0.99;   // of the sums, from one interval to the next
  static constexpr double kKnown_px = 3;  // motion after which the contrast of an edge is known well enough
  static constexpr double kHidden = 0.4;  // share of its usual events below which an edge seems to be hidden
  static constexpr double kLeast = 0.2, kMost = 5;
  static constexpr double kEven = 0.15;    // root mean square of the differences from which on they are half believed
  static constexpr double kUnknown = 0.1;  // relative error that does not average out
  // Relative error falls with the way: a passage that is begun or not ended counts as one or none, and while the pose
  // settles, errors of a pixel or two are taken for motion.
  static constexpr double kWay_px = 10;
  static constexpr double kOfPassage = 0.2;  // relative variance of the events of one pixel in one passage

  static constexpr double square(double x) noexcept { return x * x; }

  struct Sums {
    double events = 0, swept_px2 = 0;
  };
  struct Edge {
    double events = 0, expected = 0, swept_px2 = 0, length_px = 0;

    double contrast() const noexcept { return expected > 0 ? events / expected : 1; }
  };

  // Of an edge's contrast from the mean, as far as it stands out against what is not known of it.
  static double difference(const Edge& edge, double inverse_mean) noexcept {
    if (!(edge.swept_px2 > 0)) return 0;
    const double measured = std::clamp(edge.contrast() * inverse_mean, kLeast, kMost) - 1;
    const double variance =
        square(kUnknown) + kOfPassage / edge.swept_px2 + square(kWay_px * edge.length_px / edge.swept_px2);
    return measured * square(measured) / (square(measured) + variance);
  }

  std::array<Sums, 2> all_{};  // of edges that move out of their dark side, and into it
  std::vector<Edge> edges_;
  std::vector<double> differences_;  // see difference()
  std::vector<float> contrasts_;
};

}  // namespace evmarker
