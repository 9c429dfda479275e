#pragma once
// Trigger events: level changes at the camera's trigger inputs.
#include "evmarker/events/event.hpp"

namespace evmarker {

/// A level change of an external signal, for example of a motion capture system, timed by the camera's clock.
struct TriggerEvent {
  int id = 0;           ///< input, 0..31 in EVT2, 0..15 in EVT3
  bool rising = false;  ///< the level after the change
  Timestamp t = 0;      ///< [us]

  constexpr bool operator==(const TriggerEvent&) const = default;
};

}  // namespace evmarker
