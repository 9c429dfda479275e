// Plays recordings with faults of the sensor and of its transmission through a pipeline: what is reported, lost, found
// again, and whether a pose is wrong in between.
#include <CLI/CLI.hpp>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <future>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "../examples/console.hpp"
#include "evmarker/live/pipeline.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "fault_verdict.hpp"
#include "injected_faults.hpp"
#include "scenarios.hpp"
#include "tracker_methods.hpp"

using namespace evmarker;

namespace {

// When a fault happens in each recording, and how long that is [us].
const std::vector<Timestamp> kMoments{600000, 2600000, 4600000};
constexpr double kDuration_s = 6.4;

struct Options {
  std::vector<std::uint64_t> seeds{1, 2, 3};
  std::string only;
  bool quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("--seeds", seeds, "one recording each")->delimiter(',')->expected(1, -1)->capture_default_str();
    app.add_option("--only", only, "only the faults whose name contains this, and none");
    app.add_flag("--quiet", quiet, "no progress bar");
  }
};

// Counters of the pipeline, summed over recordings.
struct Reported {
  std::uint64_t time_faults = 0, time_steps_back = 0, time_gaps = 0, outages = 0, hot = 0, filtered = 0;

  void add(const live::Status& status) {
    time_faults += status.time_faults;
    time_steps_back += status.time_steps_back;
    time_gaps += status.time_gaps;
    outages += status.outages;
    hot += status.hot;
    filtered += status.filtered;
  }

  /// @param usual that of the same recordings without a fault
  std::string text(const Reported& usual) const {
    std::string text;
    const auto add = [&](std::uint64_t count, const char* what) {
      if (count > 0) text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + what;
    };
    add(time_faults, "time faults");
    add(time_steps_back, "steps back");
    add(time_gaps, "gaps");
    add(outages, "outages");
    add(hot, "of hot pixels");
    constexpr std::uint64_t kMany = 10000;
    if (filtered > usual.filtered + kMany) add(filtered - usual.filtered, "filtered");
    return text.empty() ? "-" : text;
  }
};

// What one update rule made of one fault.
struct Outcome {
  Reported reported;
  bench::FaultVerdict verdict;
};

// Tracks a recording. As the pipeline waits for the detector, the outcome does not depend on the machine's speed.
template <PoseUpdateRule Rule>
void track(const bench::Situation& situation, const std::vector<bench::RecordingPiece>& pieces,
           const bench::Fault& fault, Outcome& outcome) {
  using Detector = opencv::ArucoDetector<PinholeCamera>;
  Timestamp clock_ahead_us = 0;
  outcome.verdict.begin_recording();
  live::Pipeline<Detector, Rule> pipeline(
      situation.camera,
      Detector(situation.camera, {.dictionary = situation.dictionary, .marker_length = situation.marker_length()}),
      [&](const PoseEstimate& pose) { outcome.verdict.add(situation, pose, clock_ahead_us); },
      {.overload = live::OverloadPolicy::block, .wait_for_detector = true});
  for (const bench::RecordingPiece& piece : pieces) {
    clock_ahead_us = piece.clock_ahead_us;
    pipeline.push(piece.events);
    pipeline.flush();
  }
  outcome.verdict.end_recording(kMoments, fault.duration_us);
  outcome.reported.add(pipeline.status());
  pipeline.stop();
}

// A fault and what each update rule made of it.
struct Row {
  bench::Fault fault;
  Outcome kalman, paper;
};

std::vector<Row> play(const Options& options) {
  std::vector<Row> rows;
  for (bench::Fault& fault : bench::all_faults())
    if (rows.empty() || fault.name.find(options.only) != std::string::npos) rows.push_back({std::move(fault), {}, {}});
  if (rows.size() == 1 && rows.front().fault.name.find(options.only) == std::string::npos)
    throw std::invalid_argument("--only: no fault has \"" + options.only + "\" in its name");
  console::ProgressBar progress(options.quiet);
  std::size_t done = 0;
  for (const std::uint64_t seed : options.seeds) {
    bench::Situation situation = bench::scenarios().front().make(seed);
    situation.simulator.duration_s = kDuration_s;
    const auto events = bench::simulate(situation);
    for (Row& row : rows) {
      const auto pieces = with_fault(row.fault, events, situation.camera.sensor_size(), kMoments, seed);
      auto kalman =
          std::async(std::launch::async, [&] { track<KalmanUpdate>(situation, pieces, row.fault, row.kalman); });
      track<DecoupledUpdate>(situation, pieces, row.fault, row.paper);
      kalman.get();
      progress.update(++done, options.seeds.size() * rows.size());
    }
  }
  return rows;
}

void print(const bench::FaultVerdict& verdict) {
  std::printf(" %s | %.1f | %.1f / %.1f | %zu", verdict.losses().c_str(), verdict.settled_ms(),
              verdict.worst().translation_mm, verdict.worst().rotation_deg, verdict.wrong());
  if (verdict.wrong() > 0) std::printf(", %.1f ms", verdict.longest_wrong_ms());
  std::printf(" |");
}

// Throws where a pose was wrong or the marker was not found again.
void run(const Options& options) {
  const std::vector<Row> rows = play(options);
  std::printf("%zu recordings of %.1f s, %zu faults in each\n\n", options.seeds.size(), kDuration_s, kMoments.size());
  std::puts(
      "| fault | reported | Kalman: lost | tracked again [ms] | largest error | wrong | paper's rule: lost | tracked "
      "again [ms] | largest error | wrong |\n|---|---|---|---|---|---|---|---|---|---|");
  std::size_t wrong = 0, never_again = 0;
  for (const Row& row : rows) {
    std::printf("| %s | %s |", row.fault.name.c_str(), row.kalman.reported.text(rows.front().kalman.reported).c_str());
    for (const bench::FaultVerdict* const verdict : {&row.kalman.verdict, &row.paper.verdict}) {
      print(*verdict);
      wrong += verdict->wrong();
      never_again += std::isinf(verdict->settled_ms());
    }
    std::puts("");
  }
  if (wrong > 0) throw std::runtime_error(std::to_string(wrong) + " poses called tracking are wrong");
  if (never_again > 0) throw std::runtime_error("a marker was not found again");
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("faults", "Plays recordings with faults through the pipeline; a table of what follows.",
                               argc, argv, run);
}
