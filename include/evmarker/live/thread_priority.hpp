#pragma once
// Scheduling of the threads: those that may wait give way to those that must not.
#ifdef __linux__
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif
#include <cstdint>

namespace evmarker::live {

/// Lowers this thread's priority, so that others run first where there are more threads than processors. Has an effect
/// on Linux only. Threads that this one starts inherit it.
inline void lower_priority_of_this_thread() noexcept {
#ifdef __linux__
  constexpr int kNicer = 10;
  setpriority(PRIO_PROCESS, 0, getpriority(PRIO_PROCESS, 0) + kNicer);  // on Linux, 0 is this thread only
#endif
}

/// Lets this thread run only on processors that nothing else needs; a thread that wakes up never waits for it. Has an
/// effect on Linux only. Threads that this one starts inherit it, and it cannot be undone.
inline void run_this_thread_when_idle() noexcept {
#ifdef __linux__
  const sched_param parameters{};
  sched_setscheduler(0, SCHED_IDLE, &parameters);  // on Linux, 0 is this thread only
#endif
}

/// Requests short time slices that come soon instead of long ones that come late. Has an effect on Linux 6.12 or later
/// only, and not on a thread with a real-time priority.
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
