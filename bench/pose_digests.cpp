// One digest of all poses, bit by bit, for every scenario, real recording and way to push: what a change that is meant
// to change nothing has to keep.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <opencv2/core/utility.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/simd/wide_vectors.hpp"
#include "real_recordings.hpp"
#include "tracker_methods.hpp"

using namespace evmarker;

namespace {

// FNV-1a over the bits of numbers.
class Digest {
 public:
  template <typename Number>
  void add(Number number) {
    static_assert(sizeof(Number) <= sizeof(std::uint64_t));
    std::uint64_t bits = 0;
    if constexpr (std::is_floating_point_v<Number>)
      bits = std::bit_cast<std::uint64_t>(static_cast<double>(number));
    else
      bits = static_cast<std::uint64_t>(number);
    for (int byte = 0; byte < 8; ++byte, bits >>= 8) hash_ = (hash_ ^ (bits & 0xFF)) * 0x100000001B3;
  }

  void add(const PoseEstimate& pose) {
    const auto add_all = [this](const auto& matrix) {
      for (Eigen::Index i = 0; i < matrix.size(); ++i) add(matrix.data()[i]);
    };
    add(pose.id);
    add(pose.t);
    add_all(pose.T_camera_marker.matrix());
    if (pose.covariance) add_all(*pose.covariance);
    if (pose.twist) add_all(*pose.twist);
    add(pose.edge_offset_px.value_or(0));
    add(pose.trail_px.value_or(0));
    const TrackingQuality& quality = pose.quality;
    add(static_cast<int>(quality.state));
    add(static_cast<int>(quality.loss_reason));
    add(quality.health);
    add(quality.matched);
    add(quality.offered);
    add(quality.residual_px);
    add(quality.updated_t);
    if (quality.backtrack_t > 0) {
      add(quality.backtrack_px);
      add(quality.backtrack_rad);
      add(quality.backtrack_angle_rad);
      add(quality.backtrack_t);
    }
    ++poses_;
  }

  std::string text() const {
    char line[64];
    std::snprintf(line, sizeof line, "%llu %016llx", poses_, static_cast<unsigned long long>(hash_));
    return line;
  }

 private:
  std::uint64_t hash_ = 0xCBF29CE484222325;
  unsigned long long poses_ = 0;
};

// Another compiler or processor rounds otherwise.
std::string build() {
#if defined(__clang__)
  const std::string compiler = "clang-" + std::to_string(__clang_major__);
#else
  const std::string compiler = "gcc-" + std::to_string(__GNUC__);
#endif
#if defined(__GNUC__) && defined(__x86_64__)
  return compiler + "-" + std::to_string(evmarker::simd::detail::kVectorBits);
#else
  return compiler;
#endif
}

using Digests = std::map<std::string, std::string>;  // by case

struct Options {
  std::filesystem::path data = EVMARKER_SHARED_DATA;
  std::string only;
  unsigned seed = 9001;

