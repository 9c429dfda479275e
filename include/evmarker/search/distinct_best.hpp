#pragma once
// The best nodes of a search over a grid, without those that lie beside a better one.
#include <array>
#include <cstddef>
#include <cstdlib>

namespace evmarker {

/// The nodes of a 4-D grid with the highest scores. A node beside a better one is left out, as refining either would
/// lead to the same optimum.
class DistinctBest {
 public:
  static constexpr std::size_t kMost = 8;  ///< number of nodes kept

  struct Node {
    std::array<int, 4> place{};  ///< [steps]
    int score = 0;
  };

  /// Removes all nodes.
  /// @param beside two nodes are beside each other if they are at most so many steps apart along every axis
  void restart(int beside) noexcept {
    beside_ = beside;
    count_ = 0;
  }

  /// Inserts a node in the order of scores, unless it lies beside one that is at least as good. It replaces the best of
  /// the worse nodes beside it (further ones stay), or else, if all kMost are taken, the last node.
  void add(const Node& node) noexcept {
    if (count_ == kMost && node.score <= nodes_[kMost - 1].score) return;
    std::size_t at = 0;
    for (; at < count_ && nodes_[at].score >= node.score; ++at)
      if (beside(nodes_[at], node)) return;
    std::size_t replaced = at;
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

  /// The nodes by descending score.
  std::size_t size() const noexcept { return count_; }
  const Node& operator[](std::size_t i) const noexcept { return nodes_[i]; }

 private:
  bool beside(const Node& a, const Node& b) const noexcept {
    for (std::size_t axis = 0; axis < a.place.size(); ++axis)
      if (std::abs(a.place[axis] - b.place[axis]) > beside_) return false;
    return true;
  }

  std::array<Node, kMost> nodes_{};  // by descending score
  std::size_t count_ = 0;
  int beside_ = 1;
};

}  // namespace evmarker
