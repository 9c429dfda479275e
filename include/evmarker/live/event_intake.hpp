#pragma once
// The bounded queue between a camera's thread and the tracking thread, and its policies where it is full.
#include <readerwriterqueue/readerwritercircularbuffer.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"

namespace evmarker::live {

using Clock = std::chrono::steady_clock;

/// What to do with events that come faster than they are tracked. Whatever is dropped is counted.
enum class OverloadPolicy {
  block,        ///< `push` waits: for files, which can wait and must not lose anything
  drop_oldest,  ///< the oldest events in the queue are dropped: poses stay recent, with gaps in between
  thin  ///< the fuller the queue, the fewer events are kept, evenly spread: poses without gaps, from fewer events
};

/// Up to 256 events that were pushed together.
struct EventBlock {
  static constexpr std::size_t kCapacity = 256;
  Clock::time_point pushed;      ///< when
  std::uint64_t number = 0;      ///< of the block, counted from 1 since the start
  bool follows_dropped = false;  ///< events pushed right before it were dropped, as the queue had no room
  std::size_t size = 0;
  std::array<Event, kCapacity> events;

  std::span<const Event> span() const noexcept { return {events.data(), size}; }
  /// Times of the first and the last event [us]. Where that is far from its neighbour's, it is taken for wrong, and the
  /// neighbour's is returned.
  Timestamp first_t() const noexcept { return size > 1 && apart(0, 1) ? events[1].t : events[0].t; }
  Timestamp last_t() const noexcept {
    return size > 1 && apart(size - 2, size - 1) ? events[size - 2].t : events[size - 1].t;
  }

 private:
  bool apart(std::size_t i, std::size_t j) const noexcept {
    constexpr std::uint64_t kApart_us = 10000;
    return elapsed_us(std::min(events[i].t, events[j].t), std::max(events[i].t, events[j].t)) > kApart_us;
  }
};

/// A queue into which any threads push and from which one takes. All memory is allocated in the constructor. It is
/// closed at first.
class EventIntake {
 public:
  /// @param capacity most events in the queue; a push of less than a block's 256 events takes the room of a block
  /// @param gap camera time without events that counts as a gap
  /// @throws std::invalid_argument if the capacity is less than four blocks or the gap is not positive
  EventIntake(std::size_t capacity, OverloadPolicy policy, std::chrono::microseconds gap)
      : policy_(policy),
        gap_us_(static_cast<std::uint64_t>(gap.count())),
        blocks_(capacity / EventBlock::kCapacity),
        free_(std::max<std::size_t>(blocks_.size(), 1)),
        full_(std::max<std::size_t>(blocks_.size(), 1)),
        triggers_(kTriggers) {
    if (blocks_.size() < 4)
      throw std::invalid_argument("pipeline: queue_events is " + std::to_string(capacity) + ", less than " +
                                  std::to_string(4 * EventBlock::kCapacity));
    if (gap.count() <= 0) throw std::invalid_argument("pipeline: gap [us] is " + std::to_string(gap.count()));
    for (EventBlock& block : blocks_) free_.try_enqueue(&block);
  }

  /// Takes in events, in order. Waits only with the policy `block`. While closed, drops all.
  template <EventLike E>
  void push(std::span<const E> events) {
    if (!open_) {  // without the lock: a camera that goes on pushing must not keep `clear` from it
      refused_ += events.size();
      return;
    }
    const std::lock_guard lock(push_mutex_);
    const auto now = Clock::now();
    pushed_ += events.size();
    while (!events.empty()) {
      EventBlock* const block = open_ ? free_block() : nullptr;
      if (block == nullptr) {
        events = drop(events);
        continue;
      }
      block->pushed = now;
      events = fill(*block, events);
      if (block->size > 0) {
        block->number = ++last_block_;
        block->follows_dropped = std::exchange(dropping_, false);
        full_.try_enqueue(block);  // cannot fail: it has room for all blocks
      } else {
        spare_ = block;
      }
    }
  }

