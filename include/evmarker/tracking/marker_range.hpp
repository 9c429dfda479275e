#pragma once
// The trackers of several markers, as a range.
#include <cstddef>
#include <iterator>
#include <ranges>
#include <span>

#include "evmarker/tracking/planar_hypotheses.hpp"

namespace evmarker {

/// A view of the `MarkerTracker` of each marker; valid until markers are added or removed.
// Written out because Clang 14 cannot compile libstdc++'s views::transform.
template <PoseUpdateRule Rule>
class MarkerRange : public std::ranges::view_base {
 public:
  class iterator {
   public:
    using value_type = MarkerTracker<Rule>;
    using difference_type = std::ptrdiff_t;
    using iterator_concept = std::forward_iterator_tag;

    iterator() = default;
    explicit iterator(const PlanarHypotheses<Rule>* marker) noexcept : marker_(marker) {}
    const MarkerTracker<Rule>& operator*() const noexcept { return marker_->tracker(); }
    const MarkerTracker<Rule>* operator->() const noexcept { return &marker_->tracker(); }
    iterator& operator++() noexcept {
      ++marker_;
      return *this;
    }
    iterator operator++(int) noexcept { return iterator(marker_++); }
    bool operator==(const iterator&) const = default;

   private:
    const PlanarHypotheses<Rule>* marker_ = nullptr;
  };

  MarkerRange() = default;
  explicit MarkerRange(std::span<const PlanarHypotheses<Rule>> markers) noexcept : markers_(markers) {}
  iterator begin() const noexcept { return iterator(markers_.data()); }
  iterator end() const noexcept { return iterator(markers_.data() + markers_.size()); }
  std::size_t size() const noexcept { return markers_.size(); }
  bool empty() const noexcept { return markers_.empty(); }
  const MarkerTracker<Rule>& front() const noexcept { return *begin(); }

 private:
  std::span<const PlanarHypotheses<Rule>> markers_;
};

}  // namespace evmarker
