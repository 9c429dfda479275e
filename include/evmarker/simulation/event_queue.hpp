#pragma once
// Brings events that come in any order into the order of time.
#include <algorithm>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Events that wait until no earlier one can come. Their times [us] are exact: events of one microsecond are sorted
/// too, and those of one instant by place.
class EventQueue {
 public:
  void push(double t, const Event& event) { waiting_.push_back({t, event}); }

  /// Appends to `out`, in order, the events before a time.
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
