#pragma once
// The best nodes of a search over a grid, of which none lies beside a better one.
#include <array>
#include <cstddef>
#include <cstdlib>

namespace evmarker {

/// The best places of a 4-D grid by score. Those beside a better one lead to the same end: they are left out.
class DistinctBest {
 public:
  static constexpr std::size_t kMost = 8;

  struct Node {
    std::array<int, 4> place{};  ///< [steps]
    int score = 0;
  };

  /// @param beside nodes up to this number of steps apart along every axis are beside each other
  void restart(int beside) noexcept {
    beside_ = beside;
    count_ = 0;
  }

  void add(const Node& node) noexcept {
    if (count_ == kMost && node.score <= nodes_[kMost - 1].score) return;
    std::size_t at = 0;
    for (; at < count_ && nodes_[at].score >= node.score; ++at)
      if (beside(nodes_[at], node)) return;
    std::size_t replaced = at;  // the best of those beside it, or else the last
    while (replaced < count_ && !beside(nodes_[replaced], node)) ++replaced;
    if (replaced == count_) {
      if (count_ < kMost)
        ++count_;
      else
        --replaced;
    }
    for (; replaced > at; --replaced) nodes_[replaced] = nodes_[replaced - 1];
    nodes_[at] = node;
  }

  std::size_t size() const noexcept { return count_; }
  const Node& operator[](std::size_t i) const noexcept { return nodes_[i]; }

 private:
  bool beside(const Node& a, const Node& b) const noexcept {
    for (std::size_t axis = 0; axis < a.place.size(); ++axis)
      if (std::abs(a.place[axis] - b.place[axis]) > beside_) return false;
    return true;
  }

  std::array<Node, kMost> nodes_{};  // best first
  std::size_t count_ = 0;
  int beside_ = 1;
};

}  // namespace evmarker
