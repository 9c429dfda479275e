#pragma once
// Finds rows and columns of the sensor that go on firing, as broken ones do.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "evmarker/events/event.hpp"

namespace evmarker {

/// Finds hot lines by counting a sample of the events in every row and column.
///
/// An edge that passes makes a pixel fire some 20 times at most, all with one polarity. A line is hot if in one epoch
/// (0.26 s, see HotPixels) its pixels fired 40 times each on average, nearly all with one polarity, or 120 times with
/// either, and eight times as often as those of the lines 2 px away, to both sides. That takes fewer events of a pixel
/// than HotPixels needs to judge it alone. An edge that vibrates along a whole line, tilted by less than 2 px, would be
/// taken for a broken line, too, and its events lost.
class HotLines {
 public:
  /// @param events_per_sample one in so many events is counted
  HotLines(SensorSize size, double events_per_sample)
      : columns_(size.width, size.height, events_per_sample), rows_(size.height, size.width, events_per_sample) {}

  /// Which lines of an event were found hot now. While these go on firing, they are found again and again.
  struct Found {
    bool column, row;
  };

  /// Counts one sampled event, which must lie on the sensor.
  /// @param epoch number of the present period of time; what was counted in another one is forgotten
  Found count(const Event& event, std::uint32_t epoch) noexcept {
    return {columns_.count(event.x, event.p > 0, epoch), rows_.count(event.y, event.p > 0, epoch)};
  }

 private:
  // All lines of one direction.
  class Lines {
   public:
    Lines(int count, int length_px, double events_per_sample)
        : lines_(static_cast<std::size_t>(count)),
          judged_every_(static_cast<std::uint32_t>(std::max(1.0, kEventsPerPixel * length_px / events_per_sample))) {}

    bool count(std::size_t number, bool on, std::uint32_t epoch) noexcept {
      Line& line = lines_[number];
      if (line.epoch != epoch) line = {.epoch = epoch};
      ++line.samples;
      line.on += on;
      if (line.samples % judged_every_ != 0) return false;
      const std::uint32_t of_one_polarity = std::max(line.on, line.samples - line.on);
      const bool many = of_one_polarity >= kOnePolarity * line.samples || line.samples >= kMoreOfBoth * judged_every_;
      return many && is_quiet(number - kBeside, line) && is_quiet(number + kBeside, line);
    }

   private:
    static constexpr double kEventsPerPixel = 40;
    static constexpr double kOnePolarity = 0.95;     // least share: other events lie on the line, too
    static constexpr std::uint32_t kMoreOfBoth = 3;  // times as many events, if they are of both polarities
    static constexpr std::uint32_t kTimesMore = 8;   // events than on the lines beside it
    static constexpr std::size_t kBeside = 2;        // [px]

    struct Line {
      std::uint32_t epoch = 0, samples = 0, on = 0;
    };

    // Beyond the sensor's border all is quiet; numbers below 0 wrap to beyond it, too.
    bool is_quiet(std::size_t number, const Line& judged) const noexcept {
      if (number >= lines_.size() || lines_[number].epoch != judged.epoch) return true;
      return lines_[number].samples * kTimesMore <= judged.samples;
    }

    std::vector<Line> lines_;
    std::uint32_t judged_every_;  // samples
  };

  Lines columns_, rows_;
};

}  // namespace evmarker
