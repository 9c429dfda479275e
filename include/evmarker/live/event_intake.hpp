#pragma once
// The bounded queue between a camera's thread and the tracking thread, and what it does when it is full.
#include <readerwriterqueue/atomicops.h>
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
#include <ranges>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/live/event_block.hpp"

namespace evmarker::live {

/// What to do with events that come faster than they are tracked. Whatever is dropped is counted.
enum class OverloadPolicy {
  block,        ///< `push` waits: for files, which can wait and must not lose anything
  drop_oldest,  ///< the oldest events in the queue are dropped: poses stay recent, with gaps in between
  thin  ///< the fuller the queue, the fewer events are kept, evenly spread: poses without gaps, from fewer events
};

/// A bounded queue with any number of producers, the threads that push, and one consumer. All memory is allocated in
/// the constructor. It is closed at first.
class EventIntake {
 public:
  /// @param capacity most events in the queue
  /// @param gap camera time without events that counts as a gap
  /// @throws std::invalid_argument if the capacity is less than four blocks or the gap is not positive
  EventIntake(std::size_t capacity, OverloadPolicy policy, std::chrono::microseconds gap)
      : policy_(policy),
        gap_us_(static_cast<std::uint64_t>(gap.count())),
        blocks_(capacity / EventBlock::kCapacity),
        free_(std::max<std::size_t>(blocks_.size(), 1)),
        filled_(std::max<std::size_t>(blocks_.size(), 1)),
        triggers_(kTriggers) {
    if (blocks_.size() < 4)
      throw std::invalid_argument("pipeline: queue_events is " + std::to_string(capacity) + ", less than " +
                                  std::to_string(4 * EventBlock::kCapacity));
    if (gap.count() <= 0) throw std::invalid_argument("pipeline: gap [us] is " + std::to_string(gap.count()));
    for (EventBlock& block : blocks_) free_.try_enqueue(&block);
  }

  /// Appends events, in order. Waits for room only with the policy `block`, and not on the consumer thread, which alone
  /// makes room: there, events without room are dropped. While closed, drops all.
  template <std::ranges::input_range Events>
  requires EventLike<std::ranges::range_value_t<Events>>
  void push(Events&& events) {
    // A closed queue is left without taking the lock: a camera that goes on pushing would keep `clear` from getting it.
    const auto lock = open_ ? lock_for_push() : std::unique_lock<std::mutex>();
    if (!lock) return drop_before_queue(static_cast<std::uint64_t>(std::ranges::distance(events)));
    const auto now = Clock::now();
    for_each_block(events, [&](std::span<const Event> block) {
      pushed_ += block.size();
      for (std::size_t begin = 0; begin < block.size(); begin += EventBlock::kCapacity)
        enqueue(take_in(block.subspan(begin, std::min(block.size() - begin, EventBlock::kCapacity))), now);
    });
    wake_consumer();  // once, with all events in the queue: when it wakes, it may take the processor from this thread
  }

