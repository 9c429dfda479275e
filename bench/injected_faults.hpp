#pragma once
// Faults of a sensor and of its transmission, put into a recording at given moments.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/simulation/random.hpp"

namespace evmarker::bench {

/// Where and when a fault happens.
struct FaultPlace {
  SensorSize sensor;
  Timestamp begin = 0, end = 0;  ///< [us], `end` is the first time after it
};

/// Something that goes wrong for a while; all is well again after `duration_us`, but for the clock.
struct Fault {
  std::string name;
  Timestamp duration_us = 0;
  /// Makes what the camera delivers of the events that fall into the fault.
  std::function<std::vector<Event>(std::span<const Event>, const FaultPlace&, Random&)> alter;
  Timestamp clock_step_us = 0;  ///< at the end, the camera's clock goes on by so much, or back
  bool clock_restarts = false;  ///< at the end, the camera's clock begins again at 0
};

/// Events with the time that their camera's clock shows more than that of the recording without faults.
struct RecordingPiece {
  std::vector<Event> events;
  Timestamp clock_ahead_us = 0;
};

namespace detail {

inline std::span<const Event> events_before(std::span<const Event> events, Timestamp t) {
  return events.first(static_cast<std::size_t>(std::ranges::lower_bound(events, t, {}, &Event::t) - events.begin()));
}

/// The events in packets of equal length in time.
inline std::vector<std::span<const Event>> packets_of(std::span<const Event> events, Timestamp begin,
                                                      Timestamp length_us) {
  std::vector<std::span<const Event>> packets;
  for (Timestamp end = begin + length_us; !events.empty(); end += length_us) {
    packets.push_back(events_before(events, end));
    events = events.subspan(packets.back().size());
  }
  return packets;
}

inline void append(std::vector<Event>& all, std::span<const Event> more) {
  all.insert(all.end(), more.begin(), more.end());
}

/// The events together with others, in order of time.
inline std::vector<Event> merged(std::span<const Event> events, std::vector<Event> others) {
  append(others, events);
  std::ranges::stable_sort(others, {}, &Event::t);
  return others;
}

}  // namespace detail

/// Events are missing, and nothing says so.
inline Fault missing_events(std::string name, Timestamp duration_us) {
  return {std::move(name), duration_us, [](auto, const FaultPlace&, Random&) { return std::vector<Event>(); }};
}

inline Fault packets_twice(std::string name, Timestamp duration_us, Timestamp packet_us) {
  return {std::move(name), duration_us, [=](std::span<const Event> events, const FaultPlace& place, Random&) {
            std::vector<Event> all;
            for (const auto packet : detail::packets_of(events, place.begin, packet_us))
              for (int copy = 0; copy < 2; ++copy) detail::append(all, packet);
            return all;
          }};
}

/// The first packet comes after the second, the third after the fourth, and so on.
inline Fault packets_exchanged(std::string name, Timestamp duration_us, Timestamp packet_us) {
  return {std::move(name), duration_us, [=](std::span<const Event> events, const FaultPlace& place, Random&) {
            auto packets = detail::packets_of(events, place.begin, packet_us);
            for (std::size_t i = 1; i < packets.size(); i += 2) std::swap(packets[i - 1], packets[i]);
            std::vector<Event> all;
            for (const auto packet : packets) detail::append(all, packet);
            return all;
          }};
}

/// One event in `every` has a time that is off by up to `most_us`.
inline Fault garbled_times(std::string name, Timestamp duration_us, std::size_t every, double most_us) {
  return {std::move(name), duration_us, [=](std::span<const Event> events, const FaultPlace&, Random& random) {
            std::vector<Event> all(events.begin(), events.end());
            for (std::size_t i = 0; i < all.size(); i += every)
              all[i].t += static_cast<Timestamp>(random.uniform(-most_us, most_us));
            return all;
          }};
}

inline Fault clock_step(std::string name, Timestamp step_us) {
  return {.name = std::move(name),
          .alter = [](std::span<const Event> events, const FaultPlace&,
                      Random&) { return std::vector<Event>(events.begin(), events.end()); },
          .clock_step_us = step_us};
}

/// Every pixel of the image's middle column fires ON events, or ON and OFF in turn, at a rate of its own, whatever it
/// sees.
inline Fault hot_column(std::string name, Timestamp duration_us, double hz_per_px, bool both_polarities = false) {
  return {std::move(name), duration_us, [=](std::span<const Event> events, const FaultPlace& place, Random& random) {
            std::vector<Event> hot;
            for (int y = 0; y < place.sensor.height; ++y) {
              const double period_us = 1e6 / (hz_per_px * random.uniform(0.9, 1.1));
              std::int16_t polarity = 1;
              for (double t = static_cast<double>(place.begin) + random.uniform() * period_us;
                   t < static_cast<double>(place.end); t += period_us) {
                hot.push_back({static_cast<std::uint16_t>(place.sensor.width / 2), static_cast<std::uint16_t>(y),
                               polarity, static_cast<Timestamp>(t)});
                if (both_polarities) polarity = 1 - polarity;
              }
            }
            return detail::merged(events, std::move(hot));
          }};
}

/// Events of random pixels and polarity.
inline Fault noise_burst(std::string name, Timestamp duration_us, double events_per_us) {
  return {std::move(name), duration_us, [=](std::span<const Event> events, const FaultPlace& place, Random& random) {
            const auto below = [&](int end) { return static_cast<std::uint16_t>(random.uniform(0, end)); };
            std::vector<Event> noise;
            for (double t = static_cast<double>(place.begin); t < static_cast<double>(place.end);
                 t += 1 / events_per_us)
              noise.push_back({below(place.sensor.width), below(place.sensor.height),
                               static_cast<std::int16_t>(random.uniform() < 0.5), static_cast<Timestamp>(t)});
            return detail::merged(events, std::move(noise));
          }};
}

/// The sensor is switched off and on: in the last 2 ms every pixel fires once, and the clock begins again.
inline Fault sensor_restart(std::string name, Timestamp duration_us) {
  return {.name = std::move(name),
          .duration_us = duration_us,
          .alter =
              [](auto, const FaultPlace& place, Random& random) {
                constexpr double kFlash_us = 2000;
                std::vector<Event> flash;
                for (int y = 0; y < place.sensor.height; ++y)
                  for (int x = 0; x < place.sensor.width; ++x)
                    flash.push_back({static_cast<std::uint16_t>(x), static_cast<std::uint16_t>(y),
                                     static_cast<std::int16_t>(random.uniform() < 0.5),
                                     place.end - 1 - static_cast<Timestamp>(random.uniform(0, kFlash_us))});
                return detail::merged({}, std::move(flash));
              },
          .clock_restarts = true};
}

/// What a camera's clock shows when a recording begins: it has run for an hour.
inline constexpr Timestamp kClockAtBegin_us = 3600000000;

/// A recording in which the fault happens at each of the moments [us], which are in order and further apart than the
/// fault is long. A new piece begins where the clock steps.
inline std::vector<RecordingPiece> with_fault(const Fault& fault, std::span<const Event> events, SensorSize sensor,
                                              std::span<const Timestamp> moments, std::uint64_t seed) {
  Random random(seed);
  std::vector<RecordingPiece> pieces{{{}, kClockAtBegin_us}};
  const auto deliver = [&](std::span<const Event> more) {
    for (Event event : more) {
      event.t += pieces.back().clock_ahead_us;
      pieces.back().events.push_back(event);
    }
  };
  for (const Timestamp begin : moments) {
    const FaultPlace place{sensor, begin, begin + fault.duration_us};
    const auto before = detail::events_before(events, place.begin);
    const auto during = detail::events_before(events.subspan(before.size()), place.end);
    events = events.subspan(before.size() + during.size());
    deliver(before);
    deliver(fault.alter(during, place, random));
    const Timestamp ahead = fault.clock_restarts ? -place.end : pieces.back().clock_ahead_us + fault.clock_step_us;
    if (ahead != pieces.back().clock_ahead_us) pieces.push_back({{}, ahead});
  }
  deliver(events);
  return pieces;
}

/// All kinds of faults; the first is none.
inline std::vector<Fault> all_faults() {
  constexpr Timestamp kMs = 1000, kSecond = 1000 * kMs, kMinute = 60 * kSecond;
  std::vector<Fault> faults{clock_step("none", 0)};
  for (const auto& [name, us] : {std::pair("1 us", Timestamp{1}),
                                 {"100 us", 100},
                                 {"1 ms", kMs},
                                 {"10 ms", 10 * kMs},
                                 {"100 ms", 100 * kMs},
                                 {"1 s", kSecond}})
    faults.push_back(missing_events(std::string("events of ") + name + " missing", us));
  faults.push_back(packets_twice("packets of 0.1 ms twice, for 50 ms", 50 * kMs, kMs / 10));
  faults.push_back(packets_twice("packets of 2 ms twice, for 50 ms", 50 * kMs, 2 * kMs));
  faults.push_back(packets_exchanged("packets of 0.1 ms exchanged, for 50 ms", 50 * kMs, kMs / 10));
  faults.push_back(packets_exchanged("packets of 2 ms exchanged, for 50 ms", 50 * kMs, 2 * kMs));
  faults.push_back(garbled_times("times of 1 % of the events garbled, for 50 ms", 50 * kMs, 100, 0x1p40));
  for (const auto& [name, us] : {std::pair("1 ms", kMs), {"1 s", kSecond}, {"18 min", 18 * kMinute}}) {
    faults.push_back(clock_step(std::string("clock steps forward by ") + name, us));
    faults.push_back(clock_step(std::string("clock steps back by ") + name, -us));
  }
  faults.push_back(hot_column("hot column, 1 kHz each pixel, for 0.3 s", 300 * kMs, 1000));
  faults.push_back(hot_column("hot column, 3 kHz each pixel, for 0.3 s", 300 * kMs, 3000));
  faults.push_back(hot_column("hot column, 10 kHz each pixel, for 0.3 s", 300 * kMs, 10000));
  faults.push_back(hot_column("hot column, 3 kHz of both polarities, for 0.3 s", 300 * kMs, 3000, true));
  faults.push_back(noise_burst("noise of 20 Mev/s, for 50 ms", 50 * kMs, 20));
  faults.push_back(sensor_restart("sensor off for 1 s, then a flash", kSecond));
  return faults;
}

}  // namespace evmarker::bench
