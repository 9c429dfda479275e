#pragma once
// Concepts of event sources and event filters, and loops over their events.
#include <array>
#include <concepts>
#include <cstddef>
#include <ranges>
#include <span>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// A recording, a camera or a simulation that is read batch by batch. `next_batch()` blocks until there are events and
/// returns a span that stays valid until the next call; an empty span is the end.
template <typename S>
concept EventSource = requires(S& source, const S& constant) {
  typename S::event_type;
  requires EventLike<typename S::event_type>;
  { constant.sensor_size() } -> std::same_as<SensorSize>;
  { source.next_batch() } -> std::convertible_to<std::span<const typename S::event_type>>;
};

/// A filter: `accept(event)`, called with all events in order of arrival, returns true for those to keep.
template <typename F>
concept EventFilter = requires(F& filter, const Event& event) {
  { filter.accept(event) } -> std::same_as<bool>;
};

/// The filter that accepts every event.
struct AcceptAll {
  constexpr bool accept(const Event&) noexcept { return true; }
};

/// Calls `use(event)` for every event of the source, in order.
template <EventSource Source, std::invocable<const typename Source::event_type&> Use>
void for_each_event(Source& source, Use&& use) {
  for (auto batch = source.next_batch(); !std::ranges::empty(batch); batch = source.next_batch())
    for (const auto& event : batch) use(event);
}

/// Calls `use(block)` with spans of `Event` that together are all events of a range, in order. A contiguous range of
/// `Event` is a single block; events of other ranges are converted and copied in blocks of up to 256.
template <std::ranges::input_range Events, std::invocable<std::span<const Event>> Use>
requires EventLike<std::ranges::range_value_t<Events>>
void for_each_block(Events&& events, const Use& use) {
  if constexpr (std::ranges::contiguous_range<Events> && std::same_as<std::ranges::range_value_t<Events>, Event>) {
    use(std::span<const Event>(events));
  } else {
    std::array<Event, 256> block;
    std::size_t count = 0;
    for (auto&& event : events) {
      block[count++] = to_event(event);
      if (count < block.size()) continue;
      use(std::span<const Event>(block));
      count = 0;
    }
    if (count > 0) use(std::span<const Event>(block).first(count));
  }
}

}  // namespace evmarker
