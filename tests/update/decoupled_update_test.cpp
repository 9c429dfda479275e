#include "evmarker/update/decoupled_update.hpp"

#include <doctest/doctest.h>

#include <Eigen/QR>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using evmarker::Correspondence;
using evmarker::DecoupledSettings;
using evmarker::DecoupledUpdate;

namespace {

Correspondence correspondence(const Vector3d& M, const Vector3d& F, const Vector3d& E) {
  Correspondence c;
  c.M = M;
  c.F = F;
  c.E = E;
  return c;
}

// Two events worked by hand below.
const Correspondence kFirst = correspondence({0, 0, 1}, {0, 0, 1}, {0.1, 0.02, 1});
const Correspondence kSecond = correspondence({1, 0, 1}, {0.1, 0, 0.1}, {0.2, 0.1, 0});

Matrix3d rotation(const Vector3d& r) {
  return r.norm() > 0 ? Eigen::AngleAxisd(r.norm(), r.normalized()).toRotationMatrix() : Matrix3d::Identity();
}

Isometry3d pose(const Vector3d& r, const Vector3d& translation) {
  Isometry3d T = Isometry3d::Identity();
  T.linear() = rotation(r);
  T.translation() = translation;
  return T;
}

double angle_between(const Isometry3d& a, const Isometry3d& b) {
  return Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle();
}

// Events of a square and of a smaller one inside it at a true pose, each matched to its own edge at another pose.
class SquareScene {
 public:
  SquareScene(const Isometry3d& truth, double scale) : truth_(truth) {
    for (const double h : {0.05 * scale, 0.02 * scale})
      for (int i = 0; i < 4; ++i) corners_.emplace_back((i == 1 || i == 2) ? h : -h, i < 2 ? h : -h, 0);
  }

  Correspondence next(const Isometry3d& estimate) {
    const std::size_t edge = random_() % 8;
    const Vector3d &from = corners_[edge], &to = corners_[edge / 4 * 4 + (edge + 1) % 4];
    const double place = std::uniform_real_distribution<double>(0, 1)(random_);
    const Vector3d seen = truth_ * (from + place * (to - from));
    const Vector3d M = seen / seen.z();
    // Least squares for a1 M = V + a2 S.
    const Vector3d V = estimate * from, S = estimate * to - V;
    Eigen::Matrix<double, 3, 2> system;
    system << M, -S;
    const Eigen::Vector2d a = system.colPivHouseholderQr().solve(V);
    const Vector3d E = V + std::min(1.0, std::max(0.0, a(1))) * S;
    return correspondence(M, M.dot(E) / M.squaredNorm() * M, E);
  }

 private:
  Isometry3d truth_;
  std::vector<Vector3d> corners_;
  std::mt19937 random_{9};
};

Isometry3d followed(const DecoupledSettings& settings, int events_per_update, const Isometry3d& truth, Isometry3d start,
                    int events, double scale = 1) {
  DecoupledUpdate rule(settings, events_per_update);
  SquareScene scene(truth, scale);
  for (int i = 1; i <= events; ++i) {
    rule.add(scene.next(start), start);
    if (i % events_per_update == 0) REQUIRE(rule.update(start, i));
  }
  return start;
}

}  // namespace

TEST_CASE("one event, worked by hand") {
  // w0 = 1/2, n = 1: the events of one update renew half of the averages, so half of the gain counts.
  DecoupledUpdate rule({.averaging_weight = 0.5, .translation_gain = 1.4, .rotation_gain = 2}, 1);
  Isometry3d T = Isometry3d::Identity();
  rule.add(kFirst, T);
  // A = (1 + diag(1,1,0)) / 2 = diag(1, 1, 1/2); B = (F - E) / 2 = (-0.05, -0.01, 0)
  // Gamma = E x (F - E) / 2 = (0.01, -0.05, 0); mean |E - T|^2 = 1.0104 / 2
  REQUIRE(rule.update(T, 0));
  CHECK((T.translation() - Vector3d(0.5 * 1.4 * -0.05, 0.5 * 1.4 * -0.01, 0)).norm() < 1e-15);
  CHECK((T.linear() - rotation(0.5 * 2 * Vector3d(0.01, -0.05, 0) / 0.5052)).norm() < 1e-6);
  CHECK((T.linear() - Matrix3d::Identity()).norm() > 0.1);
}

