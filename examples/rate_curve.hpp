#pragma once
// How many events per second there are in the course of a recording: mean, peak, and a plot of plain characters.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <evmarker/events/event.hpp>
#include <iterator>
#include <limits>
#include <map>
#include <string>
#include <utility>
#include <vector>

/// Counts events in bins of equal width, at most a few thousand, whatever the length of the recording: where there
/// would be more, two bins become one.
class RateCurve {
 public:
  static constexpr evmarker::Timestamp kWindow_us = 10000;  ///< of the peak

  void add(evmarker::Timestamp t) {
    add_to_window(t);
    if (const evmarker::Timestamp bin = t >> shift_; bins_.empty() || bin != bin_) {
      bin_ = bin;
      count_ = &bins_[bin];
      widen_if_long(t);
    }
    ++*count_;
  }

  /// Highest rate in a window [1/s].
  double peak_hz() const { return 1e6 / kWindow_us * static_cast<double>(most_in_window_); }

  /// Prints the rate from one time to another, up to 78 characters wide; nothing where all events are in one
  /// microsecond.
  void print(evmarker::Timestamp from, evmarker::Timestamp to) const {
    const Bins bins(bins_.lower_bound(from >> shift_), bins_.upper_bound(to >> shift_));
    const std::vector<double> rates = columns(bins);
    if (rates.empty()) return;
    const double top = *std::ranges::max_element(rates);
    for (int row = kRows; row > 0; --row) {
      std::string line;
      for (const double rate : rates) line += mark(rate / top, row);
      line.erase(line.find_last_not_of(' ') + 1);
      std::printf("%9s |%s\n", row == kRows ? text(top).c_str() : "", line.c_str());
    }
    const auto seconds = [&](evmarker::Timestamp bin) { return std::ldexp(1e-6 * static_cast<double>(bin), shift_); };
    std::printf("%9s +%s\n", "0", std::string(rates.size(), '-').c_str());
    std::array<char, 32> begin{}, end{};
    std::snprintf(begin.data(), begin.size(), "%.3f s", seconds(bins.begin()->first));
    std::snprintf(end.data(), end.size(), "%.3f s", seconds(bins.rbegin()->first + 1));
    std::printf("%11s%s%*s\n", "", begin.data(),
                std::max(2 + static_cast<int>(std::string(end.data()).size()),
                         static_cast<int>(rates.size()) - static_cast<int>(std::string(begin.data()).size())),
                end.data());
  }

  /// A rate as "1.23 M/s".
  static std::string text(double hz) {
    std::array<char, 32> text{};
    const bool mega = hz >= 999500, kilo = !mega && hz >= 999.5;
    std::snprintf(text.data(), text.size(), "%.3g%s",
                  mega   ? 1e-6 * hz
                  : kilo ? 1e-3 * hz
                         : hz,
                  mega   ? " M/s"
                  : kilo ? " k/s"
                         : " /s");
    return text.data();
  }

 private:
  using Bins = std::map<evmarker::Timestamp, std::uint64_t>;

  static constexpr std::uint64_t kMostBins = 4096;
  static constexpr std::size_t kColumns = 66;
  static constexpr int kRows = 8;
  // Events that are a little out of order count in the window that has begun.
  void add_to_window(evmarker::Timestamp t) {
    const evmarker::Timestamp window = t / kWindow_us;
    if (window != window_ && window != window_ - 1) {
      window_ = window;
      in_window_ = 0;
    }
    most_in_window_ = std::max(most_in_window_, ++in_window_);
  }

  void widen_if_long(evmarker::Timestamp t) {
    while (evmarker::elapsed_us(bins_.begin()->first, bins_.rbegin()->first) >= kMostBins) {
      Bins wider;
      for (const auto& [bin, count] : bins_) wider[bin >> 1] += count;
      bins_ = std::move(wider);
      bin_ = t >> ++shift_;
      count_ = &bins_[bin_];
    }
  }

  // The rate in each column of the plot [1/s].
  std::vector<double> columns(const Bins& bins) const {
    if (bins.size() < 2) return {};
    const std::size_t count = evmarker::elapsed_us(bins.begin()->first, bins.rbegin()->first) + 1;
    std::uint64_t sum = 0;
    for (const auto& [bin, events] : bins) sum += events;
    constexpr std::uint64_t few = 8;  // in a column, whose height would be chance
    std::vector<double> rates(std::min({count, kColumns, static_cast<std::size_t>(sum / few + 1)}));
    const auto first_of = [&](std::size_t column) { return (column * count + rates.size() - 1) / rates.size(); };
    for (const auto& [bin, events] : bins)
      rates[evmarker::elapsed_us(bins.begin()->first, bin) * rates.size() / count] += static_cast<double>(events);
    for (std::size_t i = 0; i < rates.size(); ++i)
      rates[i] /= std::ldexp(1e-6 * static_cast<double>(first_of(i + 1) - first_of(i)), shift_);
    return rates;
  }

  // A cell is full, half full or empty; a bottom that is nearly empty has a dot.
  static char mark(double share_of_top, int row) {
    const long halves = std::lround(2 * kRows * share_of_top) - 2 * (row - 1);
    if (halves > 0) return halves > 1 ? '#' : ':';
    return row == 1 && share_of_top > 0 ? '.' : ' ';
  }

  Bins bins_;  // of 2^shift_ us, from time 0 on
  int shift_ = 0;
  evmarker::Timestamp bin_ = 0;  // of the last event, and its count
  std::uint64_t* count_ = nullptr;
  evmarker::Timestamp window_ = std::numeric_limits<evmarker::Timestamp>::max();
  std::uint64_t in_window_ = 0, most_in_window_ = 0;
};
