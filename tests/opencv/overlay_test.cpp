#include "evmarker/opencv/overlay.hpp"

#include <doctest/doctest.h>

#include <chrono>
#include <string>
#include <vector>

using namespace evmarker;

namespace {

const PinholeCamera kBarrelCamera{{320, 240}, 260,   260,
                                  159.5,      119.5, BrownConradyDistortion{-0.3, 0.1, 0.001, -0.002, 0}};

Eigen::Isometry3d facing(double x, double y, double z) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = Eigen::Vector3d(1, -1, -1).asDiagonal();
  T.translation() << x, y, z;
  return T;
}

bool has_color(const cv::Mat& picture, cv::Point at, int radius, const cv::Scalar& wanted, double tolerance) {
  const cv::Rect around(at.x - radius, at.y - radius, 2 * radius + 1, 2 * radius + 1);
  const cv::Mat patch = picture(around & cv::Rect({}, picture.size()));
  for (int y = 0; y < patch.rows; ++y)
    for (int x = 0; x < patch.cols; ++x) {
      const cv::Vec3b c = patch.at<cv::Vec3b>(y, x);
      if (cv::norm(cv::Vec3d(c[0] - wanted[0], c[1] - wanted[1], c[2] - wanted[2])) <= tolerance) return true;
    }
  return false;
}

int changed(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat difference;
  cv::absdiff(a, b, difference);
  return cv::countNonZero(difference.reshape(1));
}

}  // namespace

TEST_CASE("a frame shows ON, OFF and untouched in three colours, enlarged without smoothing") {
  PolarityFrame frame({8, 6});
  frame.update({1, 2, 1, 10});
  frame.update({3, 4, 0, 11});
  for (const int scale : {1, 4}) {
    const cv::Mat picture = opencv::draw_frame(frame, scale);
    REQUIRE(picture.size() == cv::Size(8 * scale, 6 * scale));
    CHECK(has_color(picture, {1 * scale + scale / 2, 2 * scale + scale / 2}, 0, opencv::color::kOn, 1));
    CHECK(has_color(picture, {3 * scale + scale / 2, 4 * scale + scale / 2}, 0, opencv::color::kOff, 1));
    CHECK(changed(picture, opencv::make_picture({8, 6}, scale)) == 2 * 3 * scale * scale);
    cv::Mat events = opencv::make_picture({8, 6}, scale);
    opencv::draw_events(events, {8, 6}, std::vector<Event>{{1, 2, 1, 10}, {3, 4, 0, 11}, {8, 0, 1, 12}, {0, 6, 1, 13}});
    CHECK(changed(picture, events) == 0);
  }
}

TEST_CASE("events fade with their age until they are gone") {
  PolarityFrame frame({8, 6});
  frame.update({1, 2, 1, 1000});
  frame.update({3, 2, 1, 31000});
  frame.update({5, 2, 1, 61000});
  frame.update({7, 2, 0, 61000});
  const auto at = [](const cv::Mat& picture, int x) { return picture.at<cv::Vec3b>(2, x); };
  const cv::Mat staying = opencv::draw_frame(frame),
                fading = opencv::draw_frame(frame, 1, std::chrono::milliseconds(60));
  CHECK(at(staying, 1) == at(staying, 5));
  CHECK(at(fading, 5) == at(staying, 5));
  CHECK(at(fading, 7) == at(staying, 7));
  CHECK(at(fading, 3)[0] < at(fading, 5)[0]);
  CHECK(at(fading, 3)[0] > at(fading, 1)[0]);
  CHECK(at(fading, 1) == at(fading, 0));  // the ground
}

TEST_CASE("edges lie where the lens images them") {
  for (const int scale : {1, 3}) {
    cv::Mat picture = opencv::make_picture({320, 240}, scale);
    const Eigen::Isometry3d T = facing(0.02, 0.01, 0.25);
    opencv::draw_wireframe(picture, kBarrelCamera, make_square_marker(0.2), T, opencv::color::kTracking, 1);
    int seen = 0;
    for (double along = -0.095; along < 0.1; along += 0.01)
      for (const Eigen::Vector3d& point : {Eigen::Vector3d(along, 0.1, 0), Eigen::Vector3d(0.1, along, 0)}) {
        const Eigen::Vector2d p = kBarrelCamera.project(T * point);
        if (p.x() < 2 || p.y() < 2 || p.x() > 317 || p.y() > 237) continue;
        ++seen;
        CHECK(has_color(picture,
                        {static_cast<int>(std::lround((p.x() + 0.5) * scale - 0.5)),
                         static_cast<int>(std::lround((p.y() + 0.5) * scale - 0.5))},
                        1, opencv::color::kTracking, 120));
      }
    CHECK(seen > 20);
  }
}

