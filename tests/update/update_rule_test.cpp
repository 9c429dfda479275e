#include "evmarker/update/update_rule.hpp"

#include <doctest/doctest.h>

#include <memory>
#include <optional>
#include <type_traits>

using evmarker::Correspondence;
using evmarker::Matrix6d;
using evmarker::PoseUpdateRule;
using evmarker::Timestamp;
using evmarker::Vector6d;

namespace {

struct NoSettings {};

// A rule that moves along x by the mean signed distance, in pixels of a millimetre.
struct SlideRule {
  using Settings = NoSettings;
  SlideRule(const Settings&, int events_per_update) : events(events_per_update) {}
  void set_events_per_update(int events_per_update) noexcept { events = events_per_update; }
  void add(const Correspondence& c, const Eigen::Isometry3d&) noexcept { sum += c.distance_px; }
  bool update(Eigen::Isometry3d& T_camera_marker, Timestamp) noexcept {
    T_camera_marker.translation().x() += 1e-3 * sum / events;
    sum = 0;
    return true;
  }
  void reverse() noexcept { sum = 0; }
  int events;
  double sum = 0;
};

struct ThrowingAdd : SlideRule {
  using SlideRule::SlideRule;
  void add(const Correspondence&, const Eigen::Isometry3d&) {}
};
struct ThrowingUpdate : SlideRule {
  using SlideRule::SlideRule;
  bool update(Eigen::Isometry3d&, Timestamp) { return true; }
};
struct ThrowingReverse : SlideRule {
  using SlideRule::SlideRule;
  void reverse() {}
};
struct SilentUpdate : SlideRule {
  using SlideRule::SlideRule;
  void update(Eigen::Isometry3d&, Timestamp) noexcept {}
};
struct IntUpdate : SlideRule {
  using SlideRule::SlideRule;
  int update(Eigen::Isometry3d&, Timestamp) noexcept { return 1; }
};
struct WithoutTime : SlideRule {
  using SlideRule::SlideRule;
  bool update(Eigen::Isometry3d&) noexcept { return true; }
};
struct WithoutEventsPerUpdate : SlideRule {
  explicit WithoutEventsPerUpdate(const Settings& settings) : SlideRule(settings, 1) {}
};
struct ThrowingSetEventsPerUpdate : SlideRule {
  using SlideRule::SlideRule;
  void set_events_per_update(int) {}
};
struct NotCopyable : SlideRule {
  using SlideRule::SlideRule;
  std::unique_ptr<int> owned;
};
struct WithoutSettings {
  WithoutSettings(const NoSettings&, int) {}
  void set_events_per_update(int) noexcept {}
  void add(const Correspondence&, const Eigen::Isometry3d&) noexcept {}
  bool update(Eigen::Isometry3d&, Timestamp) noexcept { return true; }
  void reverse() noexcept {}
};
struct WithFixedEventsPerUpdate {
  using Settings = NoSettings;
  WithFixedEventsPerUpdate(const Settings&, int) {}
  void add(const Correspondence&, const Eigen::Isometry3d&) noexcept {}
  bool update(Eigen::Isometry3d&, Timestamp) noexcept { return true; }
  void reverse() noexcept {}
};

// Goes on along x at a metre a second.
struct GlideRule : SlideRule {
  using SlideRule::SlideRule;
  void extrapolate(Eigen::Isometry3d& T_camera_marker, Timestamp t) noexcept {
    T_camera_marker.translation().x() += 1e-6 * static_cast<double>(t - last_t);
    last_t = t;
  }
  Matrix6d covariance() const noexcept { return static_cast<double>(1 + last_t) * Matrix6d::Identity(); }
  Vector6d twist() const noexcept { return Vector6d::Unit(0); }
  Timestamp last_t = 0;
};
struct ThrowingExtrapolate : GlideRule {
  using GlideRule::GlideRule;
  void extrapolate(Eigen::Isometry3d&, Timestamp) {}
};
struct OptionalTwist : GlideRule {
  using GlideRule::GlideRule;
  std::optional<Vector6d> twist() const noexcept { return std::nullopt; }
};
struct MutableCovariance : GlideRule {
  using GlideRule::GlideRule;
  Matrix6d covariance() noexcept { return Matrix6d::Zero(); }
};

}  // namespace

static_assert(PoseUpdateRule<SlideRule>);
static_assert(!PoseUpdateRule<int>);
static_assert(!PoseUpdateRule<ThrowingAdd>);
static_assert(!PoseUpdateRule<ThrowingUpdate>);
static_assert(!PoseUpdateRule<ThrowingReverse>);
static_assert(!PoseUpdateRule<SilentUpdate>);
static_assert(!PoseUpdateRule<IntUpdate>);
static_assert(!PoseUpdateRule<WithoutTime>);
static_assert(!PoseUpdateRule<WithoutEventsPerUpdate>);
static_assert(!PoseUpdateRule<ThrowingSetEventsPerUpdate>);
static_assert(!PoseUpdateRule<WithFixedEventsPerUpdate>);
static_assert(!PoseUpdateRule<NotCopyable>);
static_assert(!PoseUpdateRule<WithoutSettings>);

using evmarker::MotionEstimatingRule;
static_assert(MotionEstimatingRule<GlideRule>);
static_assert(!MotionEstimatingRule<SlideRule>);
static_assert(!MotionEstimatingRule<ThrowingExtrapolate>);
static_assert(!MotionEstimatingRule<OptionalTwist>);
static_assert(!MotionEstimatingRule<MutableCovariance>);

namespace {

// What the library does with any rule.
template <PoseUpdateRule Rule>
Eigen::Isometry3d after_two_events(const typename Rule::Settings& settings) {
  Rule rule(settings, 2);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  Correspondence correspondence;
  correspondence.distance_px = 1;
  rule.add(correspondence, pose);
  correspondence.distance_px = 2;
  rule.add(correspondence, pose);
  REQUIRE(rule.update(pose, 10));
  return pose;
}

}  // namespace

TEST_CASE("a rule of one's own moves the pose through the concept alone") {
  CHECK(after_two_events<SlideRule>({}).translation().x() == doctest::Approx(1.5e-3));
}

TEST_CASE("a pose goes on as its rule knows, or stays where it is") {
  evmarker::PoseEstimate pose;
  pose.id = 4;
  pose.quality.matched = 17;
  const auto gone_on = evmarker::extrapolated(pose, GlideRule({}, 1), 3000),
             stays = extrapolated(pose, SlideRule({}, 1), 3000);
  CHECK(gone_on.T_camera_marker.translation().x() == doctest::Approx(3e-3));
  CHECK((*gone_on.covariance)(0, 0) == 3001);
  CHECK(*gone_on.twist == Vector6d::Unit(0));
  CHECK(stays.T_camera_marker.matrix() == pose.T_camera_marker.matrix());
  CHECK_FALSE(stays.covariance);
  CHECK_FALSE(stays.twist);
  for (const auto& later : {gone_on, stays}) {
    CHECK(later.t == 3000);
    CHECK(later.id == 4);
    CHECK(later.quality.matched == 17);
  }
}
