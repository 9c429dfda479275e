// What holds on real recordings, with the settings that the library comes with.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <map>
#include <opencv2/core/utility.hpp>
#include <string>

#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "real_recordings.hpp"

using namespace evmarker;

namespace {

struct Options {
  std::filesystem::path data = EVMARKER_SHARED_DATA;
  std::string only;
  int events_per_update = -1, filter_window_us = -1;  // as the library has it

  bool wanted(const std::string& recording) const {
    if (!only.empty() && only != recording) return false;
    const std::filesystem::path folder = data / (recording == "board" ? "tags" : recording);
    if (std::filesystem::exists(folder / "events.csv")) return true;
    std::printf("skipped: no %s\n", (folder / "events.csv").c_str());
    return false;
  }
  bench::Trial trial() const {
    bench::Trial trial;
    if (events_per_update >= 0) trial.events_per_update = events_per_update;
    if (filter_window_us >= 0) trial.filter_window = std::chrono::microseconds(filter_window_us);
    return trial;
  }
};

std::string text(const std::map<LossReason, int>& losses) {
  std::string all;
  for (const auto& [reason, count] : losses)
    all += (all.empty() ? "" : ", ") + std::to_string(count) + " " + to_string(reason);
  return all.empty() ? "none" : all;
}

void print(const char* recording, const char* rule, const bench::BodyVerdict& v, const char* unit) {
  const Spread length = Spread::of(v.distances), angle = Spread::of(v.angles);
  std::printf(
      "%-8s %-10s right %5.1f %%, wrong %4.1f %% of %d; median %.2f %s %.2f deg, 95 %% %.2f %s %.2f deg; lost: "
      "%s\n",
      recording, rule, 100 * v.right_share(), 100 * v.wrong_share(), v.moments, length.median, unit, angle.median,
      length.p95, unit, angle.p95, text(v.losses).c_str());
}

void print(const char* recording, const char* rule, const bench::TagsVerdict& v) {
  const Spread first = Spread::of(v.first_ms);
  std::printf("%-8s %-10s tracked %zu of %d; first pose %.0f ms mean, %.0f max; corners %.3f px; ", recording, rule,
              v.tracked.size(), v.targets, first.mean, first.max, v.corner_px);
  const auto tell = [](const char* what, const bench::Nees& nees) {
    if (nees.all.empty()) return;
    std::printf("%s %.2f (translation %.2f, rotation %.2f); ", what, Spread::of(nees.all).mean,
                Spread::of(nees.translation).mean, Spread::of(nees.rotation).mean);
  };
  tell("NEES", v.exact);
  tell("with the fit's deviations", v.fit);
  std::printf("lost: %s\n", text(v.losses).c_str());
}

template <PoseUpdateRule Rule>
void judge(const Options& options, const char* rule) {
  const bench::Trial trial = options.trial();
  if (options.wanted("pyramid")) print("pyramid", rule, bench::judge_pyramid<Rule>(options.data, trial), "mm");
  if (options.wanted("flip")) print("flip", rule, bench::judge_flip<Rule>(options.data, trial), "px");
  if (options.wanted("tags")) print("tags", rule, bench::judge_tags<Rule>(options.data, false, trial));
  if (options.wanted("board")) print("board", rule, bench::judge_tags<Rule>(options.data, true, trial));
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Judges the trackers on real recordings; their references are fits, not motion capture");
  Options options;
  std::string method = "both";
  app.add_option("--data", options.data, "folder of the recordings")->capture_default_str();
  app.add_option("--only", options.only, "one recording")->check(CLI::IsMember({"pyramid", "flip", "tags", "board"}));
  app.add_option("--method", method, "update rule")
      ->check(CLI::IsMember({"kalman", "decoupled", "both"}))
      ->capture_default_str();
  app.add_option("--events-per-update", options.events_per_update, "for a trial; as the library has it by default")
      ->check(CLI::NonNegativeNumber);
  app.add_option("--filter-window-us", options.filter_window_us, "the same")->check(CLI::NonNegativeNumber);
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    if (!std::filesystem::exists(options.data)) {
      std::printf("skipped: no %s\n", options.data.c_str());
      return 0;
    }
    if (method != "decoupled") judge<KalmanUpdate>(options, "kalman");
    if (method != "kalman") judge<DecoupledUpdate>(options, "decoupled");
  } catch (const std::exception& error) {
    std::fprintf(stderr, "evmarker_real: %s\n", error.what());
    return 1;
  }
  return 0;
}
