#pragma once
// The bounded queue between a camera's thread and the tracking thread, and its policies where it is full.
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

/// Up to 256 events in the order in which they were pushed. Until it is closed, more may be appended.
class EventBlock {
 public:
  static constexpr std::size_t kCapacity = 256;

  /// Makes the block an empty one.
  /// @param number of the block, counted from 1 since the start
  /// @param follows_dropped events pushed right before it were dropped, as the queue had no room
  void begin(std::uint64_t number, bool follows_dropped, Clock::time_point now) noexcept {
    number_ = number;
    follows_dropped_ = follows_dropped;
    pushed_ = now;
    state_.store(0, std::memory_order_relaxed);
  }

  /// Appends events, as many as there is room for; none if the block is closed. For one thread at a time.
  /// @return how many were appended
  std::size_t append(std::span<const Event> events, Clock::time_point now) noexcept {
    std::size_t size = state_.load(std::memory_order_relaxed);
    if (size >= kCapacity) return 0;  // full, or closed
    events = events.first(std::min(events.size(), kCapacity - size));
    std::ranges::copy(events, events_.begin() + static_cast<std::ptrdiff_t>(size));
    last_pushed_.store(now, std::memory_order_relaxed);
    return state_.compare_exchange_strong(size, size + events.size(), std::memory_order_release) ? events.size() : 0;
  }

  /// Refuses further events. The events may be read by another thread than the one that appends only afterwards.
  void close() noexcept { state_.fetch_or(kClosed, std::memory_order_acquire); }

  std::span<const Event> span() const noexcept { return {events_.data(), size()}; }
  std::size_t size() const noexcept { return state_.load(std::memory_order_relaxed) & ~kClosed; }
  std::uint64_t number() const noexcept { return number_; }
  bool follows_dropped() const noexcept { return follows_dropped_; }
  /// When the first event was pushed, and the last one.
  Clock::time_point pushed() const noexcept { return pushed_; }
  Clock::time_point last_pushed() const noexcept { return last_pushed_.load(std::memory_order_relaxed); }
  /// Time of the first event [us]; of the second one where the two are so far apart that the first is taken for wrong.
  Timestamp first_t() const noexcept {
    constexpr std::uint64_t kApart_us = 10000;
    if (size() < 2) return events_[0].t;
    const auto [earlier, later] = std::minmax(events_[0].t, events_[1].t);
    return elapsed_us(earlier, later) > kApart_us ? events_[1].t : events_[0].t;
  }

 private:
  static constexpr std::size_t kClosed = std::size_t{1} << 31;

  std::uint64_t number_ = 0;
  bool follows_dropped_ = false;
  Clock::time_point pushed_;
  std::atomic<Clock::time_point> last_pushed_{};
  std::atomic<std::size_t> state_{0};  // the number of events, and kClosed
  std::array<Event, kCapacity> events_;
};

