// The accuracy table: scenarios x methods, on simulated recordings with their truth.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <mutex>
#include <opencv2/core/utility.hpp>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "accuracy_table.hpp"
#include "frame_methods.hpp"
#include "scenarios.hpp"
#include "tracker_methods.hpp"
#include "verdict.hpp"
#ifdef EVMARKER_HAS_APRILTAG
#include "april_tag.hpp"
#endif

using namespace evmarker;
using bench::Method;
using bench::Results;
using bench::Run;
using bench::Situation;
using bench::Verdict;

namespace {

std::vector<Method> methods(int stride) {
  const bench::GreySettings video{60, 0.008, 1.5}, high_speed{1000, 0.0009, 4};
  const std::string part = stride > 1 ? "; one image in " + std::to_string(stride) + ")" : ")";
  std::vector<Method> all{
      {"paper", "paper's numbers", true, &bench::paper_numbers},
      {"tuned", "paper's rule tuned", true, &bench::paper_rule_tuned},
      {"kalman", "Kalman", true, &bench::kalman},
      {"polarity", "ArUco on polarity frame every 5 ms", true, &bench::aruco_on_polarity},
      {"aruco60", "ArUco on grey images 60 Hz (8 ms)", false,
       [=](const Situation& s, const auto&) { return bench::run_grey(s, video, 1, bench::Aruco(s)); }},
      {"aruco1000", "ArUco on grey images 1 kHz (0.9 ms" + part, false,
       [=](const Situation& s, const auto&) { return bench::run_grey(s, high_speed, stride, bench::Aruco(s)); }},
  };
#ifdef EVMARKER_HAS_APRILTAG
  const auto april = [](const Situation& s, const bench::GreySettings& settings, int every) {
    return bench::run_grey(bench::with_april_tags(s), settings, every, bench::AprilTag());
  };
  all.push_back({"april60", "AprilTag 3 on 36h11 tags 60 Hz (8 ms)", false,
                 [=](const Situation& s, const auto&) { return april(s, video, 1); }});
  all.push_back({"april1000", "AprilTag 3 on 36h11 tags 1 kHz (0.9 ms" + part, false,
                 [=](const Situation& s, const auto&) { return april(s, high_speed, stride); }});
#endif
  return all;
}

template <typename T>
std::vector<T> select(const std::vector<T>& all, const std::vector<std::string>& names, const char* what) {
  if (names.empty()) return all;
  std::vector<T> chosen;
  for (const std::string& name : names) {
    const auto known = std::ranges::find(all, name, &T::name);
    if (known == all.end()) {
      std::string message = std::string("no ") + what + " \"" + name + "\"; there are";
      for (const T& one : all) message += " " + one.name;
      throw std::invalid_argument(message);
    }
    chosen.push_back(*known);
  }
  return chosen;
}

class Progress {
 public:
  explicit Progress(std::size_t steps) : steps_(steps), shown_(isatty(STDERR_FILENO) != 0) { show(); }
  ~Progress() {
    if (shown_) std::fputs("\r\033[K", stderr);
  }
  void step() {
    const std::lock_guard lock(mutex_);
    ++done_;
    show();
  }

 private:
  void show() const {
    if (!shown_) return;
    constexpr std::size_t kWidth = 40;
    const std::size_t filled = kWidth * done_ / steps_;
    std::fprintf(stderr, "\r[%s%s] %zu of %zu", std::string(filled, '#').c_str(),
                 std::string(kWidth - filled, ' ').c_str(), done_, steps_);
    std::fflush(stderr);
  }

