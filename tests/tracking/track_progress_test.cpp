#include "evmarker/tracking/track_progress.hpp"

#include <doctest/doctest.h>

using namespace evmarker;

TEST_CASE("track progress: a verification confirms a start once it has settled and has had enough events") {
  TrackProgress progress(100);
  progress.add_update(60, 0);
  CHECK_FALSE(progress.add_verification(true));  // of the start as it was
  progress.settle();
  CHECK_FALSE(progress.confirm());
  CHECK_FALSE(progress.add_verification(true));
  CHECK_FALSE(progress.confirm());
  progress.add_update(40, 10);
  CHECK(progress.matched() == 100);
  CHECK(progress.confirm());
  CHECK(progress.tracking());
  CHECK_FALSE(progress.confirm());  // it has been
}

TEST_CASE("track progress: two failures in a row lose a marker that is tracking") {
  TrackProgress progress(0);
  progress.settle();
  for (int i = 0; i < 3; ++i) CHECK_FALSE(progress.add_verification(false));  // the start was off
  progress.add_verification(true);
  REQUIRE(progress.confirm());
  CHECK(progress.add_verification(false));
  CHECK_FALSE(progress.add_verification(true));
  CHECK(progress.add_verification(false));
  CHECK(progress.certain_loss() == LossReason::none);
  CHECK(progress.add_verification(false));
  CHECK(progress.certain_loss() == LossReason::verification);
  progress.lose();
  CHECK(progress.state() == TrackingState::lost);
}

TEST_CASE("track progress: what is not confirmed within two seconds of its first update must be lost") {
  constexpr Timestamp kFirst = 5'000'000;
  TrackProgress waiting(0);
  waiting.add_update(1, kFirst);
  TrackProgress confirmed = waiting;
  confirmed.settle();
  confirmed.add_verification(true);
  REQUIRE(confirmed.confirm());
  for (TrackProgress* const progress : {&waiting, &confirmed}) {
    progress->add_update(1, kFirst + 2'000'000);
    CHECK(progress->certain_loss() == LossReason::none);
    progress->add_update(1, kFirst + 2'000'001);
  }
  CHECK(waiting.certain_loss() == LossReason::not_confirmed);
  CHECK(confirmed.certain_loss() == LossReason::none);
}
