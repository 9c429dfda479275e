#pragma once
// What a value that was given must be, and the error that says which one is not.
#include <cmath>
#include <stdexcept>
#include <string>
#include <string_view>

namespace evmarker {

/// Refuses values that make no sense: std::invalid_argument "<of>: <name> is <value>".
class Require {
 public:
  /// @param of what the values belong to
  explicit constexpr Require(const char* of) noexcept : of_(of) {}

  template <typename Value>
  void operator()(bool good, std::string_view name, Value value) const {
    if (!good) refuse(name, value);
  }
  void positive(double value, std::string_view name) const { (*this)(std::isfinite(value) && value > 0, name, value); }
  void not_negative(double value, std::string_view name) const {
    (*this)(std::isfinite(value) && value >= 0, name, value);
  }

 private:
  // Apart, so that a constructor with twenty settings does not hold twenty copies of it.
  template <typename Value>
  [[noreturn, gnu::noinline]] void refuse(std::string_view name, Value value) const {
    throw std::invalid_argument(std::string(of_) + ": " + std::string(name) + " is " + std::to_string(value));
  }

  const char* of_;
};

}  // namespace evmarker
