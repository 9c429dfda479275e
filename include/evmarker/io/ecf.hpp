#pragma once
// Prophesee's event compression format (ECF), in which HDF5 recordings hold the chunks of their events.
#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/io/field_cursor.hpp"

namespace evmarker::io {

/// Most events of a chunk.
inline constexpr std::size_t kMaxEcfEvents = 65535;

namespace detail {

/// The fields of an ECF chunk, a column of all events after the other. Every function throws std::runtime_error where
/// the bytes end before the column, or say more than all of its events.
class EcfColumns {
 public:
  EcfColumns(FieldCursor fields, std::span<Event> events) : fields_(fields), events_(events) {}

  // The first time, then a byte for each run of equal times: its step from the time before and its length. A step too
  // long for that comes first, four bits a byte from the lowest on, each marked by the step that no run has.
  void read_times() {
    constexpr std::uint8_t kLongStep = 15;
    std::uint64_t t = fields_.number<std::uint64_t>();
    for (std::size_t i = 0; i < events_.size();) {
      auto run = fields_.number<std::uint8_t>();
      for (unsigned bit = 0; run >> 4 == kLongStep; bit += 4, run = fields_.number<std::uint8_t>()) {
        if (bit >= 64) throw std::runtime_error("garbled: a step of time of more than 64 bits");
        t += std::uint64_t{run & 0xFU} << bit;
      }
      t += std::uint64_t{run} >> 4;
      for (Event& event : run_of<4>(run, i)) event.t = static_cast<Timestamp>(t);
    }
  }

  // A word for each run of equal rows: the row and the run's length.
  void read_rows() {
    for (std::size_t i = 0; i < events_.size();) {
      const auto run = fields_.number<std::uint16_t>();
      for (Event& event : run_of<5>(run, i)) event.y = static_cast<std::uint16_t>(run >> 5);
    }
  }

  // A word for each group of columns: the first one, and a bit for each of the five next to it. The bits of the last
  // group may say more than there is.
  void read_columns() {
    constexpr unsigned kBits = 5;
    for (std::size_t i = 0; i < events_.size();) {
      const auto group = fields_.number<std::uint16_t>();
      const auto x = static_cast<std::uint16_t>(group >> kBits);
      events_[i++].x = x;
      for (unsigned k = 1; k <= kBits && i < events_.size(); ++k)
        if ((group >> (kBits - k) & 1) != 0) events_[i++].x = static_cast<std::uint16_t>(x + k);
    }
  }

  // A byte for each run of equal polarities: the polarity and the run's length.
  void read_polarities() {
    for (std::size_t i = 0; i < events_.size();) {
      const auto run = fields_.number<std::uint8_t>();
      for (Event& event : run_of<7>(run, i)) event.p = static_cast<std::int16_t>(run >> 7);
    }
  }

  // Column and polarity of four events in three words of 16 bits.
  void read_packed_columns() {
    read_packed<std::uint16_t>([](Event& event, std::uint16_t xp) {
      event.x = static_cast<std::uint16_t>(xp >> 1);
      event.p = static_cast<std::int16_t>(xp & 1);
    });
  }

  // Row, column and polarity of four events in three words of 32 bits.
  void read_packed_places() {
    read_packed<std::uint32_t>([](Event& event, std::uint32_t yxp) {
      event.y = static_cast<std::uint16_t>(yxp >> 12 & 0x7FF);
      event.x = static_cast<std::uint16_t>(yxp >> 1 & 0x7FF);
      event.p = static_cast<std::int16_t>(yxp & 1);
    });
  }

 private:
  // The events of a run from the i-th on, behind which i is then. Its length is in the lowest bits of its word; where
  // these are all ones, in a word behind it.
  template <unsigned kBits, std::unsigned_integral Word>
  std::span<Event> run_of(Word word, std::size_t& i) {
    constexpr unsigned kInNumber = (1U << kBits) - 1;
    std::size_t length = word & kInNumber;
    if (length == kInNumber) length = fields_.number<std::uint16_t>();
    if (length > events_.size() - i)
      throw std::runtime_error("garbled: a run of " + std::to_string(length) + " events, where " +
                               std::to_string(events_.size() - i) + " are left");
    i += length;
    return events_.subspan(i - length, length);
  }

  // Four values, each of three quarters of a word's bits, fill three words: the first and the last value lie in the
  // high bits of the first and the low bits of the last word, the others are shared out over what is left.
  template <std::unsigned_integral Word, typename Assign>
  void read_packed(const Assign& assign) {
    constexpr unsigned kShared = 2 * sizeof(Word);  // a quarter of its bits
    const auto low = [](Word word, unsigned bits) { return static_cast<Word>(word & ((Word{1} << bits) - 1)); };
    for (std::size_t i = 0; i < events_.size(); i += 4) {
      std::array<Word, 3> w{};
      for (Word& word : w) word = fields_.number<Word>();
      const std::array<Word, 4> values{
          static_cast<Word>(w[0] >> kShared),
          static_cast<Word>(low(w[0], kShared) | w[1] >> 2 * kShared << kShared),
          static_cast<Word>(low(w[1], 2 * kShared) | w[2] >> 3 * kShared << 2 * kShared),
          low(w[2], 3 * kShared),
      };
      const auto events = events_.subspan(i, std::min<std::size_t>(4, events_.size() - i));
      for (std::size_t k = 0; k < events.size(); ++k) assign(events[k], values[k]);
    }
  }

  FieldCursor fields_;
  std::span<Event> events_;
};

}  // namespace detail

/// Appends the events of a chunk: their number and how their places are packed, then their times and places.
/// @throws std::runtime_error where the chunk is garbled or cut off, and `events` as they were
inline void decode_ecf(std::span<const std::byte> chunk, std::vector<Event>& events) {
  FieldCursor fields(chunk);
  const auto header = fields.number<std::uint32_t>();
  const std::size_t count = header >> 2, before = events.size();
  if (count > kMaxEcfEvents)
    throw std::runtime_error("garbled: a chunk of " + std::to_string(count) + " events, of which it can hold " +
                             std::to_string(kMaxEcfEvents));
  events.resize(before + count);
  try {
    detail::EcfColumns columns(fields, std::span(events).subspan(before));
    columns.read_times();
    if ((header & 2) != 0) return columns.read_packed_places();
    columns.read_rows();
    if ((header & 1) != 0) return columns.read_packed_columns();
    columns.read_columns();
    columns.read_polarities();
  } catch (const std::runtime_error&) {
    events.resize(before);
    throw;
  }
}

}  // namespace evmarker::io
