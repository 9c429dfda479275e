#pragma once
// What the EVT encodings share: little-endian words, and TIME_HIGH words, which wrap around.
#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"

namespace evmarker::io {

/// Loads the little-endian word at `bytes`, which need not be aligned.
template <std::unsigned_integral Word>
inline Word load_word(const std::byte* bytes) noexcept {
  Word word = 0;
  if constexpr (std::endian::native == std::endian::little) {
    std::memcpy(&word, bytes, sizeof(Word));
  } else {
    for (std::size_t i = 0; i < sizeof(Word); ++i)
      word = static_cast<Word>(word | static_cast<Word>(static_cast<Word>(bytes[i]) << (8 * i)));
  }
  return word;
}

/// Appends `word` in little-endian order.
template <std::unsigned_integral Word>
inline void append_word(std::vector<std::byte>& bytes, Word word) {
  for (std::size_t i = 0; i < sizeof(Word); ++i)
    bytes.push_back(static_cast<std::byte>(std::uint64_t{word} >> (8 * i) & 0xFFU));
}

/// Extends TIME_HIGH, a counter of `Bits` bits that wraps around, to a count that does not.
///
/// A word that jumps by 2^16 us or more is garbled where the next one goes on from the word before it, and so are a few
/// such words in a row. Where the next goes on from the jump, the camera has restarted, paused or lost data.
/// @tparam LowBits bits of the time [us] below those of a time word
template <int Bits, int LowBits>
class TimeHighDecoder {
 public:
  /// True if `high` jumps and the time word behind it shows that it is garbled.
  /// @param find_next gives the time word behind `high`, if it is known
  template <typename FindNext>
  bool is_garbled(std::uint32_t high, const FindNext& find_next) const {
    if (!any_ || !far(now_.last, high)) return false;
    const std::optional<std::uint32_t> next = find_next();
    return next && contradicts(now_.last, high, *next);
  }

  /// The last time word is repeated.
  void confirm() noexcept { jumps_ = 0; }

  /// Count at the time word `high`. A step back by half the counter's range or more is a wrap, a smaller one is a step
  /// back in time. Jumps to the last time words are undone if `high` shows that these were garbled.
  std::int64_t unwrap(std::uint32_t high) noexcept {
    if (jumps_ > 0) undo_garbled(high);
    if (any_ && far(now_.last, high)) {
      if (jumps_++ == 0) before_jumps_ = now_;
      before_jump_ = now_;
    } else {
      jumps_ = 0;
    }
    if (now_.last >= std::uint64_t{high} + kRange / 2) now_.wrapped += kRange;
    now_.last = high;
    any_ = true;
    return static_cast<std::int64_t>(now_.wrapped + high);
  }

  /// Number of jumps undone.
  std::uint64_t undone() const noexcept { return undone_; }

 private:
  static constexpr std::uint32_t kRange = std::uint32_t{1} << Bits;
  static constexpr std::uint32_t kNear = std::uint32_t{1} << (16 - LowBits);
  static constexpr std::uint64_t kMostGarbled = 4;  // in a row; more jumps are those of a camera that sees little

  struct Count {
    std::uint32_t last = 0;
    std::uint64_t wrapped = 0;  // unsigned, since garbled data may overflow it
  };

  void undo_garbled(std::uint32_t high) noexcept {
    if (jumps_ > 1 && jumps_ <= kMostGarbled && far(now_.last, high) && !far(before_jumps_.last, high)) {
      now_ = before_jumps_;
      undone_ += std::exchange(jumps_, 0);
    } else if (contradicts(before_jump_.last, now_.last, high)) {
      now_ = before_jump_;
      ++undone_;
      --jumps_;
    }
  }

  // How far the counter goes from one word to another, without steps back.
  static std::uint32_t ahead(std::uint32_t from, std::uint32_t to) noexcept { return (to - from) & (kRange - 1); }
  static bool far(std::uint32_t from, std::uint32_t to) noexcept {
    return ahead(from, to + (kNear - 1)) > 2 * (kNear - 1);  // kNear or more ahead, and as far behind
  }
  static bool contradicts(std::uint32_t last, std::uint32_t high, std::uint32_t next) noexcept {
    return far(last, high) && far(high, next) && ahead(last, next) < ahead(last, high);
  }

  Count now_, before_jump_, before_jumps_;  // before the last jump, and before the first of several in a row
  bool any_ = false;
  std::uint64_t jumps_ = 0, undone_ = 0;
};

/// Finds the TIME_HIGH words that lead a decoder from one time to the next.
/// @tparam HighBits bits of a time word
/// @tparam LowBits bits of the time [us] below those of a time word
template <int HighBits, int LowBits>
class TimeHighEncoder {
 public:
  /// Most wraps between two times (25 days in EVT3); a longer step is more likely a mistaken unit of time.
  static constexpr std::int64_t kMaxWraps = std::int64_t{1} << 17;

