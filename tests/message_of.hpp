#pragma once
// The message of the std::invalid_argument that a call throws.
#include <stdexcept>
#include <string>

template <typename Call>
std::string message_of(Call&& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing thrown";
}
