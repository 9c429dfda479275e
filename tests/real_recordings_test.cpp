// What must hold on real recordings, with the settings that the library comes with.
#include "../bench/real_recordings.hpp"

#include <doctest/doctest.h>

#include <filesystem>
#include <type_traits>

#include "evmarker/accuracy.hpp"
#include "evmarker/decoupled_update.hpp"
#include "evmarker/kalman_update.hpp"

using namespace evmarker;

namespace {

const std::filesystem::path kData = EVMARKER_SHARED_DATA;

bool has(const char* folder) {
  const std::filesystem::path path = kData / folder / "events.csv";
  if (!std::filesystem::exists(path)) MESSAGE("skipped: no " << path.string());
  return std::filesystem::exists(path);
}

void check(const bench::BodyVerdict& verdict, double right_share, double median) {
  const double found = Spread::of(verdict.distances).median;
  MESSAGE("right " << 100 * verdict.right_share() << " %, wrong " << 100 * verdict.wrong_share() << " %, median "
                   << found << ", lost " << verdict.lost() << " times");
  CHECK(verdict.right_share() > right_share);
  CHECK(verdict.wrong_share() < 0.01);
  CHECK(found < median);
  CHECK(verdict.lost() == 0);
}

}  // namespace

TEST_CASE_TEMPLATE("the real pyramid is followed from its first usable reference on", Rule, KalmanUpdate,
                   DecoupledUpdate) {
  if (!has("pyramid")) return;
  const bench::BodyVerdict verdict = bench::judge_pyramid<Rule>(kData);
  CHECK(verdict.moments == 541);
  check(verdict, 0.82, 1.4);  // [mm]
}

TEST_CASE_TEMPLATE("the real flip is followed with the settings that the library comes with", Rule, KalmanUpdate,
                   DecoupledUpdate) {
  if (!has("flip")) return;
  const bench::BodyVerdict verdict = bench::judge_flip<Rule>(kData);
  CHECK(verdict.moments == 128);
  check(verdict, 0.85, std::is_same_v<Rule, KalmanUpdate> ? 0.6 : 1.2);  // [px]
}
