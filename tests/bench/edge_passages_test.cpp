#include "../../bench/edge_passages.hpp"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <vector>

#include "../../bench/tracker_methods.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/simulation/random.hpp"

using namespace evmarker;
using bench::Passage;

namespace {

bench::Situation near_for(double seconds) {
  const auto scenarios = bench::scenarios();
  bench::Situation situation = std::ranges::find(scenarios, "near", &bench::Scenario::name)->make(1);
  situation.simulator.duration_s = seconds;
  return situation;
}

std::vector<Passage> passages_of(const bench::Situation& situation, const std::vector<Event>& events) {
  const opencv::ArucoDetector<PinholeCamera> detector(
      situation.camera, {.dictionary = situation.dictionary, .marker_length = situation.marker_length()});
  bench::PassageFinder finder(situation, 0, detector.model(situation.scene.markers[0].id));
  for (const Event& event : events) finder.add(event);
  return std::move(finder).passages();
}

double mean_distance_px(const std::vector<Passage>& passages) {
  double sum = 0;
  for (const Passage& passage : passages) sum += passage.distance_px;
  return sum / static_cast<double>(passages.size());
}

}  // namespace

TEST_CASE("passages hold the events beside true edges, several each") {
  bench::Situation situation = near_for(0.1);
  situation.simulator.noise_hz_per_px = 0;
  const std::vector<Event> events = bench::simulate(situation);
  const std::vector<Passage> passages = passages_of(situation, events);
  REQUIRE(passages.size() > 1000);
  std::size_t held = 0;
  for (const Passage& passage : passages) {
    held += static_cast<std::size_t>(passage.events);
    CHECK(std::abs(passage.distance_px) <= 3);
    CHECK(passage.t_s <= 0.1);
  }
  MESSAGE(events.size() << " events, " << held << " in " << passages.size() << " passages");
  CHECK(held > 0.75 * static_cast<double>(events.size()));
  CHECK(held > 2 * passages.size());
}

TEST_CASE("a row is what a change of the pose changes the distance by") {
  const bench::Situation situation = near_for(0.05);
  const std::vector<Event> events = bench::simulate(situation);
  const std::vector<Passage> passages = passages_of(situation, events);
  REQUIRE(passages.size() > 500);
  Vector6d change;
  change << 2e-5, -1e-5, 5e-5, 1e-4, -5e-5, 2e-4;  // [m, rad], a hundredth of a pixel
  bench::Situation changed = situation;
  auto& motion = changed.scene.markers[0].T_camera_marker;
  motion = [change, before = motion](double t_s) {
    Eigen::Isometry3d T = before(t_s);
    T.translation() += change.head<3>();
    T.linear() = so3_exp(change.tail<3>()) * T.linear();
    return T;
  };
  const std::vector<Passage> of_changed = passages_of(changed, events);
  // The same passages, where all events find the same edge again: those of equal mean time.
  std::map<double, const Passage*> by_time;
  for (const Passage& passage : of_changed) by_time[passage.t_s] = &passage;
  int compared = 0, right = 0;
  for (const Passage& passage : passages) {
    const auto same = by_time.find(passage.t_s);
    if (same == by_time.end() || same->second->profile != passage.profile || same->second->events != passage.events)
      continue;
    const double expected_px = -passage.row.dot(change);
    ++compared;
    right += std::abs(same->second->distance_px - passage.distance_px - expected_px) <
             0.02 * std::abs(expected_px) + 1e-4;
  }
  REQUIRE(compared > 0.9 * static_cast<double>(passages.size()));
  CHECK(right > 0.99 * compared);
}

TEST_CASE("residuals: a profile's offset and delay are subtracted, and what is left says as much as its noise") {
  constexpr double kSigma_px = 0.08;
  Random random(7);
  std::vector<Passage> passages;
  for (int i = 0; i < 6000; ++i) {
    Passage passage{.profile = i % 3, .speed_px_s = 1000 * random.gaussian(), .events = 4};
    passage.distance_px = 0.2 * passage.profile - 0.1 + 3e-4 * passage.speed_px_s + kSigma_px * random.gaussian();
    passages.push_back(passage);
  }
  auto with_outliers = passages;
  const bench::Profile profile = bench::subtract_profiles(passages);
  CHECK(1 / std::sqrt(profile.information_px2) == doctest::Approx(kSigma_px).epsilon(0.03).scale(0));
  CHECK(std::abs(mean_distance_px(passages)) < 0.003);
  double square = 0;
  for (const Passage& passage : passages) square += passage.distance_px * passage.distance_px / 6000;
  CHECK(std::sqrt(square) == doctest::Approx(kSigma_px).epsilon(0.03).scale(0));

  // A tenth is noise: what it hides is that tenth and a little, not what squares would make of it (0.9 px).
  for (std::size_t i = 0; i < with_outliers.size(); i += 10) with_outliers[i].distance_px = 6 * random.uniform() - 3;
  const double sigma_px = 1 / std::sqrt(bench::subtract_profiles(with_outliers).information_px2);
  MESSAGE("with noise " << sigma_px << " px");
  CHECK(sigma_px > 1.05 * kSigma_px);
  CHECK(sigma_px < 1.25 * kSigma_px);
}
