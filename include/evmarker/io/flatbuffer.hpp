#pragma once
// Tables of flatbuffers, of which nothing outside of the buffer is read.
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

#include "evmarker/io/evt_words.hpp"

namespace evmarker::io {

/// A table of a flatbuffer whose bytes live as long as it is used. Every function throws std::out_of_range where the
/// buffer refers to what is outside of it.
class FlatTable {
 public:
  /// The root of a buffer, without the size in front of it.
  explicit FlatTable(std::span<const std::byte> buffer) : FlatTable(buffer, word<std::uint32_t>(buffer, 0)) {}

  /// A number of the table, or `absent` where it has none.
  template <std::integral T>
  T number(std::size_t field, T absent) const {
    const std::size_t at = position_of(field);
    return at == 0 ? absent : static_cast<T>(word<std::make_unsigned_t<T>>(buffer_, at));
  }

  /// The elements of a vector of structs or characters of `element_bytes` each; none where the table has no such
  /// vector.
  std::span<const std::byte> vector(std::size_t field, std::size_t element_bytes) const {
    const std::size_t at = position_of(field);
    if (at == 0) return {};
    const std::size_t begin = at + word<std::uint32_t>(buffer_, at);
    return part(buffer_, begin + 4, std::uint64_t{word<std::uint32_t>(buffer_, begin)} * element_bytes);
  }

  /// Calls `use` with each table of a vector of tables.
  template <typename Use>
  void for_each_table(std::size_t field, const Use& use) const {
    constexpr std::size_t kOffsetBytes = 4;
    const auto offsets = vector(field, kOffsetBytes);
    if (offsets.empty()) return;
    const auto begin = static_cast<std::size_t>(offsets.data() - buffer_.data());
    for (std::size_t at = begin; at < begin + offsets.size(); at += kOffsetBytes)
      use(FlatTable(buffer_, at + word<std::uint32_t>(buffer_, at)));
  }

  std::string_view text(std::size_t field) const {
    const auto characters = vector(field, 1);
    return {reinterpret_cast<const char*>(characters.data()), characters.size()};
  }

 private:
  FlatTable(std::span<const std::byte> buffer, std::size_t table) : buffer_(buffer), table_(table) {
    const auto back = static_cast<std::int32_t>(word<std::uint32_t>(buffer, table));
    fields_ = static_cast<std::size_t>(static_cast<std::int64_t>(table) - back);  // out of range if it is negative
    fields_bytes_ = word<std::uint16_t>(buffer, fields_);
  }

  static std::span<const std::byte> part(std::span<const std::byte> buffer, std::size_t at, std::uint64_t bytes) {
    if (at > buffer.size() || bytes > buffer.size() - at)
      throw std::out_of_range("garbled flatbuffer: it refers to byte " + std::to_string(at) + " and " +
                              std::to_string(bytes) + " bytes from there, but has " + std::to_string(buffer.size()));
    return buffer.subspan(at, static_cast<std::size_t>(bytes));
  }

  template <std::unsigned_integral Word>
  static Word word(std::span<const std::byte> buffer, std::size_t at) {
    return load_word<Word>(part(buffer, at, sizeof(Word)).data());
  }

  // Where the value of a field is; 0 for a field that is left out.
  std::size_t position_of(std::size_t field) const {
    const std::size_t at = 4 + 2 * field;
    if (at + 2 > fields_bytes_) return 0;
    const auto offset = word<std::uint16_t>(buffer_, fields_ + at);
    return offset == 0 ? 0 : table_ + offset;
  }

  std::span<const std::byte> buffer_;
  std::size_t table_, fields_ = 0, fields_bytes_ = 0;
};

}  // namespace evmarker::io
