#pragma once
// Checks of settings and arguments, with errors that name the value that is wrong.
#include <array>
#include <charconv>
#include <cmath>
#include <stdexcept>
#include <string>
#include <string_view>

namespace evmarker {

/// A number as text: the shortest that reads back as the same number.
template <typename Number>
std::string number_text(Number number) {
  std::array<char, 32> text;
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), number).ptr};
}

/// Checks values and throws std::invalid_argument "<owner>: <name> is <value>" for one that is not valid.
class Require {
 public:
  /// @param owner whose values these are, like "tracker"; a string literal, as only the pointer is kept
  explicit constexpr Require(const char* owner) noexcept : owner_(owner) {}

  template <typename Value>
  void operator()(bool valid, std::string_view name, Value value) const {
    if (!valid) reject(name, value);
  }
  void positive(double value, std::string_view name) const { (*this)(std::isfinite(value) && value > 0, name, value); }
  void not_negative(double value, std::string_view name) const {
    (*this)(std::isfinite(value) && value >= 0, name, value);
  }

 private:
  // Not inlined, so that a constructor that checks twenty settings does not contain twenty copies of this.
  template <typename Value>
  [[noreturn, gnu::noinline]] void reject(std::string_view name, Value value) const {
    throw std::invalid_argument(std::string(owner_) + ": " + std::string(name) + " is " + number_text(value));
  }

  const char* owner_;
};

}  // namespace evmarker