/// A queue into which any threads push and from which one takes. All memory is allocated in the constructor. It is
/// closed at first.
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
        full_(std::max<std::size_t>(blocks_.size(), 1)),
        triggers_(kTriggers) {
    if (blocks_.size() < 4)
      throw std::invalid_argument("pipeline: queue_events is " + std::to_string(capacity) + ", less than " +
                                  std::to_string(4 * EventBlock::kCapacity));
    if (gap.count() <= 0) throw std::invalid_argument("pipeline: gap [us] is " + std::to_string(gap.count()));
    for (EventBlock& block : blocks_) free_.try_enqueue(&block);
  }

  /// Takes in events, in order. Waits only with the policy `block`, and never on the taking thread: what finds no room
  /// there is dropped. While closed, drops all.
  template <EventLike E>
  void push(std::span<const E> events) {
    // Without the lock where it is closed: a camera that goes on pushing must not keep `clear` from it.
    const auto lock = open_ ? lock_for_push() : std::unique_lock<std::mutex>();
    if (!lock) return refuse(events.size());
    const auto now = Clock::now();
    pushed_ += events.size();
    while (!events.empty()) {
      const auto part = events.first(std::min(events.size(), EventBlock::kCapacity));
      put(keep(part), now);
      events = events.subspan(part.size());
    }
    wake_taker();  // once, with all of them in the queue: as it wakes, it may take the processor from this thread
  }

  /// Takes in a trigger event, between the events pushed before and after it. Where there is no room, waits with the
  /// policy `block`, but not on the taking thread, else drops it. While closed, drops it.
  void push(const TriggerEvent& trigger) {
    const auto lock = lock_for_push();
    ++triggers_pushed_;
    while (lock && open_) {
      if (triggers_.try_enqueue({trigger, last_number_})) {
        ++triggers_taken_in_;
        last_ = nullptr;  // events after it go into another block
        return;
      }
      if (!may_wait()) break;
      const Waiting waiting(waiting_);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    ++triggers_dropped_;
  }

  /// Says which thread takes; none: `std::thread::id()`.
  void set_taking_thread(std::thread::id id) noexcept { taking_thread_ = id; }
  bool on_taking_thread() const noexcept { return taking_thread_.load() == std::this_thread::get_id(); }

  /// Takes the next block of events, and closes it; null if none comes within the timeout. The block must be given
  /// back.
  EventBlock* take(std::chrono::microseconds timeout) {
    EventBlock* block = try_take();
    if (block != nullptr || timeout.count() <= 0) return block;
    sleeping_.exchange(true);  // an exchange, so that a push that does not see it is seen by the next line
    block = try_take();
    const bool woken = block == nullptr && wake_.wait(timeout.count());
    if (!woken && !sleeping_.exchange(false)) wake_.wait();  // a push is about to wake it
    return block != nullptr ? block : try_take();
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
    pushed_ = dropped_ = refused_ = time_steps_back_ = time_gaps_ = 0;
    triggers_pushed_ = triggers_taken_in_ = triggers_dropped_ = 0;
    last_number_ = 0;
    dropping_ = any_ = false;
    open_ = true;
  }

  /// Drops what is pushed from now on. A `push` that waits returns within 10 ms.
  void close() noexcept { open_ = false; }

  /// Drops what is in the queue. No other thread may be taking.
  void clear() {
    const std::lock_guard lock(push_mutex_);
    last_ = nullptr;
    while (EventBlock* const block = take(std::chrono::microseconds(0))) {
      count_dropped(block->size());
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
  std::uint64_t triggers_taken_in() const noexcept { return triggers_taken_in_; }
  std::uint64_t triggers_dropped() const noexcept { return triggers_dropped_; }
  /// Number of the last block that was put into the queue; 0: none since it was opened.
  std::uint64_t last_number() const noexcept { return last_number_; }
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

  bool may_wait() const noexcept { return policy_ == OverloadPolicy::block && !on_taking_thread(); }

  // The right to push. On the taking thread none while another push waits for room, which only that thread can make.
  std::unique_lock<std::mutex> lock_for_push() {
    if (!on_taking_thread()) return std::unique_lock(push_mutex_);
    std::unique_lock lock(push_mutex_, std::try_to_lock);
    while (!lock && !waiting_) {
      std::this_thread::sleep_for(std::chrono::microseconds(20));
      lock.try_lock();
    }
    return lock;
  }

  // Drops events that were not let in.
  void refuse(std::size_t events) noexcept {
    refused_ += events;
    dropping_ = true;
  }

  // The events to put into the queue, thinned as the policy says. Valid until the next call.
  template <EventLike E>
  std::span<const Event> keep(std::span<const E> events) {
    const double share = policy_ == OverloadPolicy::thin ? share_to_keep() : 1;
    std::size_t kept = 0;
    for (const E& pushed : events) {
      const Event event = to_event(pushed);
      note_time(event.t);
      thinning_ += share;
      if (thinning_ < 1) continue;
      thinning_ -= 1;
      kept_[kept++] = event;
    }
    count_dropped(events.size() - kept);
    return {kept_.data(), kept};
  }

  // Appends up to a block of events to the last block, while that is in the queue, and the others to a new one.
  void put(std::span<const Event> events, Clock::time_point now) {
    if (last_ != nullptr) events = events.subspan(last_->append(events, now));
    if (events.empty()) return;
    last_ = open_ ? free_block() : nullptr;
    if (last_ == nullptr) {
      count_dropped(events.size());
      dropping_ = true;
      return;
    }
    last_->begin(last_number_ + 1, dropping_.exchange(false), now);
    last_->append(events, now);
    full_.try_enqueue(last_);  // cannot fail: it has room for all blocks
    ++last_number_;
  }

  // A block to be filled; if there is none, makes room as the policy says. Null if the events are to be dropped.
  EventBlock* free_block() {
    for (EventBlock* block = nullptr; open_;) {
      if (free_.try_dequeue(block)) return block;
      if (policy_ == OverloadPolicy::drop_oldest) {
        if ((block = try_take()) == nullptr) continue;
        count_dropped(block->size());
        return block;
      }
      if (!may_wait()) return nullptr;
      wake_taker();
      const Waiting waiting(waiting_);
      if (free_.wait_dequeue_timed(block, std::chrono::milliseconds(5))) return block;
    }
    return nullptr;
  }

  // Only one thread may take from the queue at a time: the taking one, or where the policy drops blocks, one that
  // pushes.
  EventBlock* try_take() {
    EventBlock* block = nullptr;
    const std::lock_guard lock(take_mutex_);
    if (full_.try_dequeue(block)) block->close();
    return block;
  }

  void wake_taker() {
    if (sleeping_.exchange(false)) wake_.signal();
  }

  // The share of events that thinning keeps: all up to a quarter of the queue, none when it is full.
  double share_to_keep() const noexcept {
    const double full = static_cast<double>(full_.size_approx()) / static_cast<double>(blocks_.size());
    return std::clamp((1 - full) / 0.75, 0.0, 1.0);
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
  std::atomic<std::thread::id> taking_thread_{};
  std::atomic<bool> open_{false};
  std::atomic<bool> waiting_{false};   // a push waits for room, with push_mutex_ locked
  std::atomic<bool> sleeping_{false};  // the taker is to be woken
  moodycamel::spsc_sema::LightweightSemaphore wake_;
  std::array<Event, EventBlock::kCapacity> kept_;
  EventBlock* last_ = nullptr;         // was put into the queue last; it may have been taken
  std::atomic<bool> dropping_{false};  // events were dropped since the last block
  double thinning_ = 0;                // sum of the shares to keep, less the events kept
  bool any_ = false;                   // an event was pushed: last_t_ is known
  std::atomic<std::uint64_t> last_number_{0};
  // An event is counted as pushed before it is counted as anything else. Events refused while closed count as both
  // pushed and dropped.
  std::atomic<std::uint64_t> pushed_{0}, dropped_{0}, refused_{0}, time_steps_back_{0}, time_gaps_{0},
      triggers_pushed_{0}, triggers_taken_in_{0}, triggers_dropped_{0};
  std::atomic<Timestamp> last_t_{0};
};

}  // namespace evmarker::live