  /// Takes in a trigger event, between the events pushed before and after it. Where there is no room, waits with the
  /// policy `block`, else drops it. While closed, drops it.
  void push(const TriggerEvent& trigger) {
    const std::lock_guard lock(push_mutex_);
    ++triggers_pushed_;
    while (open_) {
      if (triggers_.try_enqueue({trigger, last_block_})) return;
      if (policy_ != OverloadPolicy::block) break;
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ++triggers_dropped_;
  }

  /// Takes the next block of events; null if none comes within the timeout. The block must be given back.
  EventBlock* take(std::chrono::microseconds timeout) {
    EventBlock* block = nullptr;
    const std::lock_guard lock(take_mutex_);
    return full_.wait_dequeue_timed(block, timeout) ? block : nullptr;
  }

  /// Returns a block that was taken.
  void give_back(EventBlock* block) { free_.try_enqueue(block); }

  /// Takes the next trigger event if it was pushed before the block of this number.
  std::optional<TriggerEvent> take_trigger(std::uint64_t block_number) {
    if (!next_trigger_) {
      PlacedTrigger next;
      if (!triggers_.try_dequeue(next)) return std::nullopt;
      next_trigger_ = next;
    }
    if (next_trigger_->after_block >= block_number) return std::nullopt;
    return std::exchange(next_trigger_, std::nullopt)->trigger;
  }

  /// Opens the queue and sets all counters to zero. No thread may be taking.
  void open() {
    const std::lock_guard lock(push_mutex_);
    pushed_ = dropped_ = refused_ = time_steps_back_ = time_gaps_ = triggers_pushed_ = triggers_dropped_ = 0;
    last_block_ = 0;
    dropping_ = any_ = false;
    open_ = true;
  }

  /// Drops what is pushed from now on. A `push` that waits returns within 10 ms.
  void close() noexcept { open_ = false; }

  /// Drops what is in the queue. No thread may be taking.
  void clear() {
    const std::lock_guard lock(push_mutex_);
    while (EventBlock* const block = take(std::chrono::microseconds(0))) {
      count_dropped(block->size);
      give_back(block);
    }
    while (take_trigger(std::numeric_limits<std::uint64_t>::max())) ++triggers_dropped_;
  }

  /// Counts events as dropped, also those of a block that the taker did not use.
  void count_dropped(std::size_t events) noexcept { dropped_ += events; }

  std::uint64_t pushed() const noexcept { return pushed_ + refused_; }
  std::uint64_t dropped() const noexcept { return dropped_ + refused_; }
  std::uint64_t time_steps_back() const noexcept { return time_steps_back_; }
  std::uint64_t time_gaps() const noexcept { return time_gaps_; }
  std::uint64_t triggers_pushed() const noexcept { return triggers_pushed_; }
  std::uint64_t triggers_dropped() const noexcept { return triggers_dropped_; }
  /// Camera time of the last event pushed [us].
  Timestamp last_t() const noexcept { return last_t_; }

 private:
  struct PlacedTrigger {
    TriggerEvent trigger;
    std::uint64_t after_block = 0;  // number of the last block pushed before it
  };
  using Queue = moodycamel::BlockingReaderWriterCircularBuffer<EventBlock*>;
  static constexpr std::size_t kTriggers = 4096;  // most in the queue

  // An empty block; if there is none, makes room as the policy says. Null if the events are to be dropped.
  EventBlock* free_block() {
    if (spare_ != nullptr) return std::exchange(spare_, nullptr);
    EventBlock* block = nullptr;
    while (!free_.try_dequeue(block)) {
      if (policy_ == OverloadPolicy::thin || !open_) return nullptr;
      if (policy_ == OverloadPolicy::block) {
        if (free_.wait_dequeue_timed(block, std::chrono::milliseconds(5))) return block;
        continue;
      }
      // Only one thread may take from the queue at a time. The tracking thread holds this lock while it waits for a
      // block; as the queue is full, it does not wait now, and the lock is soon free.
      const std::lock_guard lock(take_mutex_);
      if (!full_.try_dequeue(block)) continue;
      count_dropped(block->size);
      return block;
    }
    return block;
  }

  // Fills a block with events, thinned as the policy says. Returns those that did not fit.
  template <EventLike E>
  std::span<const E> fill(EventBlock& block, std::span<const E> events) {
    const double share = policy_ == OverloadPolicy::thin ? share_to_keep() : 1;
    block.size = 0;
    std::size_t i = 0;
    for (; i < events.size() && block.size < EventBlock::kCapacity; ++i) {
      const Event event = to_event(events[i]);
      note_time(event.t);
      thinning_ += share;
      if (thinning_ < 1) continue;
      thinning_ -= 1;
      block.events[block.size++] = event;
    }
    count_dropped(i - block.size);
    return events.subspan(i);
  }

  // The share of events that thinning keeps: all up to a quarter of the queue, none when it is full.
  double share_to_keep() const noexcept {
    const double full = static_cast<double>(full_.size_approx()) / static_cast<double>(blocks_.size());
    return std::clamp((1 - full) / 0.75, 0.0, 1.0);
  }

  // Drops up to a block of events, after which there may be room again. Returns the others.
  template <EventLike E>
  std::span<const E> drop(std::span<const E> events) {
    const std::size_t count = std::min(events.size(), EventBlock::kCapacity);
    for (const E& event : events.first(count)) note_time(EventTraits<E>::t(event));
    count_dropped(count);
    dropping_ = true;
    return events.subspan(count);
  }

  void note_time(Timestamp t) noexcept {
    const Timestamp last = last_t_.load(std::memory_order_relaxed);
    if (any_ && t < last) ++time_steps_back_;
    if (any_ && t > last && elapsed_us(last, t) >= gap_us_) ++time_gaps_;
    last_t_.store(t, std::memory_order_relaxed);
    any_ = true;
  }

  OverloadPolicy policy_;
  std::uint64_t gap_us_;
  std::vector<EventBlock> blocks_;
  Queue free_;  // from the taker to the pusher
  Queue full_;  // from the pusher to the taker
  moodycamel::BlockingReaderWriterCircularBuffer<PlacedTrigger> triggers_;
  std::optional<PlacedTrigger> next_trigger_;  // taken from the queue, but not yet due; used by the taker
  std::mutex push_mutex_, take_mutex_;
  EventBlock* spare_ = nullptr;  // an empty block that thinning left unused
  std::uint64_t last_block_ = 0;
  bool dropping_ = false;  // events were dropped since the last block
  double thinning_ = 0;    // sum of the shares to keep, less the events kept
  bool any_ = false;       // an event was pushed: last_t_ is known
  std::atomic<bool> open_{false};
  // An event is counted as pushed before it is counted as anything else. Events refused while closed count as both
  // pushed and dropped.
  std::atomic<std::uint64_t> pushed_{0}, dropped_{0}, refused_{0}, time_steps_back_{0}, time_gaps_{0},
      triggers_pushed_{0}, triggers_dropped_{0};
  std::atomic<Timestamp> last_t_{0};
};

}  // namespace evmarker::live