  /// Appends a trigger event, between the events pushed before and after it. Without room, waits with the policy
  /// `block`, but not on the consumer thread, and otherwise drops it. While closed, drops it.
  void push(const TriggerEvent& trigger) {
    const auto lock = lock_for_push();
    ++triggers_pushed_;
    while (lock && open_) {
      if (triggers_.try_enqueue({trigger, last_block_number_})) {
        ++triggers_taken_in_;
        last_block_ = nullptr;  // events after it go into another block
        return;
      }
      if (!may_wait()) break;
      const Waiting waiting(waiting_);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ++triggers_dropped_;
  }

  /// Sets which thread is the consumer; none: `std::thread::id()`.
  void set_consumer_thread(std::thread::id id) noexcept { consumer_thread_ = id; }
  bool on_consumer_thread() const noexcept { return consumer_thread_.load() == std::this_thread::get_id(); }

  /// Removes the next block of events from the queue, and closes the block, so that no push appends to it; null if none
  /// comes within the timeout. The caller owns the block until it calls `release`.
  EventBlock* pop(std::chrono::microseconds timeout) {
    EventBlock* block = try_pop();
    if (block != nullptr || timeout.count() <= 0) return block;
    // An exchange, as a fence: either a push sees the flag and wakes this thread, or its block is seen by the next
    // line.
    consumer_sleeps_.exchange(true);
    block = try_pop();
    const bool woken = block == nullptr && open_ && wake_.wait(timeout.count());
    // Whoever took the flag, a push or `close`, will signal: the signal is taken here, or the next wait would end at
    // once.
    if (!woken && !consumer_sleeps_.exchange(false)) wake_.wait();
    return block != nullptr ? block : try_pop();
  }

  /// Gives back a block that `pop` has returned.
  void release(EventBlock* block) { free_.try_enqueue(block); }

  /// Removes the next trigger event from its queue if it was pushed before the block of this number.
  std::optional<TriggerEvent> pop_trigger(std::uint64_t block_number) {
    if (!next_trigger_) {
      PlacedTrigger next;
      if (!triggers_.try_dequeue(next)) return std::nullopt;
      next_trigger_ = next;
    }
    if (next_trigger_->after_block >= block_number) return std::nullopt;
    return std::exchange(next_trigger_, std::nullopt)->trigger;
  }

  /// Opens the queue and sets all counters to zero. No thread may be popping.
  void open() {
    const std::lock_guard lock(push_mutex_);
    pushed_ = dropped_ = refused_ = time_steps_back_ = time_gaps_ = 0;
    triggers_pushed_ = triggers_taken_in_ = triggers_dropped_ = 0;
    last_block_number_ = 0;
    dropping_ = last_t_known_ = false;
    open_ = true;
  }

  /// Drops what is pushed from now on. A `push` that waits returns within 10 ms. A `pop` is woken, as its timeout is by
  /// the system's clock and lasts longer if that is set back.
  void close() noexcept {
    open_ = false;
    wake_consumer();
  }

  /// Drops what is in the queue. No other thread may be popping.
  void clear() {
    const std::lock_guard lock(push_mutex_);
    last_block_ = nullptr;
    while (EventBlock* const block = pop(std::chrono::microseconds(0))) {
      count_dropped(block->size());
      release(block);
    }
    while (pop_trigger(std::numeric_limits<std::uint64_t>::max())) ++triggers_dropped_;
  }

  /// Counts events as dropped, also those of a block that the consumer did not use.
  void count_dropped(std::size_t events) noexcept { dropped_ += events; }

  std::uint64_t pushed() const noexcept { return pushed_ + refused_; }
  std::uint64_t dropped() const noexcept { return dropped_ + refused_; }
  std::uint64_t time_steps_back() const noexcept { return time_steps_back_; }
  std::uint64_t time_gaps() const noexcept { return time_gaps_; }
  std::uint64_t triggers_pushed() const noexcept { return triggers_pushed_; }
  std::uint64_t triggers_taken_in() const noexcept { return triggers_taken_in_; }
  std::uint64_t triggers_dropped() const noexcept { return triggers_dropped_; }
  /// Number of the last block that was put into the queue; 0: none since it was opened.
  std::uint64_t last_block_number() const noexcept { return last_block_number_; }
  /// Camera time of the last event pushed [us].
  Timestamp last_t() const noexcept { return last_t_; }

 private:
  struct PlacedTrigger {
    TriggerEvent trigger;
    std::uint64_t after_block = 0;  // number of the last block pushed before it
  };
  // While it exists, a push waits for room.
  class Waiting {
   public:
    explicit Waiting(std::atomic<bool>& flag) : flag_(flag) { flag_ = true; }
    Waiting(const Waiting&) = delete;
    Waiting& operator=(const Waiting&) = delete;
    ~Waiting() { flag_ = false; }

   private:
    std::atomic<bool>& flag_;
  };
  using Queue = moodycamel::BlockingReaderWriterCircularBuffer<EventBlock*>;
  static constexpr std::size_t kTriggers = 4096;  // most in the queue

  bool may_wait() const noexcept { return policy_ == OverloadPolicy::block && !on_consumer_thread(); }

  // The lock that a push needs. Not granted on the consumer thread while another push, which holds it, waits for room:
  // only that thread can make room.
  std::unique_lock<std::mutex> lock_for_push() {
    if (!on_consumer_thread()) return std::unique_lock(push_mutex_);
    std::unique_lock lock(push_mutex_, std::try_to_lock);
    while (!lock && !waiting_) {
      std::this_thread::sleep_for(std::chrono::microseconds(20));
      lock.try_lock();
    }
    return lock;
  }

  // Drops events that were pushed while closed, or where a push must not wait for the lock.
  void drop_before_queue(std::uint64_t events) noexcept {
    refused_ += events;
    dropping_ = true;
  }

  // Notes the times of events. Returns those to put into the queue: all, or as many as the policy `thin` keeps; valid
  // until the next call.
  std::span<const Event> take_in(std::span<const Event> events) {
    const double share = policy_ == OverloadPolicy::thin ? share_to_keep() : 1;
    std::size_t kept = 0;
    for (const Event& event : events) {
      note_time(event.t);
      thinning_ += share;
      if (thinning_ < 1) continue;
      thinning_ -= 1;
      kept_[kept++] = event;
    }
    count_dropped(events.size() - kept);
    return {kept_.data(), kept};
  }

  // Appends at most a block of events: first to the last block while that is still in the queue, then to a new one.
  void enqueue(std::span<const Event> events, Clock::time_point now) {
    if (last_block_ != nullptr) events = events.subspan(last_block_->append(events, now));
    if (events.empty()) return;
    last_block_ = open_ ? free_block() : nullptr;
    if (last_block_ == nullptr) {
      count_dropped(events.size());
      dropping_ = true;
      return;
    }
    last_block_->begin(last_block_number_ + 1, dropping_.exchange(false), now);
    last_block_->append(events, now);
    filled_.try_enqueue(last_block_);  // cannot fail: it has room for all blocks
    ++last_block_number_;
  }

  // A block to be filled; if there is none, makes room as the policy says. Null if the events are to be dropped.
  EventBlock* free_block() {
    for (EventBlock* block = nullptr; open_;) {
      if (free_.try_dequeue(block)) return block;
      if (policy_ == OverloadPolicy::drop_oldest) {
        if ((block = try_pop()) == nullptr) continue;
        count_dropped(block->size());
        return block;
      }
      if (!may_wait()) return nullptr;
      wake_consumer();
      const Waiting waiting(waiting_);
      // Not by the queue's timed wait, which lasts as long as the system's clock is set back.
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    return nullptr;
  }

  // Only one thread may remove blocks at a time: the consumer or, with the policy `drop_oldest`, one that pushes.
  EventBlock* try_pop() {
    EventBlock* block = nullptr;
    const std::lock_guard lock(pop_mutex_);
    if (filled_.try_dequeue(block)) block->close();
    return block;
  }

  void wake_consumer() {
    if (consumer_sleeps_.exchange(false)) wake_.signal();
  }

  // The share of events that thinning keeps: all up to a quarter of the queue, none when it is full.
  double share_to_keep() const noexcept {
    const double full = static_cast<double>(filled_.size_approx()) / static_cast<double>(blocks_.size());
    return std::clamp((1 - full) / 0.75, 0.0, 1.0);
  }

  void note_time(Timestamp t) noexcept {
    const Timestamp last = last_t_.load(std::memory_order_relaxed);
    if (last_t_known_ && t < last) ++time_steps_back_;
    if (last_t_known_ && t > last && elapsed_us(last, t) >= gap_us_) ++time_gaps_;
    last_t_.store(t, std::memory_order_relaxed);
    last_t_known_ = true;
  }

  OverloadPolicy policy_;
  std::uint64_t gap_us_;
  std::vector<EventBlock> blocks_;
  Queue free_;    // blocks to fill
  Queue filled_;  // blocks to track
  moodycamel::BlockingReaderWriterCircularBuffer<PlacedTrigger> triggers_;
  std::optional<PlacedTrigger> next_trigger_;  // removed from the queue, but not yet due; used by the consumer
  std::mutex push_mutex_, pop_mutex_;
  std::atomic<std::thread::id> consumer_thread_{};
  std::atomic<bool> open_{false};
  std::atomic<bool> waiting_{false};          // a push waits for room, with push_mutex_ locked
  std::atomic<bool> consumer_sleeps_{false};  // a push must wake it
  moodycamel::spsc_sema::LightweightSemaphore wake_;
  std::array<Event, EventBlock::kCapacity> kept_;
  EventBlock* last_block_ = nullptr;   // was put into the queue last; it may have been removed since
  std::atomic<bool> dropping_{false};  // events were dropped since the last block, not counting those thinned out
  double thinning_ = 0;                // sum of the shares to keep, less the events kept
  bool last_t_known_ = false;          // an event was pushed
  std::atomic<std::uint64_t> last_block_number_{0};
  // An event is counted as pushed before it is counted as anything else. Events refused before the queue, see
  // drop_before_queue, count as both pushed and dropped.
  std::atomic<std::uint64_t> pushed_{0}, dropped_{0}, refused_{0}, time_steps_back_{0}, time_gaps_{0},
      triggers_pushed_{0}, triggers_taken_in_{0}, triggers_dropped_{0};
  std::atomic<Timestamp> last_t_{0};
};

}  // namespace evmarker::live
