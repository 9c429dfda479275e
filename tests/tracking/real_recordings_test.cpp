// What must hold on real recordings, with the settings that the library comes with.
#include "../../bench/real_recordings.hpp"

#include <doctest/doctest.h>

#include <filesystem>
#include <type_traits>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "real_data.hpp"

using namespace evmarker;
using namespace evmarker::test;

namespace {

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
  if (missing(kData / "pyramid")) return;
  const bench::BodyVerdict verdict = bench::judge_pyramid<Rule>(kData);
  CHECK(verdict.moments == 541);
  check(verdict, 0.97, 1.4);  // [mm]
}

TEST_CASE_TEMPLATE("the real flip is followed with the settings that the library comes with", Rule, KalmanUpdate,
                   DecoupledUpdate) {
  if (missing(kData / "flip")) return;
  const bench::BodyVerdict verdict = bench::judge_flip<Rule>(kData);
  CHECK(verdict.moments == 128);
  check(verdict, 0.97, std::is_same_v<Rule, KalmanUpdate> ? 0.6 : 1.2);  // [px]
}

TEST_CASE_TEMPLATE("real AprilTags are all found and followed, each alone", Rule, KalmanUpdate, DecoupledUpdate) {
  if (missing(kData / "tags")) return;
  constexpr bool kKalman = std::is_same_v<Rule, KalmanUpdate>;
  const bench::TagsVerdict verdict = bench::judge_tags<Rule>(kData, false);
  MESSAGE("first " << Spread::of(verdict.first_ms).mean << " ms, corners " << verdict.corner_px << " px");
  CHECK(verdict.tracked.size() == 12);
  CHECK(verdict.lost() == 0);
  CHECK(Spread::of(verdict.first_ms).mean < (kKalman ? 180 : 150));
  CHECK(verdict.corner_px < (kKalman ? 0.29 : 0.65));
  REQUIRE(verdict.exact.all.empty() != kKalman);
  if (!kKalman) return;
  const double nees = Spread::of(verdict.exact.all).mean;
  MESSAGE("NEES " << nees);
  CHECK(nees > 0.4);
  CHECK(nees < 2.5);
}
