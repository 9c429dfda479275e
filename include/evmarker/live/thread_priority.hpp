#pragma once
// live. What may wait gives way to what must not.
#ifdef __linux__
#include <sys/resource.h>
#endif

namespace evmarker::live {

/// Lets other threads run first where there are more than processors, on Linux; elsewhere it does nothing. Threads that
/// this one starts inherit it.
inline void lower_priority_of_this_thread() noexcept {
#ifdef __linux__
  constexpr int kNicer = 10;
  setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + kNicer);  // Linux has one for each thread: this one's
#endif
}

}  // namespace evmarker::live
