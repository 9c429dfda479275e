#pragma once
// Where the real recordings are.
#include <doctest/doctest.h>

#include <filesystem>

namespace evmarker::test {

inline const std::filesystem::path kData = EVMARKER_SHARED_DATA;

/// Says that the test is skipped where this recording is not.
inline bool missing(const std::filesystem::path& folder) {
  if (std::filesystem::exists(folder / "events.csv")) return false;
  MESSAGE("skipped: no " << (folder / "events.csv").string());
  return true;
}

}  // namespace evmarker::test
