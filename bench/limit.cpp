// How near any estimator could come: what the events of a scenario say about the pose, beside what we make of them.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <map>
#include <numbers>
#include <opencv2/core/utility.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "edge_passages.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/tracking/tracker.hpp"
#include "pose_bound.hpp"
#include "scenarios.hpp"
#include "tracker_methods.hpp"

using namespace evmarker;
using bench::Situation;

namespace {

constexpr double kStep_s = 0.5e-3, kLag_s = 5e-3;
constexpr double kSettled_s = 0.2;  // the start is another matter
constexpr auto kLagSteps = static_cast<std::size_t>(kLag_s / kStep_s);

/// Root mean square errors.
struct Rms {
  double mm = 0, deg = 0;

  static Rms of(const std::vector<Vector6d>& errors) {
    double t2 = 0, r2 = 0;
    for (const Vector6d& error : errors) {
      t2 += error.head<3>().squaredNorm();
      r2 += error.tail<3>().squaredNorm();
    }
    const auto n = static_cast<double>(errors.size());
    return {1e3 * std::sqrt(t2 / n), 180 / std::numbers::pi * std::sqrt(r2 / n)};
  }
};

using Errors = std::map<std::size_t, Vector6d>;  // by step

/// Of our poses: the first in each step in which there is one.
std::vector<Errors> our_errors(const Situation& situation, const std::vector<Event>& events) {
  const auto& markers = situation.scene.markers;
  opencv::ArucoDetector<PinholeCamera> detector(
      situation.camera, {.dictionary = situation.dictionary, .marker_length = situation.marker_length()});
  Tracker<decltype(detector), KalmanUpdate> tracker(situation.camera, detector, {});
  std::vector<Errors> errors(markers.size());
  tracker.push(events, [&](const PoseEstimate& pose) {
    const auto marker = std::ranges::find(markers, pose.id, &SimulatedMarker::id);
    const double t_s = static_cast<double>(pose.t) * 1e-6;
    if (marker == markers.end() || pose.quality.state != TrackingState::tracking || t_s < kSettled_s) return;
    const Eigen::Isometry3d truth = marker->T_camera_marker(t_s);
    Vector6d error;
    error << pose.T_camera_marker.translation() - truth.translation(),
        so3_log(pose.T_camera_marker.linear() * truth.linear().transpose());
    errors[static_cast<std::size_t>(marker - markers.begin())].try_emplace(static_cast<std::size_t>(t_s / kStep_s),
                                                                           error);
  });
  return errors;
}

/// Means of the errors over the lag before and after each: what waiting could at most make of our poses.
std::vector<Vector6d> averaged(const Errors& errors) {
  std::vector<Vector6d> means;
  for (const auto& [step, error] : errors) {
    Vector6d sum = Vector6d::Zero();
    double count = 0;
    for (auto near = errors.lower_bound(step - kLagSteps); near != errors.end() && near->first <= step + kLagSteps;
         ++near) {
      sum += near->second;
      ++count;
    }
    means.push_back(sum / count);
  }
  return means;
}

std::vector<Vector6d> at_steps_of(const Errors& ours, const std::vector<Vector6d>& all) {
  std::vector<Vector6d> chosen;
  for (const auto& [step, error] : ours)
    if (step < all.size()) chosen.push_back(all[step]);
  return chosen;
}

std::vector<Matrix6d> information_of_steps(const std::vector<bench::Passage>& passages, const bench::Profile& profile,
                                           double duration_s) {
  std::vector<Matrix6d> information(static_cast<std::size_t>(duration_s / kStep_s), Matrix6d::Zero());
  for (const bench::Passage& passage : passages)
    if (const auto step = static_cast<std::size_t>(passage.t_s / kStep_s); step < information.size())
      information[step] += profile.information_px2 * passage.row * passage.row.transpose();
  return information;
}

/// The density with which the filter comes nearest: it knows best how smooth the motion is.
bench::JerkDensity best_density(const bench::PoseBound& bound, const Errors& ours) {
  constexpr double kLargest = 4, kFinest = 1.2;
  const auto cost = [&](const bench::JerkDensity& density) {
    const Rms rms = Rms::of(at_steps_of(ours, bound.filter(density)));
    return std::log(rms.mm) + std::log(rms.deg);
  };
  bench::JerkDensity best{1e3, 1e4};
  double least = cost(best);
  for (double factor = kLargest; factor > kFinest;) {
    const bench::JerkDensity before = best;
    for (const auto& [t, r] : {std::pair(factor, 1.0), {1 / factor, 1.0}, {1.0, factor}, {1.0, 1 / factor}}) {
      const bench::JerkDensity tried{t * before.translation, r * before.rotation};
      if (const double found = cost(tried); found < least) {
        least = found;
        best = tried;
      }
    }
    if (best.translation == before.translation && best.rotation == before.rotation) factor = std::sqrt(factor);
  }
  return best;
}

struct Limit {
  double passages_per_s = 0, sigma_px = 0;
  Rms filter, lagged, smoother, ours, ours_averaged;
};

Limit limit_of(const Situation& situation, std::size_t marker, const std::vector<Event>& events, const Errors& ours,
               std::uint64_t seed) {
  const auto& scene_marker = situation.scene.markers[marker];
  const opencv::ArucoDetector<PinholeCamera> detector(
      situation.camera, {.dictionary = situation.dictionary, .marker_length = situation.marker_length()});
  bench::PassageFinder finder(situation, marker, detector.model(scene_marker.id));
  for (const Event& event : events) finder.add(event);
  std::vector<bench::Passage> passages = std::move(finder).passages();
  if (passages.empty() || ours.empty()) throw std::runtime_error("a marker makes no events, or has no poses");
  const bench::Profile profile = bench::subtract_profiles(passages);
  const double duration_s = situation.simulator.duration_s;
  const bench::PoseBound bound(information_of_steps(passages, profile, duration_s), scene_marker.T_camera_marker,
                               kStep_s, seed);
  const bench::BoundErrors errors = bound.errors(best_density(bound, ours), kLagSteps);
  std::vector<Vector6d> of_ours;
  for (const auto& [step, error] : ours) of_ours.push_back(error);
  return {static_cast<double>(passages.size()) / duration_s,
          1 / std::sqrt(profile.information_px2),
          Rms::of(at_steps_of(ours, errors.filter)),
          Rms::of(at_steps_of(ours, errors.lagged)),
          Rms::of(at_steps_of(ours, errors.smoother)),
          Rms::of(of_ours),
          Rms::of(averaged(ours))};
}

/// Means over the markers and seeds of a scenario.
Limit mean_limit(const bench::Scenario& scenario, const std::vector<std::uint64_t>& seeds) {
  std::vector<Limit> limits;
  for (const std::uint64_t seed : seeds) {
    const Situation situation = scenario.make(seed);
    const std::vector<Event> events = bench::simulate(situation);
    const std::vector<Errors> ours = our_errors(situation, events);
    for (std::size_t marker = 0; marker < ours.size(); ++marker)
      limits.push_back(limit_of(situation, marker, events, ours[marker], seed));
  }
  Limit mean;
  const auto n = static_cast<double>(limits.size());
  for (const Limit& limit : limits) {
    mean.passages_per_s += limit.passages_per_s / n;
    mean.sigma_px += limit.sigma_px / n;
    for (Rms Limit::*const column :
         {&Limit::filter, &Limit::lagged, &Limit::smoother, &Limit::ours, &Limit::ours_averaged}) {
      (mean.*column).mm += (limit.*column).mm / n;
      (mean.*column).deg += (limit.*column).deg / n;
    }
  }
  return mean;
}

std::vector<std::string> all_names() {
  std::vector<std::string> names;
  for (const bench::Scenario& scenario : bench::scenarios()) names.push_back(scenario.name);
  return names;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Bounds the error of a pose by what the events of a scenario say about it; see limit.md");
  std::vector<std::string> names = all_names();
  std::vector<std::uint64_t> seeds{7001, 7002, 7003};
  app.add_option("--scenarios", names, "some of those of evmarker_accuracy")
      ->delimiter(',')
      ->expected(1, -1)
      ->check(CLI::IsMember(all_names()))
      ->capture_default_str();
  app.add_option("--seeds", seeds, "one recording each")->delimiter(',')->expected(1, -1)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  try {
    cv::setNumThreads(1);
    std::printf(
        "| scenario | passages/s | sigma [px] | causal [mm / deg] | 5 ms later | afterwards | ours | ours / causal | "
        "ours, mean of +-5 ms |\n|---|---|---|---|---|---|---|---|---|\n");
    const auto all = bench::scenarios();
    for (const std::string& name : names) {
      const Limit l = mean_limit(*std::ranges::find(all, name, &bench::Scenario::name), seeds);
      std::printf(
          "| %s | %.0f | %.3f | %.3f / %.3f | %.3f / %.3f | %.3f / %.3f | %.3f / %.3f | %.2f / %.2f | %.3f / %.3f |\n",
          name.c_str(), l.passages_per_s, l.sigma_px, l.filter.mm, l.filter.deg, l.lagged.mm, l.lagged.deg,
          l.smoother.mm, l.smoother.deg, l.ours.mm, l.ours.deg, l.ours.mm / l.filter.mm, l.ours.deg / l.filter.deg,
          l.ours_averaged.mm, l.ours_averaged.deg);
      std::fflush(stdout);
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "limit: %s\n", error.what());
    return 1;
  }
  return 0;
}
