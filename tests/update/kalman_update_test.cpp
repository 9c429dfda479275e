#include "evmarker/update/kalman_update.hpp"

#include <doctest/doctest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "evmarker/model/information.hpp"
#include "evmarker/tracking/edge_follower.hpp"
#include "pose_steps.hpp"
#include "simulated.hpp"

using namespace evmarker;
using namespace evmarker::steps;
using Eigen::Isometry3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kFocal = 533;
const MarkerModel kCode = make_code_marker(simulated::kMarkerLength, simulated::code());

using Follower = EdgeFollower<KalmanUpdate>;

Vector2d image(const Vector3d& p) { return kFocal / p.z() * p.head<2>(); }

// An edge in the image, with the unit normal that points to its dark side.
struct ImageEdge {
  Vector2d from, to, normal;

  ImageEdge(const MarkerSegment& segment, const Isometry3d& T) {
    const Vector3d &a = kCode.vertices[static_cast<std::size_t>(segment.from)],
                   &b = kCode.vertices[static_cast<std::size_t>(segment.to)];
    from = image(T * a);
    to = image(T * b);
    const Vector2d along = (to - from).normalized();
    normal = {-along.y(), along.x()};
    if (normal.dot(image(T * (a + 1e-4 * segment.dark_side)) - from) < 0) normal = -normal;
  }
  double distance(const Vector2d& u) const { return normal.dot(u - from); }
};

// Where the code marker's events lie if each is exactly on an edge, or so many pixels on its dark side.
class ExactEvents {
 public:
  explicit ExactEvents(unsigned seed) : random_(seed) {}

  Vector2d next(const Isometry3d& truth, double toward_dark_px = 0) {
    segment = random_() % kCode.segments.size();
    const ImageEdge edge(kCode.segments[segment], truth);
    const double place = std::uniform_real_distribution<double>(0.15, 0.85)(random_);
    foot = (1 - place) * edge.from + place * edge.to;
    return ((1 - place) * edge.from + place * edge.to + toward_dark_px * edge.normal) / kFocal;
  }

  Vector2d foot{0, 0};      // of the last event on its edge [px]
  std::size_t segment = 0;  // of the last event

 private:
  std::mt19937 random_;
};

const Isometry3d kTruth = facing_pose({0.03, -0.02, 0.6}, {0.3, -0.25, 0.4});

Follower follower(const Isometry3d& start, int n, const KalmanSettings& settings = {}, double gate_px = 2) {
  return {kCode, kFocal, start, {.events_per_update = n, .matching = {.max_distance_px = gate_px}, .update = settings}};
}

// Feeds exact events of a motion, one every `interval`, and returns the time of the last one.
template <typename Motion>
Timestamp follow(Follower& follower, ExactEvents& events, const Motion& motion, int count, Timestamp begin,
                 Timestamp interval = 10, double toward_dark_px = 0) {
  Timestamp t = begin;
  for (int i = 0; i < count; ++i) {
    t += interval;
    follower.push(events.next(motion(1e-6 * static_cast<double>(t)), toward_dark_px), t);
  }
  return t;
}

Vector6d sigmas(const Matrix6d& covariance) { return covariance.diagonal().cwiseSqrt(); }
double least_eigenvalue(const Matrix6d& m) { return Eigen::SelfAdjointEigenSolver<Matrix6d>(m).eigenvalues()(0); }

// What an event counts for its place along the edge: within three times the spread of the events, 1 px at first, of an
// end, but not in the edge's middle half, a fifth.
double corner_weight(const MarkerSegment& segment, const Isometry3d& T, const Vector2d& foot) {
  const ImageEdge edge(segment, T);
  const Vector3d &a = kCode.vertices[static_cast<std::size_t>(segment.from)],
                 &b = kCode.vertices[static_cast<std::size_t>(segment.to)];
  const bool from_nearer = (foot - image(T * (0.75 * a + 0.25 * b))).dot(edge.to - edge.from) < 0;
  const bool to_nearer = (foot - image(T * (0.25 * a + 0.75 * b))).dot(edge.to - edge.from) > 0;
  if (!from_nearer && !to_nearer) return 1;
  return (foot - (from_nearer ? edge.from : edge.to)).norm() < 3 ? 0.2 : 1;
}

// One matched event of the code marker at a pose, `off_px` from its edge.
Correspondence matched(const Isometry3d& T, double off_px = 0.5) {
  SegmentMatcher matcher(kCode, kFocal);
  REQUIRE(matcher.project(T));
  Correspondence c;
  REQUIRE(matcher.match(ExactEvents(3).next(T, off_px), c) == MatchResult::matched);
  return c;
}

// Just after an update, and as long as no noise has been measured, the reported covariance is the filter's own: three
// quarters of it, divided by the square of the inflation, and 0.08 of the rest.
const KalmanSettings kReportsItsOwnCovariance{.inflation = std::sqrt(0.75 / (1 - 0.25 * 0.08)),
                                              .latency_sigma_s = 1e-9};

}  // namespace