  /// @param encoding its name in errors; a string literal
  explicit TimeHighEncoder(const char* encoding) : encoding_(encoding) {}

  /// Calls `emit(word)` for each time word between the last time and `t` [us]; for none where TIME_HIGH stays the same.
  /// A word that jumps is emitted twice: by its repetition a decoder sees that it is not garbled.
  /// @throws std::invalid_argument naming `t` where the encoding cannot express it
  template <std::invocable<std::uint32_t> Emit>
  void advance_to(Timestamp t, Emit&& emit) {
    if (const char* const fault = fault_of(t, last_wrap())) refuse(t, fault);
    const std::int64_t high = t >> LowBits;
    const auto put = [&](std::int64_t next) { emit(static_cast<std::uint32_t>((last_ = next) & (kRange - 1))); };
    if (last_ < 0) put(high >> HighBits > 0 ? 0 : high);
    // Some decoders recognise a wrap only where the counter passes from its last value to 0.
    while (last_ >> HighBits < high >> HighBits) {
      step_to(last_ | (kRange - 1), put);
      put(last_ + 1);
    }
    step_to(high, put);
  }

  /// How many of the events, from the first on, have times that can be expressed one after the other.
  std::size_t count_expressible(std::span<const Event> events) const noexcept {
    std::int64_t wrap = last_wrap();
    std::size_t count = 0;
    for (; count < events.size() && fault_of(events[count].t, wrap) == nullptr; ++count)
      wrap = wrap_of(events[count].t);
    return count;
  }

  /// True if `advance_to(t)` would not throw.
  bool can_express(Timestamp t) const noexcept { return fault_of(t, last_wrap()) == nullptr; }

 private:
  static constexpr std::int64_t kRange = std::int64_t{1} << HighBits;
  static constexpr std::int64_t kNear = std::int64_t{1} << (16 - LowBits);  // as in TimeHighDecoder

  static constexpr std::int64_t wrap_of(Timestamp t) noexcept { return t >> (LowBits + HighBits); }
  std::int64_t last_wrap() const noexcept { return std::max<std::int64_t>(last_, 0) >> HighBits; }

  // Why `t` cannot be expressed after a time in this wrap; null where it can.
  static const char* fault_of(Timestamp t, std::int64_t last_wrap) noexcept {
    if (t < 0) return "must not be negative";
    const std::int64_t wraps = wrap_of(t) - last_wrap;
    if (wraps < 0) return "which lies before the last wrap of the encoding's clock";
    return wraps > kMaxWraps ? "which lies too far ahead for the encoding: shift the times to zero" : nullptr;
  }

  // In steps of less than half the range: decoders read a longer step back as a wrap.
  template <typename Put>
  void step_to(std::int64_t high, Put& put) {
    while (last_ != high) {
      const std::int64_t step = std::clamp(high - last_, -kRange / 2 + 1, kRange / 2 - 1);
      put(last_ + step);
      if (step >= kNear || -step >= kNear) put(last_);
    }
  }

  [[noreturn]] void refuse(Timestamp t, const char* reason) const {
    throw std::invalid_argument(std::string(encoding_) + ": t is " + std::to_string(t) + " us, " + reason);
  }

  const char* encoding_;
  std::int64_t last_ = -1;  // no time word written yet
};

/// Decodes the whole words of `bytes` and appends to `events` and `triggers`.
/// @return number of bytes decoded
template <typename Decoder>
std::size_t decode_append(Decoder& decoder, std::span<const std::byte> bytes, std::vector<Event>& events,
                          std::vector<TriggerEvent>& triggers) {
  // By pieces, so that `events` need not grow to the most events that all of `bytes` could hold.
  constexpr std::size_t kPieceBytes = 64 * Decoder::kWordBytes;
  std::array<Event, 64 * Decoder::kMaxEventsPerWord> buffer;
  const std::size_t whole = bytes.size() - bytes.size() % Decoder::kWordBytes;
  for (std::size_t begin = 0; begin < whole; begin += kPieceBytes) {
    const auto piece = bytes.subspan(begin, std::min(kPieceBytes, whole - begin));
    const auto following = bytes.subspan(begin + piece.size());
    const std::size_t count = decoder.decode(piece, std::span<Event>(buffer), triggers, following);
    events.insert(events.end(), buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(count));
  }
  return whole;
}

}  // namespace evmarker::io
