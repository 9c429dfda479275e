// Writes the paper's real-time figure: computation time over recording time for several n, from raw events to poses.
#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "evmarker/io/output_file.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "recording.hpp"

using namespace evmarker;

namespace {

constexpr Timestamp kStep_us = 20000;

struct Run {
  std::string name;
  std::vector<double> computed_s;  // until every step of the recording
  double translation_mm = 0;
};

// Filter, matching, updates and verification on one thread. Detection is not in it: it runs on a thread of its own.
template <PoseUpdateRule Rule>
Run run(const std::string& rule, int n) {
  const auto& recording = bench::recording();
  SpatiotemporalFilter filter(bench::camera().sensor_size());
  MarkerTrackerSettings<Rule> settings{.events_per_update = n};
  settings.start_search.reset();  // the start is that of a detection
  MarkerTracker<Rule> tracker(bench::camera(), recording.model(), recording.detected_start(), settings);
  Run run{rule + " n=" + std::to_string(n), {}, 0};
  AccuracyMeter accuracy;
  std::vector<Event> accepted;
  std::vector<PoseEstimate> poses;
  accepted.reserve(recording.events.size());
  poses.reserve(recording.events.size());
  std::chrono::duration<double> computed(0);
  std::size_t next = 0;
  for (Timestamp end = kStep_us; next < recording.events.size(); end += kStep_us) {
    poses.clear();
    const auto start = std::chrono::steady_clock::now();
    accepted.clear();
    for (; next < recording.events.size() && recording.events[next].t < end; ++next)
      if (filter.accept(recording.events[next])) accepted.push_back(recording.events[next]);
    tracker.push(accepted, [&](const PoseEstimate& pose) { poses.push_back(pose); });
    computed += std::chrono::steady_clock::now() - start;
    run.computed_s.push_back(computed.count());
    for (const PoseEstimate& pose : poses) accuracy.add(pose, recording.truth(pose.t));
  }
  run.translation_mm = accuracy.translation_mm().mean;
  return run;
}

std::string table(const std::vector<Run>& runs) {
  std::string text = "t_s";
  for (const Run& run : runs) text += "," + run.name;
  char number[32];
  for (std::size_t i = 0; i < runs.front().computed_s.size(); ++i) {
    std::snprintf(number, sizeof number, "\n%.3f", 1e-6 * static_cast<double>(kStep_us) * static_cast<double>(i + 1));
    text += number;
    for (const Run& run : runs) {
      std::snprintf(number, sizeof number, ",%.5f", run.computed_s[i]);
      text += number;
    }
  }
  return text + "\n";
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Measures computation time against recording time for several numbers of events per update");
  std::string output;
  app.add_option("output", output, "CSV file: recording time, then computation time of every rule and n")->required();
  CLI11_PARSE(app, argc, argv);
  try {
    io::OutputFile file(output);  // fails early if it cannot be written
    std::vector<Run> runs;
    for (const int n : {1, 2, 5, 10, 50, 100}) runs.push_back(run<DecoupledUpdate>("paper's rule", n));
    for (const int n : {1, 2, 5, 10, 50, 100}) runs.push_back(run<KalmanUpdate>("Kalman", n));
    const auto& recording = bench::recording();
    const double length_s = 1e-6 * static_cast<double>(recording.end());
    std::printf("%zu events in %.2f s\n", recording.events.size(), length_s);
    for (const Run& run : runs)
      std::printf("%-20s %6.3f s: %5.2f times real time, %6.2f M events/s, %.2f mm\n", run.name.c_str(),
                  run.computed_s.back(), length_s / run.computed_s.back(),
                  1e-6 * static_cast<double>(recording.events.size()) / run.computed_s.back(), run.translation_mm);
    file.write(table(runs));
    file.close();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "real_time: %s\n", error.what());
    return 1;
  }
  return 0;
}
