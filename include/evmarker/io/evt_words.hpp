#pragma once
// What the EVT encodings share: little-endian words and time words that count in a circle.
#include <algorithm>
#include <array>
#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"

namespace evmarker::io {

/// The little-endian word at `bytes`, which need not be aligned.
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

template <std::unsigned_integral Word>
inline void append_word(std::vector<std::byte>& bytes, Word word) {
  for (std::size_t i = 0; i < sizeof(Word); ++i)
    bytes.push_back(static_cast<std::byte>(std::uint64_t{word} >> (8 * i) & 0xFFU));
}

/// Unrolls the high part of the time, a count of `Bits` bits that starts again at 0 when it is full.
template <int Bits>
class TimeHighDecoder {
 public:
  /// Full count of a time word. A small step back is one; a step back by half the circle or more is the next loop.
  std::int64_t unroll(std::uint32_t high) noexcept {
    if (last_ >= std::uint64_t{high} + kCircle / 2) loops_ += kCircle;
    last_ = high;
    return static_cast<std::int64_t>(loops_ + high);
  }

 private:
  static constexpr std::uint64_t kCircle = std::uint64_t{1} << Bits;
  std::uint64_t loops_ = 0;  // unsigned: garbled data may count up without end
  std::uint64_t last_ = 0;
};

/// Finds the time words that lead a decoder from one time to the next.
template <int Bits>
class TimeHighEncoder {
 public:
  /// Longest way that is written out, in loops (25 days in EVT3): a longer one is taken for a mistaken unit.
  static constexpr std::int64_t kMaxLoops = std::int64_t{1} << 17;

  /// Calls `emit(word)` for each time word from the present count to `high`; none where they are equal.
  /// @throws std::invalid_argument where the encoding cannot express the step
  template <std::invocable<std::uint32_t> Emit>
  void go_to(std::int64_t high, Emit&& emit) {
    const std::int64_t loops = (high >> Bits) - (std::max<std::int64_t>(current_, 0) >> Bits);
    if (loops < 0) throw std::invalid_argument("lies before the last wrap of the encoding's clock");
    if (loops > kMaxLoops) throw std::invalid_argument("lies too far ahead for the encoding: shift the times to zero");
    const auto put = [&](std::int64_t next) { emit(static_cast<std::uint32_t>((current_ = next) & (kCircle - 1))); };
    // Other readers only see a wrap where the count goes through its very end.
    if (current_ < 0) put(loops > 0 ? 0 : high);
    while (current_ >> Bits < high >> Bits) {
      walk(current_ | (kCircle - 1), put);
      put(current_ + 1);
    }
    walk(high, put);
  }

 private:
  static constexpr std::int64_t kCircle = std::int64_t{1} << Bits;

  // A longer stride, backwards, would be read as a wrap.
  template <typename Put>
  void walk(std::int64_t to, Put& put) {
    while (current_ != to) put(current_ + std::clamp(to - current_, -kCircle / 2 + 1, kCircle / 2 - 1));
  }

  std::int64_t current_ = -1;  // none written yet
};

/// Appends what a decoder yields to a vector, through a small room in between: its worst case is never allocated.
template <typename Decoder>
std::size_t decode_append(Decoder& decoder, std::span<const std::byte> bytes, std::vector<Event>& events,
                          std::vector<TriggerEvent>& triggers) {
  constexpr std::size_t kWords = 64;
  std::array<Event, kWords * Decoder::kMaxEventsPerWord> room;
  const std::size_t whole = bytes.size() - bytes.size() % Decoder::kWordBytes;
  for (std::size_t begin = 0; begin < whole; begin += kWords * Decoder::kWordBytes) {
    const std::size_t length = std::min(kWords * Decoder::kWordBytes, whole - begin);
    const std::size_t count = decoder.decode(bytes.subspan(begin, length), std::span<Event>(room), triggers);
    events.insert(events.end(), room.begin(), room.begin() + static_cast<std::ptrdiff_t>(count));
  }
  return whole;
}

}  // namespace evmarker::io
