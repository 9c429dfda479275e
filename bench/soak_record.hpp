#pragma once
// What a long run shows every minute, and whether it stays the same.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <iterator>
#include <span>
#include <string>
#include <utility>

#include "evmarker/live/status.hpp"
#include "verdict.hpp"

namespace evmarker::bench {

/// Counters of a pipeline, summed over its starts, and the errors of its poses.
struct SoakCounts {
  std::uint64_t events = 0, poses = 0, registered = 0, lost = 0, dropped = 0, time_faults = 0, time_steps_back = 0,
                exceptions = 0;
  double tracking = 0, translation_mm2 = 0, rotation_deg2 = 0, nees = 0;  ///< sums over the poses `tracking`

  void add(const live::Status& status) {
    events += status.events;
    poses += status.poses;
    registered += status.registered;
    lost += status.lost;
    dropped += status.dropped;
    time_faults += status.time_faults;
    time_steps_back += status.time_steps_back;
    exceptions += status.callback_errors + status.detector_errors;
  }

  void add(const JudgedPose& pose) {
    if (!pose.tracking()) return;
    ++tracking;
    translation_mm2 += pose.error.translation_mm * pose.error.translation_mm;
    rotation_deg2 += pose.error.rotation_deg * pose.error.rotation_deg;
    nees += pose.nees;
  }

  /// What has been added since an earlier moment.
  SoakCounts since(const SoakCounts& before) const {
    return {events - before.events,
            poses - before.poses,
            registered - before.registered,
            lost - before.lost,
            dropped - before.dropped,
            time_faults - before.time_faults,
            time_steps_back - before.time_steps_back,
            exceptions - before.exceptions,
            tracking - before.tracking,
            translation_mm2 - before.translation_mm2,
            rotation_deg2 - before.rotation_deg2,
            nees - before.nees};
  }

  double rms_mm() const { return std::sqrt(translation_mm2 / tracking); }
  double rms_deg() const { return std::sqrt(rotation_deg2 / tracking); }
  double mean_nees() const { return nees / tracking; }
};

/// A minute of a long run.
struct SoakMinute {
  double seconds = 0;  ///< how long it took
  double resident_mb = 0;
  SoakCounts counts;
};

/// What must hold for a long run.
struct SoakLimits {
  double growth_mb = 1;  ///< of memory, from the first minute to any other
  double change = 0.02;  ///< of error and NEES, from the first minute to the last
};

/// Names what does not hold; empty if all does.
inline std::string find_fault(std::span<const SoakMinute> minutes, const SoakLimits& limits = {}) {
  if (minutes.size() < 2) return "there are fewer than two minutes to compare";
  char text[160];
  const SoakMinute &first = minutes.front(), &last = minutes.back();
  const double most_mb = std::ranges::max_element(minutes, {}, &SoakMinute::resident_mb)->resident_mb;
  if (most_mb > first.resident_mb + limits.growth_mb) {
    std::snprintf(text, sizeof text, "memory has grown by %.1f MB", most_mb - first.resident_mb);
    return text;
  }
  for (const auto& [name, value] : {std::pair("translation error", &SoakCounts::rms_mm),
                                    {"rotation error", &SoakCounts::rms_deg},
                                    {"NEES", &SoakCounts::mean_nees}}) {
    const double before = (first.counts.*value)(), after = (last.counts.*value)();
    if (std::abs(after - before) <= limits.change * before) continue;  // not where one is NaN
    std::snprintf(text, sizeof text, "%s has changed from %.4f to %.4f", name, before, after);
    return text;
  }
  for (const auto& [name, count] : {std::pair("events dropped", &SoakCounts::dropped),
                                    {"time faults", &SoakCounts::time_faults},
                                    {"steps back in time", &SoakCounts::time_steps_back},
                                    {"exceptions", &SoakCounts::exceptions},
                                    {"losses", &SoakCounts::lost}}) {
    std::uint64_t sum = 0;
    for (const SoakMinute& minute : minutes) sum += minute.counts.*count;
    if (sum > 0) return std::to_string(sum) + " " + name;
  }
  return "";
}

}  // namespace evmarker::bench
