#pragma once
// Pushes events to a tracker and takes the poses of all markers at fixed times in between.
#include <evmarker/events/tick_times.hpp>
#include <evmarker/evmarker.hpp>
#include <span>
#include <vector>

/// Calls `use(pose)` with each pose to which the events lead, and `on_tick(t, poses)` at every tick, with the poses of
/// all markers moved on to it.
template <typename AnyTracker, typename Use, typename OnTick>
void push_with_ticks(evmarker::TickTimes& ticks, AnyTracker& tracker, std::span<const evmarker::Event> events,
                     const Use& use, const OnTick& on_tick) {
  ticks.begin(events.front().t, events.back().t);
  while (!events.empty()) {
    while (const auto t = ticks.take_due(events.front().t)) {
      std::vector<evmarker::PoseEstimate> poses;
      for (const auto& marker : tracker.markers())
        poses.push_back(*t > marker.estimate().t ? marker.pose_at(*t, *t) : marker.estimate());
      on_tick(*t, std::span<const evmarker::PoseEstimate>(poses));
    }
    const auto until_tick = ticks.before_next(events);
    tracker.push(until_tick, use);
    events = events.subspan(until_tick.size());
  }
}