TEST_CASE("two events, worked by hand") {
  DecoupledUpdate rule({.averaging_weight = 0.5, .translation_gain = 1.4, .rotation_gain = 0.5}, 2);
  Isometry3d T = Isometry3d::Identity();
  rule.add(kFirst, T);
  rule.add(kSecond, T);
  // A = [3/4 0 -1/4; 0 1 0; -1/4 0 1/2], A^-1 = [1.6 0 0.8; 0 1 0; 0.8 0 2.4]
  // B = (-0.075, -0.055, 0.05), Gamma = (0.01, -0.035, -0.005), mean |E - T|^2 = 0.05 / 2 + 1.0104 / 4 = 0.2776
  REQUIRE(rule.update(T, 0));
  CHECK((T.translation() - 1.4 * Vector3d(-0.08, -0.055, 0.06)).norm() < 1e-15);
  CHECK((T.linear() - rotation(0.5 * Vector3d(0.01, -0.035, -0.005) / 0.2776)).norm() < 1e-8);
}

TEST_CASE("levers start at the marker's origin and the rotation turns about it") {
  DecoupledUpdate rule({.averaging_weight = 0.5, .translation_gain = 1, .rotation_gain = 1}, 2);
  const Isometry3d before = pose({0.4, 0.5, -0.3}, {0.1, -0.08, 1});
  Isometry3d T = before;
  rule.add(kFirst, T);  // lever (0, 0.1, 0), pull (-0.1, -0.02, 0): torque (0, 0, 0.01), squared lever 0.01
  REQUIRE(rule.update(T, 0));
  CHECK((T.translation() - before.translation() - Vector3d(-0.05, -0.01, 0)).norm() < 1e-15);
  CHECK((T.linear() - rotation({0, 0, 1}) * before.linear()).norm() < 1e-3);  // on the left, in the camera frame
}

TEST_CASE("the paper's numbers: torque in square centimetres") {
  const DecoupledSettings paper = DecoupledSettings::paper();
  CHECK(paper.averaging_weight == 0.1);
  CHECK(paper.translation_gain == 1.4);
  CHECK(paper.rotation_gain == 0.003);
  DecoupledUpdate rule(paper, 100);
  Isometry3d T = Isometry3d::Identity();
  rule.add(kFirst, T);
  REQUIRE(rule.update(T, 0));
  // A = diag(1, 1, 0.9), B = (-0.01, -0.002, 0), Gamma = (20, -100, 0) cm^2 of which a tenth
  CHECK((T.translation() - Vector3d(-0.014, -0.0028, 0)).norm() < 1e-15);
  CHECK((T.linear() - rotation(0.003 * Vector3d(20, -100, 0))).norm() < 1e-3);
}

TEST_CASE("the default weight is one over the events of an update, at most a tenth") {
  const auto moved = [](double weight, int events_per_update) {
    DecoupledUpdate rule({.averaging_weight = weight}, events_per_update);
    Isometry3d T = Isometry3d::Identity();
    rule.add(kFirst, T);
    rule.add(kSecond, T);
    REQUIRE(rule.update(T, 0));
    return T.matrix();
  };
  CHECK(moved(0, 20) == moved(0.05, 20));
  CHECK(moved(0, 10) == moved(0.1, 10));
  CHECK(moved(0, 5) == moved(0.1, 5));
  CHECK(moved(0, 1) == moved(0.1, 1));
  CHECK(moved(0, 20) != moved(0.1, 20));
}

