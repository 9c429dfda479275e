#include "evmarker/model/board.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "boards.hpp"
#include "evmarker/detection/board_detector.hpp"
#include "evmarker/matching/grid_matcher.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "simulated.hpp"

using namespace evmarker;
using namespace evmarker::boards;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kPi = std::numbers::pi;

// A detector that finds what it is reported.
struct ToldDetector {
  double length;
  std::vector<MarkerDetection> found;

  std::vector<MarkerDetection> detect(const PolarityFrame&) { return found; }
  MarkerModel model(MarkerId id) { return make_code_marker(length, opencv::marker_bits(kDictionary, id)); }
};

MarkerDetection detection(MarkerId id, const Isometry3d& T_camera_marker) {
  return {.id = id, .t = 5, .T_camera_marker = T_camera_marker};
}

// The other pose in which a square looks nearly the same: its tilt mirrored about the line of sight.
Isometry3d other_tilt(Isometry3d T) {
  const Vector3d sight = T.translation().normalized(), normal = T.linear().col(2);
  const Vector3d other = 2 * normal.dot(sight) * sight - normal;
  T.linear() = Eigen::Quaterniond::FromTwoVectors(normal, other).toRotationMatrix() * T.linear();
  return T;
}

double angle_deg(const Isometry3d& a, const Isometry3d& b) {
  return geodesic_angle(a.linear(), b.linear()) * 180 / kPi;
}

}  // namespace

TEST_CASE("a board's wireframe is that of its markers, each in its place and seen from its front") {
  const Board board = corner();
  const MarkerModel model = make_board_model(board), one = make_code_marker(0.05, board.markers[0].bits);
  std::size_t segments = 0;
  for (const BoardMarker& m : board.markers) segments += make_code_marker(m.length, m.bits).segments.size();
  REQUIRE(model.segments.size() == segments);
  CHECK_NOTHROW(validate(model));
  // Marker 11 looks along x: its right is the board's y, its up the board's z.
  for (std::size_t i = 0; i < one.segments.size(); ++i) {
    const Vector3d there = one.vertices[static_cast<std::size_t>(one.segments[i].to)];
    const Vector3d here = model.vertices[static_cast<std::size_t>(model.segments[i].to)];
    CHECK((here - Vector3d(0.04, there.x(), there.y())).norm() < 1e-15);
    CHECK(model.segments[i].face_normal == Vector3d::UnitX());
    CHECK(model.segments[i].dark_side == Vector3d(0, one.segments[i].dark_side.x(), one.segments[i].dark_side.y()));
  }
  CHECK(model.segments.back().face_normal == Vector3d::UnitZ());
  for (const MarkerSegment& segment : model.segments)
    CHECK(segment.dark_side.dot(model.vertices[static_cast<std::size_t>(segment.from)] -
                                model.vertices[static_cast<std::size_t>(segment.to)]) == doctest::Approx(0));
}

