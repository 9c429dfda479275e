#include <doctest/doctest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "sanitized.hpp"
#include "simulated.hpp"

using namespace evmarker;

namespace {

constexpr double kMove_s = 0.4;
const PinholeCamera kRestCamera{{346, 260}, 300, 300, 172.5, 129.5};

struct Rest {
  double seconds, noise_hz_per_px;
};

Trajectory moves_and_rests(double rest_s, std::uint64_t seed) {
  const Trajectory sway = trajectory::handheld(
      {.T_centre = facing_pose({0, 0, 0.5}), .amplitude_m = {0.06, 0.04, 0.06}, .frequency_hz = 1.3, .seed = seed});
  return trajectory::stop_and_go(sway, {{kMove_s, rest_s}, {kMove_s, 0}});
}

// What one tracker tells at the end of a rest, asked for it then, and of the motion after it.
template <typename Rule>
struct Rested {
  int events_per_update;
  MarkerTracker<Rule> tracker;
  PoseEstimate at_end{};
  AccuracyMeter before{}, after{};
  Timestamp first_after = 0;
};

template <typename Rule>
std::vector<Rested<Rule>> rest(const Rest& rest, const std::vector<int>& events_per_update, std::uint64_t seed = 11) {
  const Trajectory motion = moves_and_rests(rest.seconds, seed);
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  std::vector<Rested<Rule>> all;
  for (const int n : events_per_update)
    all.push_back({n, {kRestCamera, model, motion(0), {.events_per_update = n, .start_search = std::nullopt}}});
  const Timestamp end = static_cast<Timestamp>(1e6 * (kMove_s + rest.seconds));
  const auto events = simulated::record(
      kRestCamera, {{.length = simulated::kMarkerLength, .bits = simulated::code(), .T_camera_marker = motion}},
      {.duration_s = 2 * kMove_s + rest.seconds, .seed = seed, .noise_hz_per_px = rest.noise_hz_per_px});
  bool over = false;
  for (const Event& event : events) {
    if (!over && event.t >= end) {
      over = true;
      for (Rested<Rule>& one : all) one.at_end = one.tracker.pose_at(end, end);
    }
    for (Rested<Rule>& one : all) {
      const PoseEstimate* const pose = one.tracker.push(event);
      if (!pose) continue;
      (over ? one.after : one.before).add(*pose, motion(1e-6 * static_cast<double>(pose->t)));
      if (over && one.first_after == 0) one.first_after = pose->t - end;
    }
  }
  return all;
}

// Short and long, in silence and in as much noise as there is.
const std::vector<Rest> kRests{{0.05, 0}, {0.05, 10}, {0.5, 1}, {2, 10}, {5, 0}, {60, 0.1}};

}  // namespace

