#pragma once
// What may wait gives way to what must not.
#ifdef __linux__
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif
#include <cstdint>

namespace evmarker::live {

/// Lets other threads run first where there are more than processors, on Linux; elsewhere it does nothing. Threads that
/// this one starts inherit it.
inline void lower_priority_of_this_thread() noexcept {
#ifdef __linux__
  constexpr int kNicer = 10;
  setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + kNicer);  // again this thread's
#endif
}

/// Leaves the processors to everything else that wants to run, on Linux; elsewhere it does nothing. Under it a thread
/// that wakes up need not wait for this one at all. Threads that this one starts inherit it, and there is no way back.
inline void run_this_thread_when_idle() noexcept {
#ifdef __linux__
  const sched_param parameters{};
  sched_setscheduler(0, SCHED_IDLE, &parameters);  // Linux has a policy for each thread: this one's
#endif
}

/// Asks for short turns on a processor that come soon, in place of long ones that come late, where Linux (6.12 or
/// later) shares it out; a thread with a real-time priority keeps it. Elsewhere it does nothing.
inline void shorten_turns_of_this_thread() noexcept {
#if defined(__linux__) && defined(SYS_sched_setattr)
  if (sched_getscheduler(0) != SCHED_OTHER) return;
  struct {  // the kernel's sched_attr, which the C library does not declare
    std::uint32_t size, policy;
    std::uint64_t flags;
    std::int32_t nice;
    std::uint32_t priority;
    std::uint64_t runtime_ns, deadline_ns, period_ns;
  } attributes{};
  attributes.size = sizeof(attributes);
  attributes.nice = getpriority(PRIO_PROCESS, 0);
  attributes.runtime_ns = 200000;
  syscall(SYS_sched_setattr, 0, &attributes, 0);
#endif
}

}  // namespace evmarker::live