TEST_CASE("one event: the textbook's gain with numerical derivatives of the signed distance") {
  std::mt19937 random(31);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto vector = [&](double scale) {
    return Vector3d(scale * Vector3d(unit(random), unit(random), unit(random)));
  };
  const KalmanSettings settings = kReportsItsOwnCovariance;
  const Vector6d sigma0 =
      step(Vector3d::Constant(settings.initial_sigma_t_m), Vector3d::Constant(settings.initial_sigma_r_rad));
  const Matrix6d P0 = sigma0.cwiseAbs2().asDiagonal();
  ExactEvents events(32);
  int tested = 0, dark_above = 0, at_corner = 0;
  for (int i = 0; i < 300; ++i) {
    const Isometry3d T = facing_pose(Vector3d(0, 0, 0.7) + vector(0.15), vector(0.6));
    const double off_px = i % 3 == 0 ? 0.0 : 0.3 * unit(random);
    const Vector2d m = events.next(T, off_px);
    SegmentMatcher matcher(kCode, kFocal);
    REQUIRE(matcher.project(T));
    Correspondence c;
    if (matcher.match(m, c) != MatchResult::matched) continue;  // an edge that is seen at a slant
    const MarkerSegment& segment = kCode.segments[static_cast<std::size_t>(c.segment)];
    if (static_cast<std::size_t>(c.segment) != events.segment) continue;
    // The rule takes the image's scale at the event for the whole way to the end, which moves the border by 0.2 %.
    if (std::abs(std::sqrt(c.from_end_px2) - 3) < 0.02) continue;
    ++tested;
    dark_above += c.normal.y() < 0;
    REQUIRE(c.dark_side_known);
    CHECK(c.distance_px == doctest::Approx(off_px).epsilon(1e-6));  // positive on the dark side
    CHECK((c.normal - ImageEdge(segment, T).normal).norm() < 1e-9);

    Vector6d J;  // how the edge moves along its normal: away from the event
    for (int axis = 0; axis < 6; ++axis) {
      const Vector6d h = 1e-6 * Vector6d::Unit(axis);
      const auto distance = [&](const Isometry3d& at) { return ImageEdge(segment, at).distance(kFocal * m); };
      J(axis) = -(distance(perturbed(T, h)) - distance(perturbed(T, -h))) / 2e-6;
    }
    REQUIRE(J.norm() > 100);
    const double weight = corner_weight(segment, T, events.foot) / (1 + off_px * off_px);
    at_corner += weight < 0.5;
    const double spread2 = 1 + 0.001 * (off_px * off_px - 1);
    const double R = settings.inflation * settings.inflation * spread2 / weight;
    // On the edge the derivative is that of its point E; beside it the edge also turns, which the row leaves out.
    const double tolerance = off_px == 0 ? 1e-6 : 0.02;
    for (const auto& [dark_side_known, polarity] :
         {std::pair{false, 0.0}, {false, 1.0}, {true, 0.0}, {true, 1.0}, {true, -1.0}}) {
      c.dark_side_known = dark_side_known;
      c.polarity = polarity;
      KalmanUpdate rule(settings, 1);
      CHECK((rule.covariance().inverse() * P0 - Matrix6d::Identity()).norm() < 1e-12);
      rule.add(c, T);
      Isometry3d moved = T;
      REQUIRE(rule.update(moved, 5));
      const double offset2 = dark_side_known ? std::pow(settings.initial_sigma_offset_px, 2) : 0;
      // ON events lie by the trail on the bright side of the offset, OFF events on the dark side.
      const double trailing = dark_side_known ? -polarity : 0;
      const double trail2 = std::pow(settings.initial_sigma_trail_px, 2);
      const double S = J.dot(P0 * J) + offset2 + trailing * trailing * trail2 + R;
      const Matrix6d P = P0 - P0 * J * J.transpose() * P0 / S;
      CHECK((rule.covariance().inverse() * P - Matrix6d::Identity()).norm() < 10 * tolerance);
      const Vector6d expected = P0 * J * off_px / S;
      CHECK((error_of(T, moved) - expected).cwiseQuotient(sigma0).norm() <=
            tolerance * expected.cwiseQuotient(sigma0).norm() + 1e-9);
      CHECK(rule.edge_offset_px() == doctest::Approx(std::max(0.0, offset2 * off_px / S)).epsilon(tolerance));
      CHECK(rule.trail_px() == doctest::Approx(std::max(0.0, trailing * trail2 * off_px / S)).epsilon(tolerance));
      if (off_px != 0)  // toward the event
        CHECK(std::abs(ImageEdge(segment, moved).distance(kFocal * m)) < 0.9 * std::abs(off_px));
    }
  }
  CHECK(tested > 200);
  CHECK(dark_above > 50);
  CHECK(tested - dark_above > 50);
  CHECK(at_corner > 20);
}

TEST_CASE("many events, taken one by one or all at once: the textbook's gain of the stacked measurements") {
  const KalmanSettings settings = kReportsItsOwnCovariance;
  const Isometry3d T = facing_pose({0.05, -0.02, 0.6}, {0.2, -0.3, 0.1});
  Eigen::Matrix<double, 8, 8> P0 = Eigen::Matrix<double, 8, 8>::Zero();
  P0.diagonal() << Vector3d::Constant(std::pow(settings.initial_sigma_t_m, 2)),
      Vector3d::Constant(std::pow(settings.initial_sigma_r_rad, 2)), std::pow(settings.initial_sigma_offset_px, 2),
      std::pow(settings.initial_sigma_trail_px, 2);
  for (const int n : {1, 2, 5, 10, 11, 12, 60}) {
    CAPTURE(n);
    ExactEvents events(33);
    SegmentMatcher matcher(kCode, kFocal);
    REQUIRE(matcher.project(T));
    KalmanUpdate rule(settings, n);
    Eigen::MatrixXd J(n, 8);
    Eigen::VectorXd d(n), weight(n);
    double spread2 = 1;
    for (int i = 0; i < n;) {
      Correspondence c;
      if (matcher.match(events.next(T, 0.4 * std::sin(i + 1)), c) != MatchResult::matched) continue;
      c.polarity = i % 3 == 0 ? 1 : i % 3 == 1 ? -1 : 0;
      rule.add(c, T);
      const Vector3d lever = c.E - T.translation();
      J.row(i) << c.gradient.transpose(), lever.cross(c.gradient).transpose(), 1, -c.polarity;
      d(i) = c.distance_px;
      weight(i) = corner_weight(kCode.segments[events.segment], T, events.foot) / (1 + d(i) * d(i));
      spread2 += 0.001 * (d(i) * d(i) - spread2);
      ++i;
    }
    Isometry3d moved = T;
    REQUIRE(rule.update(moved, 5));
    const Eigen::MatrixXd R = (settings.inflation * settings.inflation * spread2 * weight.cwiseInverse()).asDiagonal();
    const Eigen::MatrixXd S = J * P0 * J.transpose() + R;
    const Eigen::MatrixXd gain = P0 * J.transpose() * S.fullPivLu().inverse();
    const Eigen::VectorXd expected = gain * d;
    const Eigen::MatrixXd P = P0 - gain * J * P0;
    const Vector6d sigma = P0.diagonal().head<6>().cwiseSqrt();
    REQUIRE(expected.head<6>().cwiseQuotient(sigma).norm() > 1e-3);
    CHECK((error_of(T, moved) - expected.head<6>()).cwiseQuotient(sigma).norm() < 1e-6);
    CHECK(rule.edge_offset_px() == doctest::Approx(std::max(0.0, expected(6))));
    CHECK(rule.trail_px() == doctest::Approx(std::max(0.0, expected(7))));
    CHECK((rule.covariance().inverse() * P.topLeftCorner<6, 6>() - Matrix6d::Identity()).norm() < 1e-4);
  }
}

TEST_CASE("a displaced pose comes home within a few updates of exact events, for every n") {
  const auto still = [](double) { return kTruth; };
  const Isometry3d start = perturbed(kTruth, step({0.003, -0.002, 0.008}, {0.03, -0.02, 0.03}));
  REQUIRE(translation_error(start, kTruth) > 0.008);
  REQUIRE(rotation_error(start, kTruth) > 0.04);
  for (const int n : {1, 10, 100}) {
    CAPTURE(n);
    Follower home = follower(start, n, {}, 6);
    ExactEvents events(51);
    follow(home, events, still, 500, 0);
    MESSAGE("n = " << n << ", 500 events: " << 1e3 * translation_error(home.T_camera_marker(), kTruth) << " mm, "
                   << 57.3 * rotation_error(home.T_camera_marker(), kTruth) << " deg");
    CHECK(translation_error(home.T_camera_marker(), kTruth) < 0.0015);
    CHECK(rotation_error(home.T_camera_marker(), kTruth) < 0.01);
    follow(home, events, still, 10000, 5000);
    MESSAGE("10500 events: " << 1e3 * translation_error(home.T_camera_marker(), kTruth) << " mm, "
                             << 57.3 * rotation_error(home.T_camera_marker(), kTruth) << " deg");
    CHECK(translation_error(home.T_camera_marker(), kTruth) < 2e-5);
    CHECK(rotation_error(home.T_camera_marker(), kTruth) < 5e-4);
    CHECK(home.rule().twist().norm() < 0.02);
    // And there it stays.
    Follower stays = follower(kTruth, n);
    follow(stays, events, still, 2000, 0);
    CHECK(translation_error(stays.T_camera_marker(), kTruth) < 1e-9);
    CHECK(rotation_error(stays.T_camera_marker(), kTruth) < 1e-9);
    CHECK(std::abs(stays.rule().edge_offset_px()) < 1e-6);
  }
}

