#pragma once
// Numbers and texts that follow each other in bytes, of which nothing outside is read.
#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "evmarker/io/evt_words.hpp"

namespace evmarker::io {

/// Rejects a text with control characters, which is no name.
/// @throws std::runtime_error
inline void require_one_line(std::string_view text) {
  if (std::ranges::any_of(text, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; }))
    throw std::runtime_error("garbled: a name with control characters");
}

/// Reads little-endian fields one after the other from bytes that live as long as it is used. Every function throws
/// std::runtime_error where the bytes end before the field.
class FieldCursor {
 public:
  /// @param aligned true where each number begins at a multiple of its size, as in CDR
  explicit FieldCursor(std::span<const std::byte> bytes, bool aligned = false) : bytes_(bytes), aligned_(aligned) {}

  bool empty() const noexcept { return at_ == bytes_.size(); }
  /// Number of bytes passed.
  std::size_t position() const noexcept { return at_; }

  template <std::unsigned_integral Word>
  Word number() {
    if (aligned_) at_ = std::min((at_ + sizeof(Word) - 1) / sizeof(Word) * sizeof(Word), bytes_.size());
    return load_word<Word>(bytes(sizeof(Word)).data());
  }

  std::span<const std::byte> bytes(std::uint64_t count) {
    if (count > bytes_.size() - at_)
      throw std::runtime_error("garbled: a field of " + std::to_string(count) + " bytes at byte " +
                               std::to_string(at_) + " of " + std::to_string(bytes_.size()));
    const auto field = bytes_.subspan(at_, static_cast<std::size_t>(count));
    at_ += field.size();
    return field;
  }

  /// Bytes with their number, of 32 bits, in front.
  std::span<const std::byte> sized_bytes() { return bytes(number<std::uint32_t>()); }
  /// The same as text, up to the first character 0, with which CDR ends it. It is one line, as it may be in an error.
  std::string_view text() {
    const auto characters = sized_bytes();
    std::string_view text(reinterpret_cast<const char*>(characters.data()), characters.size());
    text = text.substr(0, text.find('\0'));
    require_one_line(text);
    return text;
  }

 private:
  std::span<const std::byte> bytes_;
  bool aligned_;
  std::size_t at_ = 0;
};

}  // namespace evmarker::io