TEST_CASE("a marker that rests keeps pose, covariance and health, and is followed from its first events on") {
  int cases = 0, lost_at_start = 0, not_followed = 0, off = 0, far_off = 0, too_unsure = 0, wrong_after = 0;
  double nees_sum = 0;
  for (std::uint64_t seed = 11; seed <= (kSanitized ? 11 : 14); ++seed)
    for (const Rest& length : kRests) {
      const Eigen::Isometry3d truth = moves_and_rests(length.seconds, seed)(kMove_s);
      for (const auto& one : rest<KalmanUpdate>(length, {kAutomatic, 1, 10, 100}, seed)) {
        ++cases;
        // 10 Hz/px of noise, which here no filter takes out, are many events for a pose that has yet to settle.
        if (one.before.tracking() <= 100) {
          CHECK(length.noise_hz_per_px == 10);
          ++lost_at_start;
          continue;
        }
        const PoseError error = pose_error(one.at_end.T_camera_marker, truth);
        const double sigma_mm = 1e3 * std::sqrt(one.at_end.covariance->topLeftCorner<3, 3>().trace());
        MESSAGE("seed " << seed << ", " << length.seconds << " s, " << length.noise_hz_per_px << " Hz/px, n "
                        << one.events_per_update << ": " << error.translation_mm << " mm, " << error.rotation_deg
                        << " deg, stated " << sigma_mm << " mm, NEES " << nees(one.at_end, truth) << "; then after "
                        << 1e-3 * static_cast<double>(one.first_after) << " ms at most "
                        << one.after.translation_mm().max << " mm, " << one.after.rotation_deg().max << " deg");
        nees_sum += nees(one.at_end, truth);
        const bool followed = one.at_end.quality.state == TrackingState::tracking && one.at_end.quality.health > 0.99;
        not_followed += !followed;
        off += !(error.translation_mm < 2 && error.rotation_deg < 1.5);
        far_off += !(error.translation_mm < 4 && error.rotation_deg < 3);
        too_unsure += !(sigma_mm < 5);
        wrong_after += !(one.after.tracking() > 100 && one.first_after < 40000 && one.after.translation_mm().max < 4 &&
                         one.after.rotation_deg().max < 5 && one.tracker.state() == TrackingState::tracking);
      }
    }
  REQUIRE(lost_at_start < cases / 4);
  if (kSanitized) return;  // these are shares of four motions together; of one, they vary
  // The bounds are the shares of 288 cases, seeds 101 to 112, and three deviations of 96 cases more: what becomes of a
  // single case depends on the last bits, by which compilers differ. There, 45 were off, 5 far off, one too unsure, 7
  // wrong afterwards, and 21 lost at the start.
  MESSAGE("of " << cases << ": lost at the start " << lost_at_start << ", not followed " << not_followed << ", off "
                << off << ", far off " << far_off << ", too unsure " << too_unsure << ", wrong after " << wrong_after);
  CHECK(lost_at_start <= cases / 24);
  CHECK(not_followed <= cases / 16);
  CHECK(off <= cases / 4);
  CHECK(far_off <= cases / 16);
  CHECK(too_unsure <= cases / 24);
  CHECK(wrong_after <= cases / 12);
  const double mean_nees = nees_sum / (cases - lost_at_start);
  CHECK(mean_nees > 0.6);
  CHECK(mean_nees < 1.6);
}

TEST_CASE("so does the paper's rule, as well as it follows") {
  for (const Rest& length : kRests)
    for (const auto& one : rest<DecoupledUpdate>(length, {kAutomatic, 100})) {  // with fewer, noise jerks it first
      CAPTURE(length.seconds);
      CAPTURE(length.noise_hz_per_px);
      CAPTURE(one.events_per_update);
      const PoseError error = pose_error(one.at_end.T_camera_marker, moves_and_rests(length.seconds, 11)(kMove_s));
      MESSAGE(length.seconds << " s, " << length.noise_hz_per_px << " Hz/px, n " << one.events_per_update << ": "
                             << error.translation_mm << " mm, " << error.rotation_deg << " deg; before at most "
                             << one.before.translation_mm().max << "; then at most " << one.after.translation_mm().max
                             << " mm, " << one.after.rotation_deg().max << " deg");
      CHECK(one.at_end.quality.state == TrackingState::tracking);
      REQUIRE(one.before.tracking() > 100);
      CHECK(error.translation_mm < one.before.translation_mm().max);
      CHECK(error.rotation_deg < one.before.rotation_deg().max);
      REQUIRE(one.after.tracking() > 100);
      CHECK(one.tracker.state() == TrackingState::tracking);
    }
}

TEST_CASE("noise on the edges of a marker that rests does not carry it away") {
  constexpr std::uint64_t kSeed = 17;  // where the first estimate of the matching share was off by a sixth
  constexpr Rest kNoisy{2, 10};
  const Eigen::Isometry3d truth = moves_and_rests(kNoisy.seconds, kSeed)(kMove_s);
  for (const auto& one : rest<KalmanUpdate>(kNoisy, {kAutomatic, 100}, kSeed)) {
    CAPTURE(one.events_per_update);
    REQUIRE(one.before.tracking() > 100);
    const PoseError error = pose_error(one.at_end.T_camera_marker, truth);
    MESSAGE(error.translation_mm << " mm, " << error.rotation_deg << " deg");
    CHECK(error.translation_mm < 3);  // 16 mm with that estimate
    CHECK(error.rotation_deg < 1.5);
  }
}