namespace {

constexpr double kFocal_px = 400;

// An event that lies behind its moving edge, which goes through P, parallel to the image, with `normal` toward the
// dark.
Correspondence trailing(const Vector3d& P, const Eigen::Vector2d& normal, double polarity, double trail_px) {
  Correspondence c;
  c.polarity = polarity;
  c.dark_side_known = true;
  c.normal = normal;
  c.gradient << normal, -normal.dot(P.head<2>()) / P.z();
  c.gradient *= kFocal_px / P.z();
  c.M << P.head<2>() / P.z() - polarity * trail_px / kFocal_px * normal, 1;
  c.E = P;
  c.F = c.M.dot(c.E) / c.M.squaredNorm() * c.M;
  return c;
}

// Of a dark square, off the image's centre, that moves to the right and down: every edge makes events behind it.
std::vector<Correspondence> of_moving_square(double trail_px) {
  const Vector3d middle(0.1, -0.08, 0.6);
  return {trailing(middle + Vector3d(-0.05, 0.01, 0), {1, 0}, 1, trail_px),
          trailing(middle + Vector3d(0.05, -0.02, 0), {-1, 0}, -1, trail_px),
          trailing(middle + Vector3d(0.02, -0.05, 0), {0, 1}, 1, trail_px),
          trailing(middle + Vector3d(-0.01, 0.05, 0), {0, -1}, -1, trail_px)};
}

evmarker::Correspondences in_lanes(const std::vector<Correspondence>& all) {
  evmarker::Correspondences lanes{};
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Correspondence& c = all[i];
    lanes.polarity[i] = c.polarity;
    for (auto [lane, value] : {std::pair(&lanes.M_x, c.M.x()),
                               {&lanes.M_y, c.M.y()},
                               {&lanes.F_x, c.F.x()},
                               {&lanes.F_y, c.F.y()},
                               {&lanes.F_z, c.F.z()},
                               {&lanes.E_x, c.E.x()},
                               {&lanes.E_y, c.E.y()},
                               {&lanes.E_z, c.E.z()},
                               {&lanes.g_x, c.gradient.x()},
                               {&lanes.g_y, c.gradient.y()},
                               {&lanes.g_z, c.gradient.z()}})
      (*lane)[i] = value;
  }
  lanes.set_count(all.size());
  return lanes;
}

// Where one update over the square's events takes a pose that was right.
Isometry3d moved(const DecoupledUpdate& from, double trail_px, bool together = false) {
  DecoupledUpdate rule = from;
  Isometry3d T = pose({0, 0, 0}, {0.1, -0.08, 0.6});
  const auto events = of_moving_square(trail_px);
  if (together) rule.add(in_lanes(events), T);
  if (!together)
    for (const Correspondence& c : events) rule.add(c, T);
  REQUIRE(rule.update(T, 0));
  return T;
}

}  // namespace

TEST_CASE("events that trail their edges by what is expected do not move the pose, one by one as together") {
  const Isometry3d right = pose({0, 0, 0}, {0.1, -0.08, 0.6});
  DecoupledUpdate ignorant({}, 4), knowing = ignorant, papers(DecoupledSettings::paper(), 4);
  knowing.set_trail_by_events_per_passage(3, kFocal_px);
  papers.set_trail_by_events_per_passage(3, kFocal_px);
  constexpr double kTrail_px = 2.1 / 6;
  for (const bool together : {false, true}) {
    CAPTURE(together);
    const Vector3d dragged = moved(ignorant, kTrail_px, together).translation() - right.translation();
    REQUIRE(dragged.x() < -3e-5);
    REQUIRE(dragged.y() < -3e-5);
    const Isometry3d kept = moved(knowing, kTrail_px, together);
    CHECK((kept.translation() - right.translation()).norm() < 0.01 * dragged.norm());
    CHECK(angle_between(kept, right) < 1e-5);
    CHECK(moved(papers, kTrail_px, together).matrix() ==
          moved(DecoupledUpdate(DecoupledSettings::paper(), 4), kTrail_px, together).matrix());
  }
  CHECK((moved(knowing, 0.1, true).matrix() - moved(knowing, 0.1).matrix()).norm() < 1e-12);
  // Half a pixel at most.
  knowing.set_trail_by_events_per_passage(0.1, kFocal_px);
  CHECK((moved(knowing, 0.5).translation() - right.translation()).norm() < 1e-6);
}

