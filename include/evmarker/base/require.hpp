#pragma once
// What a value that was given must be, and the error that says which one is not.
#include <cmath>
#include <stdexcept>
#include <string>

namespace evmarker {

/// Refuses values that make no sense: std::invalid_argument "<of>: <name> is <value>".
class Require {
 public:
  /// @param of what the values belong to
  explicit constexpr Require(const char* of) noexcept : of_(of) {}

  template <typename Value>
  void operator()(bool good, const std::string& name, Value value) const {
    if (!good) throw std::invalid_argument(std::string(of_) + ": " + name + " is " + std::to_string(value));
  }
  void positive(double value, const std::string& name) const { (*this)(std::isfinite(value) && value > 0, name, value); }
  void not_negative(double value, const std::string& name) const {
    (*this)(std::isfinite(value) && value >= 0, name, value);
  }

 private:
  const char* of_;
};

}  // namespace evmarker