TEST_CASE("the colour of a marker shows its state, its axes point right and up") {
  const Eigen::Isometry3d T = facing(0, 0, 0.4);
  constexpr int kScale = 3;
  const auto in_picture = [](double x, double y) {
    return cv::Point(static_cast<int>(std::lround((x + 0.5) * kScale)),
                     static_cast<int>(std::lround((y + 0.5) * kScale)));
  };
  for (const TrackingState state : {TrackingState::converging, TrackingState::tracking, TrackingState::lost}) {
    cv::Mat picture = opencv::make_picture({320, 240}, kScale);
    PoseEstimate pose;
    pose.id = 7;
    pose.T_camera_marker = T;
    pose.quality.state = state;
    opencv::draw_marker(picture, kBarrelCamera, make_square_marker(0.1), pose);
    const Eigen::Vector2d left = kBarrelCamera.project(T * Eigen::Vector3d(-0.05, 0.02, 0));
    CHECK(has_color(picture, in_picture(left.x(), left.y()), 2, opencv::state_color(state), 60));
    CHECK(has_color(picture, in_picture(172, 119.5), 4, {60, 60, 255}, 30));  // x right of the centre, red
    CHECK(has_color(picture, in_picture(159.5, 107), 4, {80, 220, 80}, 30));  // y above it, green
    // The label, right of one of the right corners.
    CHECK((has_color(picture, in_picture(212, 87), 24, opencv::state_color(state), 60) ||
           has_color(picture, in_picture(212, 152), 24, opencv::state_color(state), 60)));
    CHECK_FALSE(has_color(picture, in_picture(110, 87), 24, opencv::state_color(state), 60));
  }
}

TEST_CASE("the label of a marker at the top of the picture lies below other text") {
  const cv::Mat empty = opencv::make_picture({320, 240}, 3);
  PoseEstimate pose;
  pose.T_camera_marker = facing(0, -0.1, 0.1);
  const auto labelled = [&](const char* note, int text_top) {
    cv::Mat picture = empty.clone();
    opencv::draw_marker(picture, kBarrelCamera, make_square_marker(0.1), pose, note, text_top);
    return picture;
  };
  cv::Mat with_text = empty.clone();
  const int below = opencv::draw_lines_of_text(with_text, std::vector<std::string>{"first", "second"});
  const auto above = [&](const cv::Mat& picture) { return picture.rowRange(0, below).clone(); };
  CHECK(changed(above(labelled("", 0)), above(labelled("note", 0))) > 0);
  CHECK(changed(above(labelled("", below)), above(labelled("note", below))) == 0);
  CHECK(changed(labelled("", below), labelled("note", below)) > 0);
}

TEST_CASE("what has no image leaves the picture alone") {
  const cv::Mat empty = opencv::make_picture({320, 240});
  Eigen::Isometry3d nan = facing(0, 0, 1);
  nan.translation().x() = std::nan("");
  for (const Eigen::Isometry3d& T : {facing(0, 0, -0.5), facing(1e9, 0, 1), nan}) {
    cv::Mat picture = empty.clone();
    opencv::draw_wireframe(picture, kBarrelCamera, make_square_marker(0.1), T, opencv::color::kLost);
    opencv::draw_axes(picture, kBarrelCamera, T, 0.05);
    CHECK(changed(picture, empty) == 0);
  }
  cv::Mat picture = empty.clone();
  PoseEstimate behind;
  behind.T_camera_marker = facing(0, 0, -0.5);
  opencv::draw_marker(picture, kBarrelCamera, make_square_marker(0.1), behind);
  CHECK(changed(picture, empty) == 0);
}

TEST_CASE("text is drawn line under line") {
  cv::Mat picture = opencv::make_picture({640, 480});
  opencv::draw_lines_of_text(picture, std::vector<std::string>{"first", "second"});
  CHECK(has_color(picture, {20, 18}, 9, opencv::color::kText, 60));
  CHECK(has_color(picture, {20, 41}, 9, opencv::color::kText, 60));
}

TEST_CASE("a picture that does not fit the camera is refused") {
  cv::Mat wrong_shape = opencv::make_picture({320, 200}), grey(240, 320, CV_8U, cv::Scalar(0)), none;
  for (cv::Mat* picture : {&wrong_shape, &grey, &none})
    CHECK_THROWS_AS(opencv::draw_wireframe(*picture, kBarrelCamera, make_square_marker(0.1), facing(0, 0, 1), {}),
                    std::invalid_argument);
  CHECK_THROWS_AS(opencv::draw_events(grey, {320, 240}, std::vector<Event>{}), std::invalid_argument);
  CHECK_THROWS_AS(opencv::make_picture({320, 240}, 0), std::invalid_argument);
  CHECK_THROWS_AS(opencv::draw_frame(PolarityFrame({4, 4}), -1), std::invalid_argument);
}