TEST_CASE("events beside their edges become an edge offset, not a bias of the pose") {
  const auto still = [](double) { return kTruth; };
  for (const double offset_px : {0.45, 0.2})
    for (const int n : {1, 10, 100}) {
      CAPTURE(offset_px);
      CAPTURE(n);
      Follower shifted = follower(kTruth, n);
      ExactEvents events(52);
      follow(shifted, events, still, 20000, 0, 10, offset_px);
      MESSAGE("offset " << shifted.rule().edge_offset_px() << " of " << offset_px << " px, pose off by "
                        << 1e3 * translation_error(shifted.T_camera_marker(), kTruth) << " mm");
      CHECK(shifted.rule().edge_offset_px() == doctest::Approx(offset_px).epsilon(0.02).scale(0));
      CHECK(translation_error(shifted.T_camera_marker(), kTruth) < 1e-4);
      CHECK(rotation_error(shifted.T_camera_marker(), kTruth) < 1e-3);
    }
  // They crowd on the dark side: where they lie on the other one, something else makes them, or the pose is wrong.
  Follower pulled = follower(kTruth, 10);
  ExactEvents beside(52);
  follow(pulled, beside, still, 20000, 0, 10, -0.4);
  CHECK(pulled.rule().edge_offset_px() == 0);
  // And no farther than the edge is wide.
  Follower pushed = follower(kTruth, 10);
  follow(pushed, beside, still, 20000, 0, 10, 0.9);
  CHECK(pushed.rule().edge_offset_px() == 0.5);
  // A model that does not know its dark sides cannot know the offset.
  MarkerModel blind = kCode;
  for (MarkerSegment& segment : blind.segments) segment.dark_side.setZero();
  Follower ignorant(blind, kFocal, kTruth, {.events_per_update = 10});
  ExactEvents events(52);
  follow(ignorant, events, still, 20000, 0, 10, 0.5);
  CHECK(ignorant.rule().edge_offset_px() == 0);
}

namespace {

// To and fro, while it turns, ten times a second.
Isometry3d swaying(double seconds) {
  const double w = 2 * std::numbers::pi * 10 * seconds;
  return perturbed(kTruth, step(Vector3d(0.012 * std::sin(w), 0.010 * std::cos(w), 0.010 * std::sin(w)),
                                Vector3d(0.05 * std::cos(w), 0.05 * std::sin(w), 0.1 * std::sin(w))));
}

struct PolarSight {
  Vector2d m;
  Timestamp t;
  double polarity;
};

// Events of that motion, the more the faster an edge moves. An edge that moves toward the dark makes ON events at
// offset_px - trail_px, one that moves out of it OFF events at offset_px + trail_px, `off_delay_s` later.
std::vector<PolarSight> trailing_events(Timestamp end, double offset_px, double trail_px, double off_delay_s = 0) {
  std::mt19937 random(71);
  std::uniform_real_distribution<double> unit(0, 1);
  std::vector<PolarSight> events;
  for (Timestamp t = 2; t < end; t += 2) {
    const MarkerSegment& segment = kCode.segments[random() % kCode.segments.size()];
    const double seconds = 1e-6 * static_cast<double>(t), place = 0.15 + 0.7 * unit(random);
    const ImageEdge edge(segment, swaying(seconds));
    const Vector3d point = (1 - place) * kCode.vertices[static_cast<std::size_t>(segment.from)] +
                           place * kCode.vertices[static_cast<std::size_t>(segment.to)];
    const Vector2d now = image(swaying(seconds) * point);
    const double speed_px_per_s = 1e6 * edge.normal.dot(now - image(swaying(seconds - 1e-6) * point));
    if (std::abs(speed_px_per_s) < 1500 * unit(random)) continue;
    const double polarity = speed_px_per_s > 0 ? 1 : -1;
    const double late_px = (polarity > 0 ? 0 : off_delay_s) * speed_px_per_s;
    events.push_back({(now + (offset_px - polarity * trail_px - late_px) * edge.normal) / kFocal, t, polarity});
  }
  return events;
}

enum class Polarity { told, unknown };

// Mean error of the translation [m] from 0.1 s on.
double mean_error(Follower& follower, const std::vector<PolarSight>& events, Polarity polarity) {
  double sum = 0;
  int poses = 0;
  for (const PolarSight& event : events) {
    const bool updated = follower.push(event.m, event.t, polarity == Polarity::told ? event.polarity : 0).updated;
    REQUIRE(follower.rule().trail_px() >= 0);
    if (!updated || event.t < 100000) continue;
    sum += translation_error(follower.T_camera_marker(), swaying(1e-6 * static_cast<double>(event.t)));
    ++poses;
  }
  REQUIRE(poses > 100);
  return sum / poses;
}

}  // namespace

TEST_CASE("a trail that is known holds, and the pose does not trail") {
  constexpr double kTrail_px = 0.4, kCertain_px = 1e-4;
  const auto events = trailing_events(200000, 0.2, kTrail_px);
  Follower known = follower(swaying(0), 20, {.initial_sigma_trail_px = kCertain_px, .initial_trail_px = kTrail_px}),
           none = follower(swaying(0), 20, {.initial_sigma_trail_px = kCertain_px});
  CHECK(known.rule().trail_px() == kTrail_px);
  const double error = mean_error(known, events, Polarity::told), trailing = mean_error(none, events, Polarity::told);
  MESSAGE("error " << 1e3 * error << " mm, without trail " << 1e3 * trailing << " mm");
  CHECK(known.rule().trail_px() == doctest::Approx(kTrail_px).epsilon(1e-3).scale(0));
  CHECK(error < 0.5 * trailing);
}

TEST_CASE("events trail by a contrast step at most, whatever else lies behind the edges, but by what the user states") {
  constexpr double kEventsPerPassage = 10, kTrail_px = 0.4;
  const double most_px = 2 * expected_trail_px(1, kEventsPerPassage);  // edges are sharp: of one pixel's width
  const auto events = trailing_events(500000, 0.2, kTrail_px);
  Follower learned = follower(swaying(0), 20), bounded = learned,
           stated = follower(swaying(0), 20, {.initial_sigma_trail_px = 1e-3, .initial_trail_px = 0.3});
  for (Follower* of : {&bounded, &stated}) of->set_events_per_passage(kEventsPerPassage);
  for (Follower* of : {&learned, &bounded, &stated}) mean_error(*of, events, Polarity::told);
  CHECK(std::abs(learned.rule().trail_px() - kTrail_px) < 0.01);
  // A third of it may be a delay, of which something is unknown where such events seem to show one.
  CHECK(bounded.rule().trail_px() <= 1.6 * most_px);
  CHECK(bounded.rule().trail_px() > 0.9 * most_px);
  CHECK(stated.rule().trail_px() > 2 * most_px);
  CHECK(stated.rule().trail_px() <= 0.3);
}

