#pragma once
// Checks of settings and arguments, with errors that name the value that is wrong.
#include <cmath>
#include <stdexcept>
#include <string>
#include <string_view>

namespace evmarker {

/// Checks values and throws std::invalid_argument "<of>: <name> is <value>" for one that is not valid.
class Require {
 public:
  /// @param of what the values belong to; a string literal, as only the pointer is kept
  explicit constexpr Require(const char* of) noexcept : of_(of) {}

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
    throw std::invalid_argument(std::string(of_) + ": " + std::string(name) + " is " + std::to_string(value));
  }

  const char* of_;
};

}  // namespace evmarker
