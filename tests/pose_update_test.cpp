#include "evmarker/pose_update.hpp"

#include <doctest/doctest.h>

#include <memory>
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
  void add(const Correspondence& c, const Eigen::Isometry3d&) noexcept { sum += c.distance_px; }
  bool update(Eigen::Isometry3d& T_camera_marker, Timestamp) noexcept {
    T_camera_marker.translation().x() += 1e-3 * sum / events;
    sum = 0;
    return true;
  }
  void extrapolate(Eigen::Isometry3d&, Timestamp) noexcept {}
  void reverse() noexcept { sum = 0; }
  Matrix6d information() const noexcept { return Matrix6d::Zero(); }
  std::optional<Vector6d> twist() const noexcept { return std::nullopt; }
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
struct ThrowingExtrapolate : SlideRule {
  using SlideRule::SlideRule;
  void extrapolate(Eigen::Isometry3d&, Timestamp) {}
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
struct PlainTwist : SlideRule {
  using SlideRule::SlideRule;
  Vector6d twist() const noexcept { return Vector6d::Zero(); }
};
struct MutableInformation : SlideRule {
  using SlideRule::SlideRule;
  Matrix6d information() noexcept { return Matrix6d::Zero(); }
};
struct WithoutEventsPerUpdate : SlideRule {
  explicit WithoutEventsPerUpdate(const Settings& settings) : SlideRule(settings, 1) {}
};
struct NotCopyable : SlideRule {
  using SlideRule::SlideRule;
  std::unique_ptr<int> owned;
};
struct WithoutSettings {
  WithoutSettings(const NoSettings&, int) {}
  void add(const Correspondence&, const Eigen::Isometry3d&) noexcept {}
  bool update(Eigen::Isometry3d&, Timestamp) noexcept { return true; }
  void extrapolate(Eigen::Isometry3d&, Timestamp) noexcept {}
  void reverse() noexcept {}
  Matrix6d information() const noexcept { return Matrix6d::Zero(); }
  std::optional<Vector6d> twist() const noexcept { return std::nullopt; }
};

}  // namespace

static_assert(PoseUpdateRule<SlideRule>);
static_assert(!PoseUpdateRule<int>);
static_assert(!PoseUpdateRule<ThrowingAdd>);
static_assert(!PoseUpdateRule<ThrowingUpdate>);
static_assert(!PoseUpdateRule<ThrowingReverse>);
static_assert(!PoseUpdateRule<ThrowingExtrapolate>);
static_assert(!PoseUpdateRule<SilentUpdate>);
static_assert(!PoseUpdateRule<IntUpdate>);
static_assert(!PoseUpdateRule<WithoutTime>);
static_assert(!PoseUpdateRule<PlainTwist>);
static_assert(!PoseUpdateRule<MutableInformation>);
static_assert(!PoseUpdateRule<WithoutEventsPerUpdate>);
static_assert(!PoseUpdateRule<NotCopyable>);
static_assert(!PoseUpdateRule<WithoutSettings>);

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
