#pragma once
// Ctrl-C and SIGTERM end a program in good order: loops look at a flag, and what is done by then is kept.
#include <array>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <string>
#include <vector>

#include "console.hpp"

namespace interruption {

inline std::atomic<bool> requested = false;
inline std::atomic<int> caught_signal = 0;
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<int>::is_always_lock_free);  // in a signal handler

/// From now on the first signal sets `requested`; the second one ends the program at once. A signal that is ignored, as
/// under nohup, remains so.
inline void watch() {
  constexpr static std::array kSignals{SIGINT, SIGTERM};
  for (const int watched : kSignals) {
    struct sigaction action = {}, before = {};
    action.sa_handler = [](int caught) {
      for (const int signal : kSignals) std::signal(signal, SIG_DFL);
      caught_signal = caught;
      requested = true;
    };
    // Without SA_RESTART, so that waiting for somebody to write to a FIFO ends, too.
    sigaction(watched, &action, &before);
    if (before.sa_handler == SIG_IGN) std::signal(watched, SIG_IGN);
  }
}

/// Ends the program after it has completed its files.
/// @param kept what is in them, such as "12 poses in poses.csv"
[[noreturn]] inline void end(double recorded_s, const std::vector<std::string>& kept) {
  char reason[64];
  std::snprintf(reason, sizeof reason, "interrupted after %.2f s of the recording", recorded_s);
  std::string text = reason;
  for (std::size_t i = 0; i < kept.size(); ++i) text += (i == 0 ? ": kept " : ", ") + kept[i];
  throw console::Exit(128 + caught_signal, text);
}

}  // namespace interruption
