#pragma once
// Everything that is fuzzed.
#include <algorithm>
#include <string_view>
#include <vector>

#include "fuzz/evt_targets.hpp"
#include "fuzz/pipeline_target.hpp"
#include "fuzz/recording_targets.hpp"
#include "fuzz/ros_targets.hpp"
#include "fuzz/text_targets.hpp"
#include "fuzz/tracking_targets.hpp"

namespace evmarker::fuzz {

inline std::vector<Target> all_targets() {
  std::vector<Target> targets;
  for (auto* const make :
       {evt_targets, recording_targets, ros_targets, text_targets, tracking_targets, pipeline_targets})
    for (Target& target : make()) targets.push_back(std::move(target));
  return targets;
}

}  // namespace evmarker::fuzz