TEST_CASE("how far events trail is learned when the motion turns, and the pose does not trail") {
  for (const auto& truth : {std::pair{0.0, 0.4}, {0.2, 0.4}, {0.3, 0.2}, {0.2, 0.0}})
    for (const int n : {1, 20, 100}) {
      CAPTURE(truth.first);
      CAPTURE(truth.second);
      CAPTURE(n);
      const auto [offset_px, trail_px] = truth;
      const auto events = trailing_events(500000, offset_px, trail_px);
      REQUIRE(events.size() > 20000);
      Follower with = follower(swaying(0), n), without = with;
      const double error = mean_error(with, events, Polarity::told),
                   trailing = mean_error(without, events, Polarity::unknown);
      MESSAGE("n = " << n << ", " << events.size() << " events: trail " << with.rule().trail_px() << " of " << trail_px
                     << " px, offset " << with.rule().edge_offset_px() << " of " << offset_px << " px, error "
                     << 1e3 * error << " mm, without polarity " << 1e3 * trailing << " mm");
      CHECK(std::abs(with.rule().trail_px() - trail_px) < 0.01);
      CHECK(std::abs(with.rule().edge_offset_px() - offset_px) < 0.01);
      CHECK(without.rule().trail_px() == 0);
      if (trail_px > 0) CHECK(error < 0.6 * trailing);

      // The way back: the same events lie at the same places.
      Follower back = with;
      back.reverse();
      CHECK(back.rule().trail_px() == with.rule().trail_px());
      CHECK(back.rule().edge_offset_px() == with.rule().edge_offset_px());
      for (auto event = events.rbegin(); event != events.rend(); ++event)
        back.push(event->m, 2 * events.back().t - event->t, event->polarity);
      CHECK(std::abs(back.rule().trail_px() - trail_px) < 0.05);
      CHECK(translation_error(back.T_camera_marker(), swaying(0)) < 1e-3);
    }
}

TEST_CASE("how much later OFF events come is learned, and does not become an edge offset") {
  for (const double off_delay_s : {3e-4, -3e-4, 0.0})
    for (const int n : {1, 20, 100}) {
      CAPTURE(off_delay_s);
      CAPTURE(n);
      const auto events = trailing_events(500000, 0.3, 0.2, off_delay_s);
      Follower with = follower(swaying(0), n), without = follower(swaying(0), n, {.initial_sigma_off_delay_s = 1e-9});
      const double error = mean_error(with, events, Polarity::told),
                   ignorant = mean_error(without, events, Polarity::told);
      MESSAGE("n = " << n << ": OFF delay " << 1e3 * with.rule().off_delay_s() << " of " << 1e3 * off_delay_s
                     << " ms, offset " << with.rule().edge_offset_px() << " and " << without.rule().edge_offset_px()
                     << " of 0.3 px, error " << 1e3 * error << " mm, without it " << 1e3 * ignorant << " mm");
      CHECK(std::abs(with.rule().off_delay_s() - off_delay_s) < 3e-5);
      CHECK(std::abs(with.rule().edge_offset_px() - 0.3) < 0.02);
      if (off_delay_s == 0) continue;
      CHECK(std::abs(without.rule().edge_offset_px() - 0.3) > 0.05);
      CHECK(error < ignorant);
    }
}

TEST_CASE("no event comes before its edge: the trail is never negative") {
  const auto events = trailing_events(300000, 0, -0.3);
  Follower fed = follower(swaying(0), 10);
  double most = 0;
  for (const PolarSight& event : events) {
    fed.push(event.m, event.t, event.polarity);
    REQUIRE(fed.rule().trail_px() >= 0);
    if (event.t > 100000) most = std::max(most, fed.rule().trail_px());
  }
  MESSAGE("at most " << most << " px");
  CHECK(most < 0.002);
}

TEST_CASE("the trail's first guess: half of a contrast step of an edge as wide as its events are spread") {
  for (const double per_px2 : {1.0, 3.0, 10.0}) {
    KalmanUpdate rule({}, 10);
    Isometry3d T = kTruth;
    rule.add(matched(T), T);  // forgotten
    rule.measure_trail(T, per_px2);
    constexpr double kUnknownSpread2 = 1;  // before there are events
    const double guess = std::sqrt(12 * (kUnknownSpread2 - 1.0 / 12)) / (2 * per_px2), variance = 0.3 * 0.3;
    CHECK(rule.trail_px() == doctest::Approx(guess * variance / (variance + guess * guess / 16)));
    CHECK(rule.edge_offset_px() == 0);
    CHECK(T.matrix() == kTruth.matrix());
  }
}

TEST_CASE("a measured trail moves the pose as it moves the state, which is some events older") {
  const auto events = trailing_events(100000, 0.2, 0.4);
  for (const int n : {20, 100}) {
    Follower fed = follower(swaying(0), n);
    Timestamp t = 0;
    for (const PolarSight& event : events)
      if (fed.push(event.m, event.t, event.polarity).updated) t = event.t;
    KalmanUpdate older = fed.rule(), present = fed.rule();
    Isometry3d T = fed.T_camera_marker(), T_of_present = T;
    present.extrapolate(T_of_present, t);  // brings the state to the pose's time, and leaves the pose
    REQUIRE(translation_error(T, T_of_present) < 1e-9);
    older.measure_trail(T, 3);
    present.measure_trail(T_of_present, 3);
    const double moved = translation_error(T, fed.T_camera_marker()), apart = translation_error(T, T_of_present);
    MESSAGE("n = " << n << ": moved by " << 1e6 * moved << " um, " << 1e6 * apart << " um apart");
    CHECK(apart < 1e-4 * moved);
  }
}

