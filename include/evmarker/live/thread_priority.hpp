#pragma once
// Scheduling of the threads that must not wait for others.
#ifdef __linux__
#include <sched.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif
#include <cstdint>

namespace evmarker::live {

#if defined(__linux__) && defined(SCHED_RESET_ON_FORK)
namespace detail {

inline bool has_real_time_priority() noexcept {
  const int policy = sched_getscheduler(0) & ~SCHED_RESET_ON_FORK;  // on Linux, 0 is this thread only
  return policy == SCHED_FIFO || policy == SCHED_RR;
}

// Threads that this one starts do not inherit it.
inline bool set_policy(int policy, int priority) noexcept {
  sched_param parameters{};
  parameters.sched_priority = priority;
  return sched_setscheduler(0, policy | SCHED_RESET_ON_FORK, &parameters) == 0;
}

}  // namespace detail
#endif

/// Gives this thread the lowest real-time priority, if it has none yet: once it has something to do, it runs at once,
/// before all threads without one. Also for the thread that pushes a camera's events. Threads that it starts do not
/// inherit it. Linux only.
/// @return false if that is not permitted, see kRealTimeHint
inline bool request_real_time_priority() noexcept {
#if defined(__linux__) && defined(SCHED_RESET_ON_FORK)
  return detail::has_real_time_priority() || detail::set_policy(SCHED_RR, sched_get_priority_min(SCHED_RR));
#else
  return false;
#endif
}

/// Makes this thread a normal one if it has a real-time priority.
inline void drop_real_time_priority() noexcept {
#if defined(__linux__) && defined(SCHED_RESET_ON_FORK)
  if (detail::has_real_time_priority()) detail::set_policy(SCHED_OTHER, 0);
#endif
}

/// How to permit real-time priority where it was refused.
inline constexpr const char* kRealTimeHint =
    "real-time priority is not permitted here, so that other programs delay the tracking: permit it by `sudo setcap "
    "cap_sys_nice+ep PROGRAM`, or by a line `USER - rtprio 1` in /etc/security/limits.conf";

/// Requests short time slices for this thread, so that it runs soon after it wakes instead of long but late. Has an
/// effect on Linux 6.12 or later only, and not on a thread with a real-time priority. Threads that this one starts do
/// not inherit it.
inline void request_short_time_slices() noexcept {
#if defined(__linux__) && defined(SCHED_RESET_ON_FORK) && defined(SYS_sched_setattr)
  if ((sched_getscheduler(0) & ~SCHED_RESET_ON_FORK) != SCHED_OTHER) return;
  struct {  // the kernel's sched_attr, which the C library does not declare
    std::uint32_t size, policy;
    std::uint64_t flags;
    std::int32_t nice;
    std::uint32_t priority;
    std::uint64_t runtime_ns, deadline_ns, period_ns;
  } attributes{};
  constexpr std::uint64_t kResetOnFork = 1;  // SCHED_FLAG_RESET_ON_FORK
  attributes.size = sizeof(attributes);
  attributes.flags = kResetOnFork;
  attributes.nice = getpriority(PRIO_PROCESS, 0);
  attributes.runtime_ns = 200000;
  syscall(SYS_sched_setattr, 0, &attributes, 0);
#endif
}

}  // namespace evmarker::live