  std::size_t steps_, done_ = 0;
  bool shown_;
  std::mutex mutex_;
};

using Runs = std::vector<std::vector<std::vector<Run>>>;  // by scenario, method, seed

// Runs every method on one recording.
void run_methods(const Results& results, std::size_t scenario, std::size_t seed, Runs& runs, Progress& progress) {
  const Situation situation = results.scenarios[scenario].make(results.seeds[seed]);
  std::vector<Event> events;
  if (std::ranges::any_of(results.methods, &Method::needs_events)) events = bench::simulate(situation);
  progress.step();
  for (std::size_t method = 0; method < results.methods.size(); ++method) {
    runs[scenario][method][seed] = results.methods[method].run(situation, events);
    progress.step();
  }
}

// Calls `work(i)` for every i below `count` on several threads; after an exception no more are begun.
template <typename Work>
void for_each_in_parallel(std::size_t count, unsigned jobs, const Work& work) {
  std::atomic<std::size_t> next = 0;
  std::exception_ptr failure;
  std::mutex mutex;
  const auto work_on = [&] {
    try {
      for (std::size_t i = next++; i < count; i = next++) work(i);
    } catch (...) {
      const std::lock_guard lock(mutex);
      failure = std::current_exception();
      next = count;
    }
  };
  {
    std::vector<std::jthread> threads;
    for (unsigned i = 0; i + 1 < jobs; ++i) threads.emplace_back(work_on);
    work_on();
  }
  if (failure) std::rethrow_exception(failure);
}

void judge(const Runs& runs, Results& results) {
  const std::size_t scenarios = results.scenarios.size(), methods = results.methods.size(),
                    seeds = results.seeds.size();
  results.all.assign(scenarios, std::vector<Verdict>(methods));
  results.each.assign(scenarios, std::vector<std::vector<Verdict>>(methods, std::vector<Verdict>(seeds)));
  for (std::size_t s = 0; s < scenarios; ++s)
    for (std::size_t k = 0; k < seeds; ++k) {
      const Situation situation = results.scenarios[s].make(results.seeds[k]);
      for (std::size_t m = 0; m < methods; ++m) {
        results.all[s][m].add(situation, runs[s][m][k]);
        results.each[s][m][k].add(situation, runs[s][m][k]);
      }
    }
}

void measure(Results& results, unsigned jobs) {
  const std::size_t seeds = results.seeds.size(), recordings = results.scenarios.size() * seeds;
  Runs runs(results.scenarios.size(), std::vector<std::vector<Run>>(results.methods.size(), std::vector<Run>(seeds)));
  {
    Progress progress(recordings * (results.methods.size() + 1));
    for_each_in_parallel(recordings, jobs,
                         [&](std::size_t i) { run_methods(results, i / seeds, i % seeds, runs, progress); });
  }
  judge(runs, results);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Compares event trackers and frame detectors on simulated recordings with known truth");
  std::vector<std::string> scenario_names, method_names;
  Results results;
  results.seeds = {7001, 7002, 7003};
  std::filesystem::path directory;
  unsigned jobs = 2;
  int stride = 10;
  bool quick = false, as_markdown = false;
  std::string known;
  for (const bench::Scenario& scenario : bench::scenarios()) known += (known.empty() ? "" : ",") + scenario.name;
  app.add_option("--scenarios", scenario_names, known + "; all by default")->delimiter(',');
  app.add_option("--methods", method_names, "paper,tuned,kalman,...; all by default")->delimiter(',');
  app.add_option("--seeds", results.seeds, "one recording each")
      ->delimiter(',')
      ->expected(1, -1)
      ->capture_default_str();
  app.add_option("--out", directory, "directory for accuracy.csv, accuracy.md, accuracy_bars.csv, incidents.csv");
  app.add_option("--jobs", jobs, "threads; events are timed with 1 only")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--grey-stride", stride, "of the 1 kHz images, make every so-many-th")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_flag("--quick", quick, "one seed, and no grey images but at 60 Hz with ArUco");
  app.add_flag("--markdown", as_markdown, "print the table as Markdown");
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    if (quick) results.seeds = {results.seeds.front()};
    if (quick && method_names.empty()) method_names = {"paper", "tuned", "kalman", "polarity", "aruco60"};
    results.scenarios = select(bench::scenarios(), scenario_names, "scenario");
    results.methods = select(methods(stride), method_names, "method");
    results.timed = jobs == 1;
    measure(results, jobs);
    if (!directory.empty()) bench::write_files(results, directory);
    std::fputs((as_markdown ? bench::markdown(results) : bench::plain(results)).c_str(), stdout);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "evmarker_accuracy: %s\n", error.what());
    return 1;
  }
  return 0;
}
