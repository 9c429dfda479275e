#pragma once
// What the EVT encodings share: little-endian words, and TIME_HIGH words, which wrap around.
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
template <int Bits>
class TimeHighDecoder {
 public:
  /// Count at the time word `high`. A step back by half the counter's range or more is a wrap, a smaller one is a step
  /// back in time.
  std::int64_t unwrap(std::uint32_t high) noexcept {
    if (last_ >= std::uint64_t{high} + kRange / 2) wrapped_ += kRange;
    last_ = high;
    return static_cast<std::int64_t>(wrapped_ + high);
  }

 private:
  static constexpr std::uint64_t kRange = std::uint64_t{1} << Bits;
  std::uint64_t wrapped_ = 0;  // unsigned, since garbled data may overflow it
  std::uint64_t last_ = 0;
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
  /// @throws std::invalid_argument naming `t` where the encoding cannot express it
  template <std::invocable<std::uint32_t> Emit>
  void advance_to(Timestamp t, Emit&& emit) {
    if (t < 0) refuse(t, "must not be negative");
    const std::int64_t high = t >> LowBits;
    const std::int64_t wraps = (high >> HighBits) - (std::max<std::int64_t>(last_, 0) >> HighBits);
    if (wraps < 0) refuse(t, "which lies before the last wrap of the encoding's clock");
    if (wraps > kMaxWraps) refuse(t, "which lies too far ahead for the encoding: shift the times to zero");
    const auto put = [&](std::int64_t next) { emit(static_cast<std::uint32_t>((last_ = next) & (kRange - 1))); };
    if (last_ < 0) put(wraps > 0 ? 0 : high);
    // Some decoders recognise a wrap only where the counter passes from its last value to 0.
    while (last_ >> HighBits < high >> HighBits) {
      step_to(last_ | (kRange - 1), put);
      put(last_ + 1);
    }
    step_to(high, put);
  }

 private:
  static constexpr std::int64_t kRange = std::int64_t{1} << HighBits;

  // In steps of less than half the range: decoders read a longer step back as a wrap.
  template <typename Put>
  void step_to(std::int64_t high, Put& put) {
    while (last_ != high) put(last_ + std::clamp(high - last_, -kRange / 2 + 1, kRange / 2 - 1));
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
    const std::size_t count = decoder.decode(piece, std::span<Event>(buffer), triggers);
    events.insert(events.end(), buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(count));
  }
  return whole;
}

}  // namespace evmarker::io
