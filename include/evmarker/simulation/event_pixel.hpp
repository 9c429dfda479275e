#pragma once
// Model of one pixel of an event camera: which events it makes, and when.
#include <cmath>
#include <limits>

namespace evmarker {

/// Parameters that all pixels of a sensor share.
struct EventPixelDynamics {
  double time_constant_us = 0;  ///< of the first-order low-pass before the comparators; 0: no low-pass
  double refractory_us = 50;    ///< dead time after an event
};

/// An event camera's pixel (Lichtsteiner, Posch and Delbruck, "A 128x128 120 dB 15 us latency asynchronous temporal
/// contrast vision sensor", 2008). It compares the low-passed logarithm of the intensity with the level that it
/// memorised at the end of the dead time after its last event, and fires ON or OFF when the difference reaches a
/// threshold. The memorised level falls by a leak, which causes ON events. Times in us, levels in natural logarithms of
/// intensity.
class EventPixel {
 public:
  /// A pixel at time 0 that has settled at a log intensity.
  /// @param leak_per_us fall of the memorised level per microsecond
  /// @param leaked fall of the memorised level until time 0
  EventPixel(double log_intensity, double threshold_on, double threshold_off, double leak_per_us = 0,
             double leaked = 0) noexcept
      : input_(static_cast<float>(log_intensity)),
        level_(input_),
        memory_(static_cast<float>(log_intensity - leaked)),
        threshold_on_(static_cast<float>(threshold_on)),
        threshold_off_(static_cast<float>(threshold_off)),
        leak_per_us_(static_cast<float>(leak_per_us)) {}

  /// Simulates the pixel from t0 to a later t1, while the log intensity changes linearly from its last value to
  /// `log_intensity`.
  /// @param t0 end of the last call
  /// @param emit `double emit(double t, bool on)` is called for every event and returns the time at which the event
  ///   leaves the pixel, not before t; the dead time starts then
  template <typename Emit>
  void advance(double t0, double t1, double log_intensity, const EventPixelDynamics& dynamics, Emit&& emit) {
    const Ramp ramp(t0, t1, input_, log_intensity, level_, dynamics.time_constant_us);
    const double end_level = ramp.level(t1);
    for (double t = t0;;) {
      if (dead()) {
        if (reset_us_ >= t1) break;
        t = std::fmax(t, reset_us_);
        memory_ = static_cast<float>(ramp.level(t));
      }
      const double upper = memory_at(t1) + threshold_on_, lower = memory_at(t1) - threshold_off_;
      const bool on = end_level >= upper;
      if (!on && !(end_level <= lower)) break;
      t = ramp.crossing(t, t1, on ? upper : lower, leak_per_us_);
      start_dead_time(emit(t, on) + dynamics.refractory_us);
    }
    input_ = static_cast<float>(log_intensity);
    level_ = static_cast<float>(end_level);
  }

  /// Fires a noise event, unless the pixel is in its dead time.
  /// @param t time up to which the pixel has been advanced
  /// @param emit as for `advance`
  template <typename Emit>
  void fire(double t, bool on, const EventPixelDynamics& dynamics, Emit&& emit) {
    if (!dead() || reset_us_ <= t) start_dead_time(emit(t, on) + dynamics.refractory_us);
  }

  /// Time at which a settled pixel will fire by its leak alone if the light stays constant; infinity without a leak.
  double leak_event_us() const noexcept {
    if (!(leak_per_us_ > 0)) return std::numeric_limits<double>::infinity();
    const double rest = dead() ? threshold_on_ : static_cast<double>(memory_) + threshold_on_ - level_;
    return reset_us_ + rest / leak_per_us_;
  }

  /// Sets the low-passed level to the log intensity if it is within 1e-4 of it, as it will be under constant light.
  /// @return false if it is not, and nothing changes
  bool settle() noexcept {
    if (std::abs(level_ - input_) > 1e-4f) return false;
    level_ = input_;
    return true;
  }

  /// The last log intensity, and its low-passed level.
  double log_intensity() const noexcept { return input_; }
  double level() const noexcept { return level_; }

 private:
  // True from an event until the memory is set at the end of its dead time.
  bool dead() const noexcept { return std::isnan(memory_); }
  void start_dead_time(double until_us) noexcept {
    memory_ = std::numeric_limits<float>::quiet_NaN();
    reset_us_ = until_us;
  }
  double memory_at(double t) const noexcept { return memory_ - leak_per_us_ * (t - reset_us_); }

  // The low-pass's response to a linear change of its input, in closed form.
  class Ramp {
   public:
    Ramp(double t0, double t1, double input0, double input1, double level0, double time_constant)
        : t0_(t0), input0_(input0), slope_((input1 - input0) / (t1 - t0)), time_constant_(time_constant) {
      transient_ = level0 - input0 + slope_ * time_constant;
    }

    double level(double t) const {
      const double line = input0_ + slope_ * (t - t0_);
      if (time_constant_ <= 0) return line;
      return line - slope_ * time_constant_ + transient_ * std::exp((t0_ - t) / time_constant_);
    }

    // The time between `low` and `high` at which the level meets a line that falls by `fall_per_us` to `target` at time
    // `high`. Requires that they meet. Regula falsi with the Illinois weighting; a linear level takes one iteration.
    double crossing(double low, double high, double target, double fall_per_us) const {
      const double end = high;
      const auto gap = [&](double at) { return level(at) - (target + fall_per_us * (end - at)); };
      double below = gap(low), above = gap(high);
      double t = high;
      for (int iteration = 0; iteration < 40 && high - low > 1e-3; ++iteration) {
        if (below == 0 || above * below > 0) return low;  // they met before `low`, by rounding to single precision
        t = std::fmin(std::fmax(high - above * (high - low) / (above - below), low), high);
        const double error = gap(t);
        if (std::abs(error) < 1e-9) break;
        if ((error > 0) == (above > 0)) {
          high = t;
          above = error;
          below /= 2;
        } else {
          low = t;
          below = error;
          above /= 2;
        }
      }
      return t;
    }

   private:
    double t0_, input0_, slope_, time_constant_, transient_;
  };

  // In single precision, so that many pixels fit the processor's cache; rounding errors do not accumulate.
  float input_, level_, memory_;  // memory_: the memorised level, NaN while dead
  float threshold_on_, threshold_off_, leak_per_us_;
  double reset_us_ = 0;  // end of the dead time: from here on the memory leaks
};

}  // namespace evmarker
