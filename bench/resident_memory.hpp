#pragma once
// How much memory this process takes.
#include <unistd.h>

#include <cstdint>
#include <fstream>

namespace evmarker::bench {

/// Resident memory of this process [MiB]; 0 where there is no /proc.
inline double resident_mb() {
  std::int64_t total = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(sysconf(_SC_PAGESIZE)) / 1048576;
}

}  // namespace evmarker::bench