TEST_CASE("a board that cannot be is refused with board, marker and value") {
  const auto refused = [](const Board& board) -> std::string {
    try {
      make_board_model(board);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  CHECK(refused(plate()) == "accepted");
  CHECK(refused({7, {}}) == "board 7 has no markers");
  Board twice = plate();
  twice.markers[3].id = 2;
  CHECK(refused(twice) == "board 100: marker 2 is there twice");
  Board no_number = plate();
  no_number.markers[1].T_board_marker.translation().x() = std::numeric_limits<double>::quiet_NaN();
  CHECK(refused(no_number) == "board 100: marker 2: T_board_marker is not finite");
  Board mirror = plate();
  mirror.markers[0].T_board_marker.linear() *= -1;
  CHECK(refused(mirror) == "board 100: marker 1: T_board_marker is no rotation and translation");
  Board flat = plate();
  flat.markers[0].length = 0;
  CHECK(refused(flat).ends_with("not 0"));
}

TEST_CASE("edges on a side that is turned away match no event, and those that are on no side match from everywhere") {
  const double f = simulated::camera.focal_length();
  MarkerModel code = make_code_marker(0.1, simulated::code());
  const Isometry3d front = facing_pose({0, 0, 0.5}, {0.4, 0.2, 0.1}),
                   back = front * pose(so3_exp({0, kPi, 0}), {0, 0, 0});
  const Vector3d on_outline(0, 0.05, 0);
  SegmentMatcher matcher(code, f);
  Correspondence c;
  REQUIRE(matcher.project(front));
  CHECK(matcher.match((front * on_outline).hnormalized(), c) == MatchResult::matched);
  CHECK_FALSE(matcher.project(back));
  CHECK(matcher.match((back * on_outline).hnormalized(), c) == MatchResult::far);
  GridMatcher grid(code, f);
  CHECK(grid.project(front));
  CHECK_FALSE(grid.project(back));
  CHECK(grid.match((back * on_outline).hnormalized(), c) == MatchResult::far);

  for (MarkerSegment& segment : code.segments) segment.face_normal.setZero();
  SegmentMatcher see_through(code, f);
  REQUIRE(see_through.project(back));
  CHECK(see_through.match((back * on_outline).hnormalized(), c) == MatchResult::matched);

  // Turned by 70 deg about the axis that carries it away, side x shows its back; y and z are seen.
  const MarkerModel cube = make_board_model(corner());
  const Isometry3d ahead = corner_ahead(0.5);
  const Vector3d side_x = ahead.linear().col(0);
  const Isometry3d turned = pose(
      so3_exp(70 / 180.0 * kPi * Vector3d::UnitZ().cross(-side_x).normalized()) * ahead.linear(), ahead.translation());
  SegmentMatcher sides(cube, f);
  for (const Isometry3d& T : {ahead, turned}) {
    REQUIRE(sides.project(T));
    int matched[3] = {}, beside[3] = {};
    for (const MarkerSegment& edge : cube.segments) {
      const Vector3d middle =
          0.5 * (cube.vertices[static_cast<std::size_t>(edge.from)] + cube.vertices[static_cast<std::size_t>(edge.to)]);
      const auto side = static_cast<std::size_t>(edge.face_normal.x() > 0.5 ? 0 : edge.face_normal.y() > 0.5 ? 1 : 2);
      if (sides.match((T * middle).hnormalized(), c) != MatchResult::matched) continue;
      const bool same = cube.segments[static_cast<std::size_t>(c.segment)].face_normal == edge.face_normal;
      ++(same ? matched : beside)[side];
    }
    const bool hidden = &T != &ahead && T.linear().col(0).dot(T * Vector3d(0.04, 0, 0)) > 0;
    CHECK((hidden ? matched[0] == 0 : matched[0] > 12));
    CHECK(matched[1] > 12);
    CHECK(matched[2] > 12);
  }
  REQUIRE(turned.linear().col(0).dot(turned * Vector3d(0.04, 0, 0)) > 0);
}

TEST_CASE("detections of a board's markers become one of the board, others pass") {
  const Isometry3d truth = facing_pose({0.02, -0.01, 0.6}, {0.5, 0.3, 0.2});
  const PolarityFrame frame({640, 480});
  const Board board = plate();
  const auto at = [&](std::size_t i) { return truth * board.markers[i].T_board_marker; };
  const auto boards_in = [&](std::vector<MarkerDetection> found, double length = 0.04) {
    BoardDetector detector(simulated::camera, ToldDetector{length, std::move(found)}, {board});
    return detector.detect(frame);
  };
  CHECK(boards_in({}).empty());

  const auto one = boards_in({detection(30, truth), detection(3, at(2))});
  REQUIRE(one.size() == 2);
  CHECK(one[0].id == 30);
  CHECK(one[0].T_camera_marker.matrix() == truth.matrix());
  CHECK(one[1].id == kId);
  CHECK(one[1].t == 5);
  CHECK(one[1].T_camera_marker.isApprox(truth, 1e-12));
  CHECK_FALSE(one[1].T_camera_marker_alternative);
  // The rectangle around the outermost corners of all four markers.
  Vector2d low(1e9, 1e9), high(-1e9, -1e9);
  for (const double x : {-0.055, 0.055})
    for (const double y : {-0.055, 0.055}) {
      low = low.cwiseMin(simulated::camera.project(truth * Vector3d(x, y, 0)));
      high = high.cwiseMax(simulated::camera.project(truth * Vector3d(x, y, 0)));
    }
  CHECK((one[1].corners_px[0] - low).norm() < 1e-9);
  CHECK((one[1].corners_px[2] - high).norm() < 1e-9);
  CHECK((one[1].corners_px[1] - Vector2d(high.x(), low.y())).norm() < 1e-9);

  // Found as if 10 cm wide: 2.5 times as far away.
  Isometry3d farther = at(1);
  farther.translation() *= 2.5;
  const auto scaled = boards_in({detection(2, farther)}, 0.10);
  REQUIRE(scaled.size() == 1);
  CHECK(scaled[0].T_camera_marker.isApprox(truth, 1e-12));

  // One marker alone leaves its two poses; with a second the mirrored ones do not fit, though both are reported first.
  MarkerDetection first = detection(1, other_tilt(at(0))), second = detection(4, other_tilt(at(3)));
  first.T_camera_marker_alternative = at(0);
  second.T_camera_marker_alternative = at(3);
  REQUIRE(angle_deg(first.T_camera_marker, at(0)) > 30);
  const auto undecided = boards_in({first});
  REQUIRE(undecided.size() == 1);
  REQUIRE(undecided[0].T_camera_marker_alternative);
  CHECK(undecided[0].T_camera_marker_alternative->isApprox(truth, 1e-12));
  const auto decided = boards_in({first, second, detection(2, at(1))});
  REQUIRE(decided.size() == 1);
  CHECK(angle_deg(decided[0].T_camera_marker, truth) < 5);
  CHECK((decided[0].T_camera_marker.translation() - truth.translation()).norm() < 0.01);

  // Errors of single markers average out: each 2 deg and 3 mm off, another way.
  std::vector<MarkerDetection> off;
  for (std::size_t i = 0; i < 4; ++i) {
    const double angle = kPi / 2 * static_cast<double>(i);
    Isometry3d T = at(i);
    T.linear() = so3_exp(0.035 * Vector3d(std::cos(angle), std::sin(angle), 0)) * T.linear();
    T.translation().z() += i % 2 == 0 ? 0.003 : -0.003;
    off.push_back(detection(static_cast<MarkerId>(i) + 1, T));
  }
  const auto joint = boards_in(off);
  REQUIRE(joint.size() == 1);
  CHECK(angle_deg(joint[0].T_camera_marker, truth) < 0.7);
  CHECK((joint[0].T_camera_marker.translation() - truth.translation()).norm() < 0.0015);

  // A pose from which no tracker could start.
  CHECK(boards_in({detection(1, facing_pose({0, 0, 0.01}, {1.2, 0, 0}))}).empty());
}

TEST_CASE("a board that is tracked is looked for by its markers where they must be, of the size that is assumed") {
  struct Guided : ToldDetector {
    std::vector<PlacedMarker>* where;
    std::vector<MarkerDetection> detect(const PolarityFrame&, std::span<const PlacedMarker> tracked) {
      where->assign(tracked.begin(), tracked.end());
      return found;
    }
    using ToldDetector::detect;
    std::vector<MarkerId> ids() const { return {0, 1, 2, 3, 4}; }
  };
  static_assert(CheckingDetector<BoardDetector<ToldDetector>> && !CheckingDetector<ToldDetector>);
  static_assert(!GuidedDetector<BoardDetector<ToldDetector>>);
  static_assert(GuidedDetector<BoardDetector<Guided>>);
  static_assert(EnumeratingDetector<BoardDetector<Guided>>);
  const Board board = plate();
  const Isometry3d truth = facing_pose({0.02, -0.01, 0.6}, {0.5, 0.3, 0.2}), other = facing_pose({0.1, 0, 0.5});
  // One of half the length looks the same at half the distance.
  const double assumed = 0.5 * board.markers[0].length;
  const auto as_assumed = [&](const BoardMarker& marker) {
    Isometry3d T = truth * marker.T_board_marker;
    T.translation() *= assumed / marker.length;
    return T;
  };
  std::vector<MarkerDetection> seen{detection(0, other)};
  for (const BoardMarker& marker : board.markers) seen.push_back(detection(marker.id, as_assumed(marker)));
  std::vector<PlacedMarker> asked;
  BoardDetector boards(simulated::camera, Guided{{assumed, seen}, &asked}, {board});
  CHECK(boards.ids() == std::vector<MarkerId>{0, board.id});

  const std::vector<PlacedMarker> tracked{{board.id, truth}, {0, other}};
  // At their tracked places they would fit the board's file in any case.
  for (int frame_number = 0; frame_number < 3; ++frame_number) {
    boards.detect(PolarityFrame({640, 480}), tracked);
    CHECK(asked.size() == 1);
    CHECK(boards.checking() == (frame_number < 2));
  }
  const auto found = boards.detect(PolarityFrame({640, 480}), tracked);
  REQUIRE(asked.size() == board.markers.size() + 1);
  for (std::size_t i = 0; i < board.markers.size(); ++i) {
    CHECK(asked[i].id == board.markers[i].id);
    CHECK(asked[i].T_camera_marker.isApprox(as_assumed(board.markers[i]), 1e-12));
  }
  CHECK(asked.back().T_camera_marker.isApprox(other, 1e-12));
  REQUIRE(found.size() == 2);
  CHECK(found[0].id == 0);
  CHECK(found[1].id == board.id);
  CHECK(found[1].T_camera_marker.isApprox(truth, 1e-9));
}

TEST_CASE(
    "a board that is seen otherwise than its file says is refused with a word about it, and one that fits is not") {
  const Isometry3d truth = facing_pose({0.02, -0.01, 0.6}, {0.5, 0.3, 0.2});
  const PolarityFrame frame({640, 480});
  std::vector<MarkerDetection> seen;
  for (const BoardMarker& m : plate().markers) seen.push_back(detection(m.id, truth * m.T_board_marker));
  std::vector<BoardContradiction> reported;
  const auto detector_of = [&](const Board& file) {
    reported.clear();
    return BoardDetector(simulated::camera, ToldDetector{0.04, seen}, {file},
                         [&](const BoardContradiction& contradiction) { reported.push_back(contradiction); });
  };
  Board turned = plate(), stretched = plate(), renumbered = plate(), tight = plate();
  for (BoardMarker& m : turned.markers) m.T_board_marker.translation() *= -1;
  for (BoardMarker& m : stretched.markers) m.T_board_marker.translation() *= 1.2;
  std::swap(renumbered.markers[0].id, renumbered.markers[1].id);
  // The best fit leaves no corner 2 px off.
  for (BoardMarker& m : tight.markers) m.T_board_marker.translation() *= 0.93;
  const std::vector<Board> wrongs{turned, stretched, renumbered, tight};
  for (const Board& wrong : wrongs) {
    auto detector = detector_of(wrong);
    for (int frame_number = 0; frame_number < 10; ++frame_number) {
      CHECK(detector.detect(frame).empty());
      CHECK(detector.checking());
    }
    CHECK(detector.refused() == std::vector<MarkerId>{kId});
    REQUIRE(reported.size() == 1);
    CHECK(reported[0].board == kId);
    CHECK((reported[0].seen - reported[0].in_file).norm() > (&wrong == &wrongs.back() ? 0.006 : 0.01));
    const auto place = [&](const Board& board, MarkerId id) {
      return Vector3d(std::ranges::find(board.markers, id, &BoardMarker::id)->T_board_marker.translation());
    };
    CHECK((reported[0].seen - (place(plate(), reported[0].other) - place(plate(), reported[0].marker))).norm() < 1e-9);
    CHECK((reported[0].in_file - (place(wrong, reported[0].other) - place(wrong, reported[0].marker))).norm() < 1e-9);
    CHECK(reported[0].message().find("board 100 does not fit its file: marker ") == 0);
  }
  CHECK(std::abs(reported[0].marker_scale - 0.93) < 0.002);
  CHECK_MESSAGE(reported[0].message().ends_with("; against their distances its markers are 7.1 % smaller than there"),
                reported[0].message());
  auto detector = detector_of(plate());
  for (int frame_number = 0; frame_number < 10; ++frame_number) CHECK(detector.detect(frame).size() == 1);
  CHECK_FALSE(detector.checking());
  CHECK(detector.refused().empty());
  CHECK(reported.empty());
}

TEST_CASE("one marker cannot contradict its board, but is not enough once others have") {
  Board turned = plate();
  for (BoardMarker& m : turned.markers) m.T_board_marker.translation() *= -1;
  // Sees one marker, then three times two, then one.
  struct {
    int* frame_number;
    std::vector<MarkerDetection> detect(const PolarityFrame&) const {
      const Isometry3d truth = facing_pose({0.02, -0.01, 0.6}, {0.5, 0.3, 0.2});
      std::vector<MarkerDetection> seen;
      for (const BoardMarker& m : plate().markers) seen.push_back(detection(m.id, truth * m.T_board_marker));
      seen.resize(*frame_number > 0 && *frame_number < 4 ? 2 : 1);
      return seen;
    }
    MarkerModel model(MarkerId id) const { return make_code_marker(0.04, opencv::marker_bits(kDictionary, id)); }
  } one_then_two;
  int frame_number = 0, reported = 0;
  one_then_two.frame_number = &frame_number;
  BoardDetector detector(simulated::camera, one_then_two, {turned}, [&](const BoardContradiction&) { ++reported; });
  const PolarityFrame frame({640, 480});
  CHECK(detector.detect(frame).size() == 1);
  for (frame_number = 1; frame_number < 6; ++frame_number) CHECK(detector.detect(frame).empty());
  CHECK(reported == 1);
}

TEST_CASE("frames that contradict now and then do not refuse a board, three more than agree do, and it may come back") {
  BoardCheck check;
  for (int i = 0; i < 60; ++i) {
    check.add(i % 3 == 0);
    CHECK_FALSE(check.refused());
    CHECK(check.doubtful() == (i % 3 == 0));
  }
  BoardCheck wrong;
  for (int i = 0; i < 3; ++i) {
    CHECK_FALSE(wrong.refused());
    wrong.add(true);
  }
  CHECK(wrong.refused());
  wrong.add(false);
  CHECK(wrong.refused());
  for (int i = 0; i < 4; ++i) wrong.add(false);
  CHECK_FALSE(wrong.refused());
  CHECK_FALSE(wrong.settled());
  wrong.add(false);
  CHECK(wrong.settled());
}

TEST_CASE("a board detector verifies and searches boards by their markers, if the other detector does, and markers") {
  // Knows where each marker truly is, in its own size.
  struct Seeing : ToldDetector {
    const MarkerDetection* find(MarkerId id, const Isometry3d& T) const {
      const auto is_here = [&](const MarkerDetection& d) {
        return d.id == id && (d.T_camera_marker.translation() - T.translation()).norm() < 0.005;
      };
      const auto here = std::ranges::find_if(found, is_here);
      return here != found.end() ? &*here : nullptr;
    }
    bool shows(MarkerId id, const Isometry3d& T) const { return find(id, T) != nullptr; }
    std::optional<MarkerDetection> search(MarkerId id, const Isometry3d& T) const {
      const MarkerDetection* const here = find(id, T);
      return here ? std::optional(*here) : std::nullopt;
    }
  };
  static_assert(VerifyingDetector<BoardDetector<Seeing>> && SearchingDetector<BoardDetector<Seeing>>);
  static_assert(!VerifyingDetector<BoardDetector<ToldDetector>> && !SearchingDetector<BoardDetector<ToldDetector>>);
  const Isometry3d truth = facing_pose({0.02, -0.01, 0.6}, {0.5, 0.3, 0.2}), elsewhere = facing_pose({0.1, 0.1, 0.8});
  const Board board = plate();
  const double length = 2 * board.markers[2].length;  // half as large as assumed, so it seems twice as far away
  Isometry3d seen = truth * board.markers[2].T_board_marker;
  seen.translation() *= 2;
  BoardDetector detector(simulated::camera,
                         Seeing{{length, {detection(board.markers[2].id, seen), detection(30, elsewhere)}}}, {board});
  CHECK(detector.shows(kId, truth));
  CHECK_FALSE(detector.shows(kId, elsewhere));
  CHECK(detector.shows(30, elsewhere));
  CHECK_FALSE(detector.shows(30, truth));
  Isometry3d near_truth = truth;
  near_truth.translation().x() += 0.001;
  const auto found = detector.search(kId, near_truth);
  REQUIRE(found);
  CHECK(found->id == kId);
  CHECK(found->T_camera_marker.isApprox(truth, 1e-9));
  CHECK_FALSE(detector.search(kId, elsewhere));
  REQUIRE(detector.search(30, elsewhere));
  CHECK(detector.search(30, elsewhere)->id == 30);
}

TEST_CASE("a board detector finds boards and markers by their ids, and refuses boards that share one") {
  const ToldDetector reported{0.04, {}};
  const auto opened = [&](std::vector<Board> boards) { return BoardDetector(simulated::camera, reported, boards); };
  BoardDetector detector = opened({plate()});
  CHECK(detector.model(kId).segments.size() == make_board_model(plate()).segments.size());
  CHECK(detector.model(7).segments.size() == ToldDetector(reported).model(7).segments.size());
  Board other = corner();
  CHECK_THROWS_WITH_AS(opened({plate(), other}), "board 100 is there twice", std::invalid_argument);
  other.id = 101;
  CHECK_NOTHROW(opened({plate(), other}));
  other.markers[0].id = 3;
  CHECK_THROWS_WITH_AS(opened({plate(), other}), "marker 3 is on board 100 and on board 101", std::invalid_argument);
  CHECK_THROWS_WITH_AS(opened({{100, {}}}), "board 100 has no markers", std::invalid_argument);
}
