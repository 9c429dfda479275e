#pragma once
// Sorts events that come in any order by time.
#include <algorithm>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Holds events until no earlier one can come, and releases them in order of time. Their times [us] have fractions, so
/// that events within a microsecond are sorted too; events at exactly the same time are sorted by row and column.
class EventQueue {
 public:
  /// @param t exact time of the event [us]
  void push(double t, const Event& event) { waiting_.push_back({t, event}); }

  /// Moves the events before a time to the end of `out`, in order. No earlier event may be pushed later.
  void release(double until_us, std::vector<Event>& out) {
    const auto due =
        std::partition(waiting_.begin(), waiting_.end(), [&](const Entry& entry) { return entry.t >= until_us; });
    std::sort(due, waiting_.end(), [](const Entry& a, const Entry& b) {
      if (a.t != b.t) return a.t < b.t;
      return a.event.y != b.event.y ? a.event.y < b.event.y : a.event.x < b.event.x;
    });
    for (auto entry = due; entry != waiting_.end(); ++entry) out.push_back(entry->event);
    waiting_.erase(due, waiting_.end());
  }

 private:
  struct Entry {
    double t;
    Event event;
  };
  std::vector<Entry> waiting_;
};

}  // namespace evmarker
