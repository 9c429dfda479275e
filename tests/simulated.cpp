#include "simulated.hpp"

#include <utility>

#include "evmarker/simulation/simulator.hpp"

namespace evmarker::simulated {

std::vector<Event> record(const PinholeCamera& pinhole, Scene scene, const SimulatorSettings& settings) {
  Simulator simulator(pinhole, std::move(scene), settings);
  std::vector<Event> events;
  for_each_event(simulator, [&](const Event& event) { events.push_back(event); });
  return events;
}
std::vector<Event> record(const PinholeCamera& pinhole, std::vector<SimulatedMarker> markers,
                          const SimulatorSettings& settings) {
  return record(pinhole, Scene{std::move(markers), {}, {}}, settings);
}

}  // namespace evmarker::simulated