TEST_CASE("what the events do not say has not moved: after a rest the pose stays, and is known") {
  const Vector3d v(0.25, -0.15, 0.2), w(0.8, -0.6, 1.5);
  const Trajectory motion = trajectory::linear(kTruth, v, w);
  constexpr double kEventsPerPx = 300;  // 100000 events in a second, 0.35 m/s, about 890 px/m
  for (const int n : {1, 10, 100}) {
    Follower moving = follower(kTruth, n);
    ExactEvents events(72);
    const Timestamp stop = follow(moving, events, motion, 10000, 0);
    const Isometry3d rest = motion(1e-6 * static_cast<double>(stop));
    REQUIRE(moving.rule().twist().head<3>().norm() > 0.25);
    for (const Timestamp pause : {50'000, 1'000'000, 60'000'000}) {
      CAPTURE(n);
      CAPTURE(pause);
      const auto rested = [&](bool known) {
        KalmanUpdate rule = moving.rule();
        if (known) rule.bound_motion_by_events(kEventsPerPx, 1);
        Isometry3d T = moving.T_camera_marker();
        SegmentMatcher matcher(kCode, kFocal);
        REQUIRE(matcher.project(T));
        for (int i = 0; i < n;) {
          Correspondence c;
          if (matcher.match(events.next(rest), c) != MatchResult::matched) continue;
          c.t = stop + pause;
          rule.add(c, T);
          ++i;
        }
        REQUIRE(rule.update(T, stop + pause));
        return std::pair(T, rule);
      };
      const auto [T, rule] = rested(true);
      const auto [T_unbounded, unbounded] = rested(false);
      const Vector6d sigma = sigmas(rule.covariance()), sigma_unbounded = sigmas(unbounded.covariance());
      MESSAGE("n = " << n << ", " << 1e-6 * static_cast<double>(pause) << " s: " << 1e3 * translation_error(T, rest)
                     << " mm, sigma " << 1e3 * sigma.head<3>().maxCoeff() << " mm, " << rule.twist().head<3>().norm()
                     << " m/s; unbounded " << 1e3 * translation_error(T_unbounded, rest) << " mm, "
                     << 1e3 * sigma_unbounded.head<3>().maxCoeff() << " mm, " << unbounded.twist().head<3>().norm()
                     << " m/s");
      // A hundred events are those of a third of a pixel, if they were of motion, and of several at most.
      CHECK(translation_error(T, rest) < (n == 100 ? 0.0022 : 0.0006));
      CHECK(rotation_error(T, rest) < 0.02);
      CHECK(rule.twist().head<3>().norm() < 0.25);
      CHECK(sigma.allFinite());
      CHECK(sigma.head<3>().maxCoeff() < 0.0013);
      CHECK(sigma.head<3>().maxCoeff() < sigma_unbounded.head<3>().maxCoeff());
      CHECK(least_eigenvalue(rule.covariance()) > 0);
    }
  }
}

TEST_CASE("noise at rest tells nothing of the edges: the covariance after it is that without it") {
  const Trajectory motion = trajectory::linear(kTruth, {0.25, -0.15, 0.2}, {0.8, -0.6, 1.5});
  Follower moving = follower(kTruth, 100);
  ExactEvents events(74);
  Timestamp t = follow(moving, events, motion, 10000, 0);
  KalmanUpdate rule = moving.rule(), rested = moving.rule();
  Isometry3d T = moving.T_camera_marker(), T_rested = T;
  for (KalmanUpdate* each : {&rule, &rested}) each->bound_motion_by_events(300, 1);
  rule.set_background({.signal_weight = 1});
  rested.set_background({.signal_weight = 0, .by_chance_per_s = 1000, .noise_per_s = 1000});
  for (int i = 0; i < 20000; ++i) rested.add(matched(T, i % 2 == 0 ? 1.5 : -1.5), T);
  REQUIRE(rested.update(T_rested, t));
  rested.set_background({.signal_weight = 1});
  SegmentMatcher matcher(kCode, kFocal);
  for (int update = 0; update < 100; ++update) {
    REQUIRE(matcher.project(T));
    for (int i = 0; i < 100;) {
      Correspondence c;
      if (matcher.match(events.next(motion(1e-6 * static_cast<double>(t + 10))), c) != MatchResult::matched) continue;
      c.t = t += 10;
      rule.add(c, T);
      rested.add(c, T_rested);
      ++i;
    }
    REQUIRE(rule.update(T, t));
    REQUIRE(rested.update(T_rested, t));
  }
  CHECK(T_rested.isApprox(T, 1e-12));
  CHECK(rested.covariance().isApprox(rule.covariance(), 1e-9));
}

TEST_CASE("constant motion: velocity of the marker's origin and turn rate, both in the camera frame") {
  const Vector3d v(0.25, -0.15, 0.2), w(0.8, -0.6, 1.5);
  const Vector6d truth = step(v, w);
  const Trajectory motion = trajectory::linear(kTruth, v, w);
  // Fading pulls the velocity towards zero; what does not fade must be right.
  for (const double memory_s : {10.0, KalmanSettings().velocity_memory_s})
    for (const int n : {1, 10, 100}) {
      CAPTURE(memory_s);
      CAPTURE(n);
      Follower moving = follower(kTruth, n, {.velocity_memory_s = memory_s});
      ExactEvents events(53);
      const Timestamp t = follow(moving, events, motion, 20000, 0);
      REQUIRE(translation_error(motion(0.2), kTruth) > 0.05);
      const Vector6d twist = moving.rule().twist();
      MESSAGE("twist " << twist.transpose() << " of " << truth.transpose());
      const bool fades = memory_s < 1;
      const double v_tolerance = (fades ? 0.15 : 0.03) * v.norm();
      const double w_tolerance = (fades || n == 100 ? 0.3 : 0.05) * w.norm();
      CHECK((twist - truth).head<3>().norm() < v_tolerance);
      CHECK((twist - truth).tail<3>().norm() < w_tolerance);
      const Vector6d error = error_of(moving.T_camera_marker(), motion(1e-6 * static_cast<double>(t)));
      CHECK(error.head<3>().norm() < 1e-3);
      CHECK(error.tail<3>().norm() < 5e-3);

      for (const Timestamp ahead : {1000, 5000}) {
        KalmanUpdate rule = moving.rule();
        Isometry3d later = moving.T_camera_marker();
        rule.extrapolate(later, t + ahead);
        const Vector6d added = error_of(later, motion(1e-6 * static_cast<double>(t + ahead))) - error;
        const double seconds = 1e-6 * static_cast<double>(ahead);
        CHECK(added.head<3>().norm() < seconds * (v_tolerance + (fades ? 0.05 : 0.01) * v.norm()));
        CHECK(added.tail<3>().norm() < seconds * (w_tolerance + (fades ? 0.05 : 0.01) * w.norm()));
        CHECK(translation_error(later, moving.T_camera_marker()) > 0.8 * seconds * v.norm());
      }
    }
}

TEST_CASE("the covariance shrinks with events and grows with time") {
  Follower fed = follower(kTruth, 10);
  ExactEvents events(54);
  const auto still = [](double) { return kTruth; };
  Vector6d before = sigmas(fed.rule().covariance());
  for (const int count : {10, 100, 1000}) {
    for (int i = 0; i < count; ++i) fed.push(events.next(kTruth), 7);  // no time passes
    const Vector6d now = sigmas(fed.rule().covariance());
    CHECK((now.array() < before.array()).all());
    before = now;
  }
  const Timestamp t = follow(fed, events, still, 1000, 7);
  KalmanUpdate rule = fed.rule();
  Isometry3d T = fed.T_camera_marker();
  before = sigmas(rule.covariance());
  for (const Timestamp ahead : {1, 1000, 10000, 100000, 1000000}) {
    rule.extrapolate(T, t + ahead);
    const Vector6d now = sigmas(rule.covariance());
    CHECK((now.array() > before.array()).all());
    before = now;
  }
  CHECK((before.array() > 10 * sigmas(fed.rule().covariance()).array()).all());
}

TEST_CASE("the covariance follows the noise of the events, which lie evenly over an edge's width or by chance") {
  const auto motion = [](double t) -> Isometry3d {
    return Eigen::Translation3d(0.02 * std::sin(9 * t), 0.02 * std::sin(7 * t), 0) * kTruth *
           Eigen::AngleAxisd(0.1 * std::sin(5 * t), Vector3d(1, 1, 1).normalized());
  };
  struct Result {
    double error_m = 0, stated_m = 0, nees = 0;  // root mean squares of the translation; its mean NEES
  };
  const auto measure = [&](bool evenly) {
    Follower fed = follower(kTruth, 100);
    ExactEvents events(75);
    std::mt19937 random(76);
    std::vector<double> last(kCode.segments.size());  // where the last event of an edge was [of its width]
    constexpr double kGoldenRatio = 0.618034;         // steps of it, modulo 1, fill a width evenly
    const auto place = [&](std::size_t segment) {
      if (!evenly) return std::uniform_real_distribution<double>(-1, 1)(random);
      last[segment] += kGoldenRatio;
      last[segment] -= std::floor(last[segment]);
      return 2 * last[segment] - 1;
    };
    Result result;
    constexpr int kEvents = 200000, kSettled = kEvents / 2, kEvery = 100;
    for (int i = 1; i <= kEvents; ++i) {
      const Timestamp t = 10 * i;
      const Isometry3d truth = motion(1e-6 * static_cast<double>(t));
      const Vector2d foot = events.next(truth);
      const Vector2d normal = ImageEdge(kCode.segments[events.segment], truth).normal;
      fed.push(foot + place(events.segment) / kFocal * normal, t);
      if (i <= kSettled || i % kEvery != 0) continue;
      const Vector3d error = fed.T_camera_marker().translation() - truth.translation();
      const Eigen::Matrix3d P = fed.rule().covariance().topLeftCorner<3, 3>();
      constexpr double kShare = static_cast<double>(kEvery) / (kEvents - kSettled);
      result.error_m += kShare * error.squaredNorm();
      result.stated_m += kShare * P.trace();
      result.nees += kShare * error.dot(P.inverse() * error) / 3;
    }
    result.error_m = std::sqrt(result.error_m);
    result.stated_m = std::sqrt(result.stated_m);
    return result;
  };
  const Result even = measure(true), by_chance = measure(false);
  for (const Result& result : {even, by_chance}) {
    MESSAGE("error " << 1e3 * result.error_m << " mm, stated " << 1e3 * result.stated_m << " mm, NEES " << result.nees);
    CHECK(result.nees > 0.6);
    CHECK(result.nees < 1.1);
  }
  CHECK(by_chance.error_m > 2 * even.error_m);
  CHECK(by_chance.stated_m > 1.5 * even.stated_m);
}

TEST_CASE("uncertainty after a pause does not depend on how often one asked meanwhile") {
  Follower fed = follower(kTruth, 10);
  ExactEvents events(55);
  const Timestamp t = follow(
      fed, events, [](double) { return kTruth; }, 5000, 0);
  KalmanUpdate once = fed.rule(), often = once;
  Isometry3d T = kTruth;
  once.extrapolate(T, t + 1000000);
  for (int i = 1; i <= 1000; ++i) often.extrapolate(T, t + 1000 * i);
  const Vector6d ratio = sigmas(once.covariance()).cwiseQuotient(sigmas(often.covariance()));
  MESSAGE("sigma after 1 s: " << sigmas(once.covariance()).transpose() << ", in steps of 1 ms "
                              << sigmas(often.covariance()).transpose());
  CHECK(ratio.maxCoeff() < 1.05);
  CHECK(ratio.minCoeff() > 0.95);
}

TEST_CASE("tracking goes on after a pause of any length") {
  for (const Timestamp pause_s : {1, 100, 10000, 1000000}) {
    CAPTURE(pause_s);
    for (const int n : {1, 10, 100}) {
      CAPTURE(n);
      Follower paused = follower(kTruth, n);
      ExactEvents events(56);
      const auto still = [](double) { return kTruth; };
      const Timestamp t = follow(paused, events, still, 5000, 0);
      follow(paused, events, still, 5000, t + 1000000 * pause_s);
      CHECK(paused.skipped_updates() == 0);
      CHECK(translation_error(paused.T_camera_marker(), kTruth) < 1e-4);
      CHECK(rotation_error(paused.T_camera_marker(), kTruth) < 1e-3);
      CHECK(least_eigenvalue(paused.rule().covariance()) > 0);
      CHECK(sigmas(paused.rule().covariance()).head<3>().maxCoeff() < 0.01);
    }
  }
}

TEST_CASE("over a hundred thousand updates the covariance stays symmetric and positive") {
  const auto sway = [](double s) {
    return perturbed(kTruth, step(0.03 * Vector3d(std::sin(9 * s), std::cos(7 * s), std::sin(5 * s)),
                                  0.2 * Vector3d(std::cos(6 * s), std::sin(8 * s), std::sin(11 * s))));
  };
  const auto sound = [](const KalmanUpdate& rule) {
    const Matrix6d covariance = rule.covariance();
    REQUIRE(covariance.allFinite());
    CHECK(covariance == covariance.transpose());
    CHECK(least_eigenvalue(covariance) > 0);
  };
  SUBCASE("in motion") {
    Follower moving = follower(sway(0), 1);
    ExactEvents events(57);
    Timestamp t = 0;
    for (int i = 0; i < 500; ++i) {
      t = follow(moving, events, sway, 200, t);
      sound(moving.rule());
    }
    CHECK(moving.skipped_updates() == 0);
    CHECK(translation_error(moving.T_camera_marker(), sway(1e-6 * static_cast<double>(t))) < 1e-3);
  }
  SUBCASE("while no time passes") {
    Follower still = follower(kTruth, 1);
    ExactEvents events(58);
    for (int i = 0; i < 100000; ++i) {
      still.push(events.next(kTruth), 5);
      if (i % 200 == 0) sound(still.rule());
    }
    CHECK(still.skipped_updates() == 0);
    CHECK(translation_error(still.T_camera_marker(), kTruth) < 1e-6);
  }
  SUBCASE("with one edge alone, which leaves most of the pose unobserved") {
    const Correspondence c = matched(kTruth, 0);
    KalmanUpdate rule({}, 1);
    Isometry3d T = kTruth;
    for (int i = 1; i <= 100000; ++i) {
      rule.add(c, T);
      REQUIRE(rule.update(T, 100 * i));
      if (i % 200 == 0) sound(rule);
    }
    CHECK(translation_error(T, kTruth) < 1e-9);
  }
}

TEST_CASE("a pause of any length leaves the covariance symmetric, and positive, and tracking exact") {
  for (const Timestamp pause : {Timestamp{60'000'000}, Timestamp{86'400'000'000}, Timestamp{1} << 52}) {
    CAPTURE(pause);
    const auto still = [](double) { return kTruth; };
    Follower rested = follower(kTruth, 1);
    ExactEvents events(63);
    Timestamp t = follow(rested, events, still, 2000, 0);
    for (int round = 0; round < 20; ++round) {
      t = follow(rested, events, still, 200, t + pause);
      const Matrix6d covariance = rested.rule().covariance();
      REQUIRE(covariance.allFinite());
      CHECK(covariance == covariance.transpose());
      CHECK(least_eigenvalue(covariance) > 0);
    }
    CHECK(translation_error(rested.T_camera_marker(), kTruth) < 1e-4);
  }
}

TEST_CASE("after a pause of any length the covariance is definite, however little the next events say") {
  for (const Timestamp pause :
       {Timestamp{60'000'000}, Timestamp{86'400'000'000}, Timestamp{1} << 44, Timestamp{1} << 52})
    for (const int n : {1, 3, 10}) {
      CAPTURE(pause);
      CAPTURE(n);
      Follower rested = follower(kTruth, n);
      ExactEvents events(64);
      Timestamp t = follow(
          rested, events, [](double) { return kTruth; }, 2000, 0);
      t += pause;
      for (int i = 0; i < 300; ++i) {
        Vector2d event = events.next(kTruth);
        while (i < 200 && events.segment != 0) event = events.next(kTruth);  // at first of one edge
        rested.push(event, t + i);
        const Vector6d free_of_units = sigmas(rested.rule().covariance()).cwiseInverse();
        const Matrix6d correlation =
            free_of_units.asDiagonal() * rested.rule().covariance() * free_of_units.asDiagonal();
        CHECK(least_eigenvalue(correlation) > -1e-9);
      }
    }
}

TEST_CASE("forward and backward over the same events returns to the start") {
  const Trajectory motion = trajectory::linear(kTruth, {0.25, -0.15, 0.2}, {0.8, -0.6, 1.5});
  for (const int n : {1, 10, 100}) {
    CAPTURE(n);
    Follower there = follower(motion(0), n);
    ExactEvents events(59);
    const Timestamp settled = follow(there, events, motion, 5000, 0);
    struct Sight {
      Vector2d m;
      Timestamp t;
    };
    std::vector<Sight> sights;
    for (Timestamp t = settled + 10; t <= settled + 100000; t += 10) {
      sights.push_back({events.next(motion(1e-6 * static_cast<double>(t))), t});
      there.push(sights.back().m, t);
    }
    const Timestamp end = sights.back().t;
    REQUIRE(translation_error(there.T_camera_marker(), motion(1e-6 * static_cast<double>(settled))) > 0.02);

    Follower back = there;
    back.reverse();
    CHECK(back.rule().twist() == -there.rule().twist());
    CHECK(back.T_camera_marker().matrix() == there.T_camera_marker().matrix());
    CHECK((back.rule().covariance() - there.rule().covariance()).norm() < 1e-9 * there.rule().covariance().norm());
    for (auto sight = sights.rbegin(); sight != sights.rend(); ++sight) back.push(sight->m, end + (end - sight->t));
    const Isometry3d start = motion(1e-6 * static_cast<double>(settled));
    MESSAGE("came back to within " << 1e3 * translation_error(back.T_camera_marker(), start) << " mm");
    CHECK(translation_error(back.T_camera_marker(), start) < 1e-3);
    CHECK(rotation_error(back.T_camera_marker(), start) < 5e-3);

    // Twice reversed is not reversed.
    KalmanUpdate twice = there.rule();
    twice.reverse();
    twice.reverse();
    Isometry3d a = kTruth, b = kTruth;
    KalmanUpdate once = there.rule();
    twice.extrapolate(a, end + 5000);
    once.extrapolate(b, end + 5000);
    CHECK((a.matrix() - b.matrix()).norm() < 1e-12);
    CHECK((twice.covariance() - once.covariance()).norm() < 1e-9 * once.covariance().norm());
  }
}

TEST_CASE("reversing forgets the events that were collected") {
  KalmanUpdate rule({}, 10);
  Isometry3d T = kTruth;
  rule.add(matched(T), T);
  rule.reverse();
  REQUIRE(rule.update(T, 5));
  CHECK(translation_error(T, kTruth) < 1e-15);
}

TEST_CASE("time that stands still or goes back does no harm") {
  const Trajectory motion = trajectory::linear(kTruth, {0.25, -0.15, 0.2}, {0.8, -0.6, 1.5});
  for (const Timestamp glitch : {Timestamp{0}, Timestamp{-1}, Timestamp{-1000}, Timestamp{-1000000}}) {
    CAPTURE(glitch);
    Follower moving = follower(kTruth, 10);
    ExactEvents events(60);
    Timestamp t = 0;
    for (int i = 1; i <= 20000; ++i) {
      t += 10;
      const bool stutters = i > 5000 && i <= 10000 && i % 100 == 0;
      moving.push(events.next(motion(1e-6 * static_cast<double>(t))), stutters ? t + glitch : t);
      REQUIRE(moving.T_camera_marker().matrix().allFinite());
    }
    CHECK(moving.skipped_updates() == 0);
    CHECK(translation_error(moving.T_camera_marker(), motion(1e-6 * static_cast<double>(t))) < 1e-3);
    CHECK(least_eigenvalue(moving.rule().covariance()) > 0);
  }
  // A clock that starts anew.
  Follower restarted = follower(kTruth, 10);
  ExactEvents events(60);
  const Timestamp t = follow(restarted, events, motion, 10000, 0);
  const Isometry3d reached = motion(1e-6 * static_cast<double>(t));
  follow(restarted, events, trajectory::linear(reached, {0.25, -0.15, 0.2}, {0.8, -0.6, 1.5}), 5000, 0);
  CHECK(translation_error(restarted.T_camera_marker(), motion(0.15)) < 1e-3);
  // The pose at a past time is the present.
  KalmanUpdate rule = restarted.rule();
  Isometry3d T = restarted.T_camera_marker();
  rule.extrapolate(T, -1000000);
  CHECK(translation_error(T, restarted.T_camera_marker()) < 1e-12);
  // The ends of all time.
  for (const Timestamp extreme : {std::numeric_limits<Timestamp>::min(), std::numeric_limits<Timestamp>::max()}) {
    KalmanUpdate far = restarted.rule();
    Isometry3d there = restarted.T_camera_marker();
    far.extrapolate(there, extreme);
    far.extrapolate(there, -(extreme / 2));
    far.extrapolate(there, extreme);
    CHECK(there.matrix().allFinite());
  }
}

TEST_CASE("an update without events only lets time pass") {
  const Trajectory motion = trajectory::linear(kTruth, {0.25, -0.15, 0.2}, {0.8, -0.6, 1.5});
  Follower moving = follower(kTruth, 100);
  ExactEvents events(61);
  const Timestamp t = follow(moving, events, motion, 10000, 0);
  KalmanUpdate updated = moving.rule(), extrapolated = moving.rule();
  Isometry3d a = moving.T_camera_marker(), b = a;
  REQUIRE(updated.update(a, t + 3000));
  extrapolated.extrapolate(b, t + 3000);
  CHECK(translation_error(b, moving.T_camera_marker()) > 5e-4);
  CHECK((a.matrix() - b.matrix()).norm() < 1e-12);
  CHECK((updated.covariance() - extrapolated.covariance()).norm() < 1e-6 * extrapolated.covariance().norm());
}

TEST_CASE("numbers that are none never reach the pose, and the rule recovers from them") {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  const auto still = [](double) { return kTruth; };
  Follower fed = follower(kTruth, 10);
  ExactEvents events(62);
  const Timestamp t = follow(fed, events, still, 2000, 0);
  for (const double bad : {nan, infinity, -infinity, 1e300, -1e160, 1e100, 1e20})
    for (int field = 0; field < 7; ++field)
      for (const bool fresh : {true, false}) {
        CAPTURE(bad);
        CAPTURE(field);
        CAPTURE(fresh);
        Correspondence c = matched(kTruth);
        (field == 0 ? c.distance_px : field < 4 ? c.gradient(field - 1) : c.E(field - 4)) = bad;
        KalmanUpdate rule = fresh ? KalmanUpdate({}, 10) : fed.rule();
        Isometry3d T = kTruth;
        rule.add(matched(kTruth), T);
        rule.add(c, T);
        const Isometry3d before = T;
        if (!rule.update(T, t + 10)) CHECK((T.matrix() - before.matrix()).norm() < 1e-6);  // only predicted
        REQUIRE(T.matrix().allFinite());
        // What is not finite is as if it had never been.
        if (std::isfinite(bad)) continue;
        KalmanUpdate healthy = fresh ? KalmanUpdate({}, 10) : fed.rule();
        Isometry3d expected = kTruth;
        healthy.add(matched(kTruth), expected);
        REQUIRE(healthy.update(expected, t + 10));
        CHECK((T.matrix() - expected.matrix()).norm() < 1e-12);
        rule.add(matched(T), T);
        CHECK(rule.update(T, t + 20));
        CHECK(T.matrix().allFinite());
      }
}

TEST_CASE("rotations stay rotations, and copies are independent") {
  const Trajectory motion = trajectory::spin(kTruth, {0, 0, 1}, 6);
  Follower turning = follower(kTruth, 1);
  ExactEvents events(63);
  const Timestamp t = follow(turning, events, motion, 50000, 0);
  const Eigen::Matrix3d R = turning.T_camera_marker().linear();
  CHECK((R.transpose() * R - Eigen::Matrix3d::Identity()).norm() < 1e-13);
  CHECK(rotation_error(turning.T_camera_marker(), motion(1e-6 * static_cast<double>(t))) < 0.02);

  Follower copy = turning;
  const Isometry3d before = turning.T_camera_marker();
  follow(turning, events, motion, 1000, t);
  CHECK(copy.T_camera_marker().matrix() == before.matrix());
  CHECK(turning.T_camera_marker().matrix() != before.matrix());
}

TEST_CASE("impossible settings of the Kalman update are refused with field and value") {
  const auto message_of = [](const KalmanSettings& settings, int events_per_update = 100) -> std::string {
    try {
      const KalmanUpdate rule(settings, events_per_update);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  CHECK(message_of({}) == "accepted");
  const std::vector<std::pair<std::string, double KalmanSettings::*>> fields{
      {"inflation", &KalmanSettings::inflation},
      {"robust_px", &KalmanSettings::robust_px},
      {"acceleration_noise", &KalmanSettings::acceleration_noise},
      {"turning_distance_m", &KalmanSettings::turning_distance_m},
      {"velocity_memory_s", &KalmanSettings::velocity_memory_s},
      {"confirmed_velocity_memory_s", &KalmanSettings::confirmed_velocity_memory_s},
      {"offset_drift_px", &KalmanSettings::offset_drift_px},
      {"rotation_share", &KalmanSettings::rotation_share},
      {"latency_s", &KalmanSettings::latency_s},
      {"latency_sigma_s", &KalmanSettings::latency_sigma_s},
      {"initial_sigma_t_m", &KalmanSettings::initial_sigma_t_m},
      {"initial_sigma_r_rad", &KalmanSettings::initial_sigma_r_rad},
      {"initial_sigma_v_m_s", &KalmanSettings::initial_sigma_v_m_s},
      {"initial_sigma_w_rad_s", &KalmanSettings::initial_sigma_w_rad_s},
      {"initial_sigma_offset_px", &KalmanSettings::initial_sigma_offset_px},
      {"initial_sigma_trail_px", &KalmanSettings::initial_sigma_trail_px},
      {"initial_sigma_off_delay_s", &KalmanSettings::initial_sigma_off_delay_s},
      {"initial_trail_px", &KalmanSettings::initial_trail_px}};
  static_assert(sizeof(KalmanSettings) == 18 * sizeof(double));  // none is left out
  for (const auto& [name, field] : fields)
    for (const auto& [value, text] : {std::pair{-2.0, "-2"},
                                      {std::numeric_limits<double>::quiet_NaN(), "nan"},
                                      {std::numeric_limits<double>::infinity(), "inf"}}) {
      KalmanSettings settings;
      settings.*field = value;
      CHECK(message_of(settings) == "kalman update: " + name + " is " + text);
    }
  CHECK(message_of({}, 0) == "kalman update: events_per_update is 0");
  CHECK(message_of({}, -5) == "kalman update: events_per_update is -5");
}

TEST_CASE("the rule tells which share of the events is of moving edges: those whose polarities fit its motion") {
  const Vector3d velocity(0.3, 0.1, 0);
  const auto motion = [&](double s) {
    Isometry3d T = kTruth;
    T.translation() += s * velocity;
    return T;
  };
  // What it tells after events of such polarities, and whether it has been told of a background since.
  const auto moving_share = [&](bool fitting, bool told) {
    SegmentMatcher matcher(kCode, kFocal);
    KalmanUpdate rule({}, 10);
    ExactEvents events(45);
    std::mt19937 random(46);
    Isometry3d T = kTruth;
    Timestamp t = 0;
    for (int i = 0; i < 400; ++i) {
      t += 20;
      REQUIRE(matcher.project(T));
      const Isometry3d now = motion(1e-6 * static_cast<double>(t));
      Correspondence c;
      const Vector2d m = events.next(now);
      if (matcher.match(m, c) != MatchResult::matched) continue;
      const ImageEdge edge(kCode.segments[events.segment], now),
          later(kCode.segments[events.segment], motion(1e-6 * static_cast<double>(t) + 1e-3));
      c.t = t;
      c.polarity = (fitting ? edge.distance(later.from) > 0 : random() % 2 == 0) ? 1 : -1;
      rule.add(c, T);
      if (i % 10 == 9) rule.update(T, t);
    }
    REQUIRE(translation_error(T, motion(1e-6 * static_cast<double>(t))) < 1e-3);
    if (told) rule.set_background({});
    return rule.moving_share();
  };
  CHECK(moving_share(true, false).least > 0.7);
  CHECK(moving_share(true, false).likely > 0.8);
  CHECK(moving_share(false, false).least < 0.05);
  CHECK(moving_share(true, true).least == 0);
}