TEST_CASE("reversing forgets where the pose was going, not what can be seen") {
  const DecoupledSettings settings{.averaging_weight = 0.5};
  DecoupledUpdate rule(settings, 2);
  Isometry3d T = Isometry3d::Identity();
  rule.add(kFirst, T);
  rule.add(kSecond, T);
  rule.reverse();
  Isometry3d still = T;
  REQUIRE(rule.update(still, 0));
  CHECK((still.matrix() - T.matrix()).norm() < 1e-15);
  // A new pull works on the A of the events before: with A = 1 the step would be straight along it.
  rule.add(kFirst, T);
  REQUIRE(rule.update(T, 0));
  // A = [7/8 0 -1/8; 0 1 0; -1/8 0 1/4], B = (-0.05, -0.01, 0)
  const double determinant = 7.0 / 32 - 1.0 / 64;
  CHECK((T.translation() - 1.4 * Vector3d(-0.05 * 0.25 / determinant, -0.01, -0.05 * 0.125 / determinant)).norm() <
        1e-15);
}

TEST_CASE("displaced poses come home with exact events, for every n") {
  const Isometry3d truth = pose({2.7, 0.6, -0.4}, {0.03, -0.02, 0.5});
  const Vector3d shift(0.004, -0.003, 0.01), turn(0.04, -0.03, 0.05);
  for (const int n : {1, 5, 20, 100}) {
    CAPTURE(n);
    for (const auto& [t, r] : {std::pair{shift, Vector3d(0, 0, 0)}, {Vector3d(0, 0, 0), turn}, {shift, turn}}) {
      const Isometry3d start = pose(r, Vector3d::Zero()) * truth;
      Isometry3d displaced = start;
      displaced.translation() = truth.translation() + t;
      REQUIRE((displaced.matrix() - truth.matrix()).norm() > 0.01);
      const Isometry3d end = followed({}, n, truth, displaced, 60000);
      CHECK((end.translation() - truth.translation()).norm() < 2e-5);
      CHECK(angle_between(end, truth) < 2e-3);
    }
    // And there they stay.
    const Isometry3d end = followed({}, n, truth, truth, 10000);
    CHECK((end.matrix() - truth.matrix()).norm() < 1e-12);
  }
}

TEST_CASE("with dimensionless gains ten times the size is ten times the same") {
  const Isometry3d truth = pose({2.7, 0.6, -0.4}, {0.03, -0.02, 0.5});
  Isometry3d start = pose({0.04, -0.03, 0.05}, {0, 0, 0}) * truth, big_truth = truth;
  start.translation() = truth.translation() + Vector3d(0.004, -0.003, 0.01);
  Isometry3d big_start = start;
  big_truth.translation() *= 10;
  big_start.translation() *= 10;
  const auto compare = [&](const DecoupledSettings& settings) {
    const Isometry3d small = followed(settings, 100, truth, start, 1000);
    const Isometry3d big = followed(settings, 100, big_truth, big_start, 1000, 10);
    REQUIRE(angle_between(small, start) > 1e-3);  // it moved
    return angle_between(small, big) + (10 * small.translation() - big.translation()).norm();
  };
  CHECK(compare({}) < 1e-9);
  CHECK(compare({.averaging_weight = 0.03, .translation_gain = 1, .rotation_gain = 0.7}) < 1e-9);
  CHECK(compare(DecoupledSettings::paper()) > 1e-2);  // a torque in square centimetres knows the size
}