  bool wanted(const std::string& name) const { return name.find(only) != std::string::npos; }
};

// Runs a case with every rule and both ways to push. `run` is called with a rule's name, the rule, and a trial.
template <typename Run>
void digest_all(const std::string& name, Digests& digests, const Run& run) {
  const auto digest = [&]<typename Rule>(const char* rule, const Rule& type) {
    for (const bool one_by_one : {false, true}) {
      Digest all;
      bench::Trial trial;
      trial.one_by_one = one_by_one;
      trial.watch = [&](const PoseEstimate& pose) { all.add(pose); };
      run(type, trial);
      const std::string full = name + "/" + rule + (one_by_one ? "/one_by_one" : "/ranges");
      digests[full] = all.text();
      std::fprintf(stderr, "%s %s\n", full.c_str(), all.text().c_str());
    }
  };
  digest("kalman", static_cast<KalmanUpdate*>(nullptr));
  digest("decoupled", static_cast<DecoupledUpdate*>(nullptr));
}

void digest_scenarios(const Options& options, Digests& digests) {
  for (const bench::Scenario& scenario : bench::scenarios()) {
    if (!options.wanted(scenario.name)) continue;
    bench::Situation situation = scenario.make(options.seed);
    constexpr double kEnough_s = 0.5;  // but for what is lost and found again
    if (scenario.name != "occluded" && scenario.name != "leaving")
      situation.simulator.duration_s = std::min(situation.simulator.duration_s, kEnough_s);
    const std::vector<Event> events = bench::simulate(situation);
    const opencv::ArucoDetector detector(
        situation.camera, {.dictionary = situation.dictionary, .marker_length = situation.marker_length()});
    digest_all(scenario.name, digests, [&]<typename Rule>(const Rule*, const bench::Trial& trial) {
      Tracker<std::remove_const_t<decltype(detector)>, Rule> tracker(situation.camera, detector);
      bench::push(tracker, events, trial, [](const PoseEstimate&) {});
    });
  }
}

void digest_recordings(const Options& options, Digests& digests) {
  if (!std::filesystem::exists(options.data)) return;
  const auto digest = [&](const char* name, const auto& judge) {
    if (options.wanted(name)) digest_all(name, digests, judge);
  };
  digest("pyramid", [&]<typename Rule>(const Rule*, const bench::Trial& trial) {
    bench::judge_pyramid<Rule>(options.data, trial);
  });
  digest("flip",
         [&]<typename Rule>(const Rule*, const bench::Trial& trial) { bench::judge_flip<Rule>(options.data, trial); });
  digest("tags", [&]<typename Rule>(const Rule*, const bench::Trial& trial) {
    bench::judge_tags<Rule>(options.data, false, trial);
  });
  digest("board", [&]<typename Rule>(const Rule*, const bench::Trial& trial) {
    bench::judge_tags<Rule>(options.data, true, trial);
  });
}

// Lines `build case poses digest`, of any number of builds.
std::map<std::string, Digests> read(const std::filesystem::path& path) {
  std::map<std::string, Digests> by_build;
  std::ifstream file(path);
  for (std::string build, name, poses, digest; file >> build >> name >> poses >> digest;)
    by_build[build][name] = poses + " " + digest;
  return by_build;
}

void write(const std::filesystem::path& path, const std::map<std::string, Digests>& by_build) {
  std::ostringstream text;
  for (const auto& [build, digests] : by_build)
    for (const auto& [name, digest] : digests) text << build << " " << name << " " << digest << "\n";
  std::ofstream file(path);
  if (!(file << text.str()).flush()) throw std::runtime_error(path.string() + " cannot be written");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Compares digests of all poses with those that were recorded");
  Options options;
  std::filesystem::path path;
  bool record = false;
  app.add_option("file", path, "recorded digests")->required();
  app.add_flag("--record", record, "write this build's digests there instead of comparing them");
  app.add_option("--data", options.data, "folder of the real recordings")->capture_default_str();
  app.add_option("--only", options.only, "cases whose name contains this");
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    auto recorded = read(path);
    if (!record && !recorded.contains(build())) {
      std::printf("skipped: %s holds no digests of %s\n", path.c_str(), build().c_str());
      return 0;
    }
    Digests now;
    digest_scenarios(options, now);
    digest_recordings(options, now);
    if (now.empty()) throw std::runtime_error("no case's name contains '" + options.only + "'");
    Digests& then = recorded[build()];
    int changed = 0;
    for (const auto& [name, digest] : now) {
      if (then[name] == digest) continue;
      ++changed;
      std::printf("%s: %s, recorded %s\n", name.c_str(), digest.c_str(),
                  then[name].empty() ? "nothing" : then[name].c_str());
      then[name] = digest;
    }
    std::printf("%zu cases, %d changed\n", now.size(), changed);
    if (record) write(path, recorded);
    return changed == 0 || record ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "pose_digests: %s\n", error.what());
    return 1;
  }
}
