#pragma once
// The summary at the end of a tracking program: counts, poses per marker, errors, time.
#include <cinttypes>
#include <cstdio>
#include <evmarker/evaluation/accuracy.hpp>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/recording_statistics.hpp>
#include <map>
#include <span>
#include <string>

#include "recorded_time.hpp"
#include "recording_faults.hpp"
#include "truth_comparison.hpp"

class TrackSummary {
 public:
  void add(std::span<const evmarker::Event> batch) {
    for (const evmarker::Event& event : batch) recorded_.add(event.t);
  }

  void add(const evmarker::PoseEstimate& pose) {
    if (pose.quality.state == evmarker::TrackingState::lost) ++losses_[pose.id][pose.quality.loss_reason];
  }

  /// From the first event to the last, whatever single times say [s].
  double recorded_s() const { return recorded_.seconds(); }

  void print(const evmarker::io::RecordingStatistics& recording, const evmarker::TrackerStatistics& tracker,
             const TruthComparison& comparison, double wall_s) const {
    const auto share = [&](std::uint64_t n) {
      return 100.0 * static_cast<double>(n) / static_cast<double>(tracker.events);
    };
    const std::uint64_t kept = tracker.events - tracker.off_sensor - tracker.hot - tracker.filtered;
    if (tracker.events > 0)
      std::printf("events     %" PRIu64 " read, %" PRIu64 " kept by the filter (%.0f %%), %" PRIu64
                  " matched (%.0f %%)\n",
                  tracker.events, kept, share(kept), tracker.matched, share(tracker.matched));
    print_faults(recording, tracker);
    recording_faults::print(recorded_.stray(), recording_faults::kStray);
    for (const auto& [id, meter] : comparison.markers()) print(id, meter);
    std::printf("time       %.2f s for %.2f s of recording\n", wall_s, recorded_s());
  }

 private:
  using Losses = std::map<evmarker::LossReason, std::uint64_t>;

  static void print_faults(const evmarker::io::RecordingStatistics& recording,
                           const evmarker::TrackerStatistics& tracker) {
    recording_faults::print(recording);
    recording_faults::print(tracker.outages, "outages, in which even the noise has stopped");
    recording_faults::print(tracker.hot, "events of hot pixels, dropped");
  }

  // As "lost 3 times: 2 hidden, 1 verification".
  static std::string text(const Losses& losses) {
    std::uint64_t sum = 0;
    std::string reasons;
    for (const auto& [reason, count] : losses) {
      sum += count;
      reasons += (reasons.empty() ? ": " : ", ") + std::to_string(count) + ' ' + to_string(reason);
    }
    return "lost " + std::to_string(sum) + " times" + reasons;
  }

  void print(evmarker::MarkerId id, const evmarker::AccuracyMeter& meter) const {
    const auto losses = losses_.find(id);
    std::printf("marker %-3d %zu poses, the first at %.3f s, %s\n", id, meter.poses(),
                static_cast<double>(evmarker::elapsed_us(recorded_.begin(), meter.first_t())) * 1e-6,
                text(losses == losses_.end() ? Losses() : losses->second).c_str());
    if (meter.compared() > 0) {
      const auto mm = meter.translation_mm(), deg = meter.rotation_deg();
      std::printf("           error %.2f mm %.2f deg mean, %.2f mm %.2f deg median, %.2f mm %.2f deg at 95 %%\n",
                  mm.mean, deg.mean, mm.median, deg.median, mm.p95, deg.p95);
      if (meter.compared() < meter.tracking())
        std::printf("           of %zu of its %zu tracking poses: at the times of the others, no true one is known\n",
                    meter.compared(), meter.tracking());
    }
    if (meter.slots(recorded_.end()) > 0)
      std::printf("           tracked in %.1f %% of the 10 ms slots since the first pose\n",
                  100 * meter.coverage(recorded_.end()));
  }

  RecordedTime recorded_;
  std::map<evmarker::MarkerId, Losses> losses_;
};