TEST_CASE("a singular step is skipped and leaves the pose as it was") {
  const Isometry3d before = pose({0.4, 0.5, -0.3}, {0.1, -0.08, 1});
  Isometry3d T = before;
  DecoupledUpdate empty({}, 10);
  CHECK_FALSE(empty.update(T, 0));  // nothing was collected
  CHECK(T.matrix() == before.matrix());
  DecoupledUpdate forgetful({.averaging_weight = 1}, 1);
  forgetful.add(kFirst, T);  // I - L of the last event alone
  CHECK_FALSE(forgetful.update(T, 0));
  CHECK(T.matrix() == before.matrix());
  DecoupledUpdate at_origin({}, 10);
  at_origin.add(correspondence({0, 0, 1}, {0, 0, 1}, before.translation()), before);  // no lever
  at_origin.update(T, 0);
  CHECK(T.matrix().allFinite());
  // Thousands of events on one line of sight.
  DecoupledUpdate one_sided({}, 10);
  Isometry3d moved = before;
  for (int i = 1; i <= 5000; ++i) {
    one_sided.add(kFirst, moved);
    if (i % 10 == 0) {
      const Isometry3d last = moved;
      if (!one_sided.update(moved, i)) CHECK(moved.matrix() == last.matrix());
      REQUIRE(moved.matrix().allFinite());
    }
  }
}

TEST_CASE("numbers that are none never reach the pose") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  const Isometry3d before = pose({0.4, 0.5, -0.3}, {0.1, -0.08, 1});
  for (const double bad : {nan, infinity, -infinity, 1e300})
    for (int field = 0; field < 3; ++field)
      for (int axis = 0; axis < 3; ++axis) {
        Correspondence c = kFirst;
        (field == 0 ? c.M : field == 1 ? c.F : c.E)(axis) = bad;
        DecoupledUpdate rule({}, 10);
        Isometry3d T = before;
        rule.add(kSecond, T);
        rule.add(c, T);
        if (!rule.update(T, 0)) CHECK(T.matrix() == before.matrix());
        CAPTURE(bad);
        CAPTURE(field);
        CAPTURE(axis);
        CHECK(T.matrix().allFinite());
      }
}

TEST_CASE("rotations stay rotations") {
  const Isometry3d truth = pose({2.7, 0.6, -0.4}, {0.03, -0.02, 0.5});
  const Isometry3d end = followed({}, 1, truth, pose({0.05, 0, 0.05}, {0, 0, 0}) * truth, 20000);
  CHECK((end.linear().transpose() * end.linear() - Matrix3d::Identity()).norm() < 1e-14);
}

static_assert(!evmarker::MotionEstimatingRule<DecoupledUpdate>);

TEST_CASE("copies are independent") {
  DecoupledUpdate rule({}, 10);
  Isometry3d T = Isometry3d::Identity(), copied = T;
  rule.add(kFirst, T);
  DecoupledUpdate copy = rule;
  rule.add(kSecond, T);
  REQUIRE(rule.update(T, 0));
  REQUIRE(copy.update(copied, 0));
  CHECK(T.matrix() != copied.matrix());
}

TEST_CASE("impossible settings of the decoupled update are refused with field and value") {
  const auto message_of = [](const DecoupledSettings& settings, int events_per_update = 100) -> std::string {
    try {
      const DecoupledUpdate rule(settings, events_per_update);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  CHECK(message_of({}) == "accepted");
  CHECK(message_of(DecoupledSettings::paper()) == "accepted");
  CHECK(message_of({.averaging_weight = 1}) == "accepted");
  CHECK(message_of({.averaging_weight = -0.1}) == "decoupled update: averaging_weight is -0.1");
  CHECK(message_of({.averaging_weight = 1.5}) == "decoupled update: averaging_weight is 1.5");
  CHECK(message_of({.averaging_weight = nan}) == "decoupled update: averaging_weight is nan");
  CHECK(message_of({.translation_gain = 0}) == "decoupled update: translation_gain is 0");
  CHECK(message_of({.translation_gain = infinity}) == "decoupled update: translation_gain is inf");
  CHECK(message_of({.rotation_gain = -2}) == "decoupled update: rotation_gain is -2");
  CHECK(message_of({.rotation_gain = nan}) == "decoupled update: rotation_gain is nan");
  CHECK(message_of({.torque_length_unit_m = -1}) == "decoupled update: torque_length_unit_m is -1");
  CHECK(message_of({.torque_length_unit_m = nan}) == "decoupled update: torque_length_unit_m is nan");
  CHECK(message_of({}, 0) == "decoupled update: events_per_update is 0");
  CHECK(message_of({}, -5) == "decoupled update: events_per_update is -5");
}
