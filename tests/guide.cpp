// The C++ samples of the pages, each in a function that declares what it uses. `build: samples` compiles them, and
// examples_test.cpp checks that they are the same as in the pages.
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/live/pipeline.hpp>
#include <evmarker/model/information.hpp>
#include <evmarker/model/relative_pose.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/board.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <evmarker/opencv/wireframe.hpp>
#include <span>

// clang-format off
using evmarker::PinholeCamera;
using Detector = evmarker::opencv::ArucoDetector<PinholeCamera>;
using Pose = Eigen::Isometry3d;

void recording(evmarker::Tracker<Detector>& tracker) {
  evmarker::io::EventReader recording("recording.raw");                       // <evmarker/io/event_reader.hpp>
  const auto camera = evmarker::opencv::load_calibration("camera.yml");       // <evmarker/opencv/calibration.hpp>
  for (auto events = recording.next_batch(); !events.empty(); events = recording.next_batch())
    tracker.push(events, [](const evmarker::PoseEstimate& pose) { /* ... */ });
}

void how_sure(const evmarker::PoseEstimate& pose) {
  if (pose.covariance) { /* 6 x 6: translation [m], then rotation [rad], camera frame; (*pose.covariance)(2, 2) is depth */ }
  const auto information = evmarker::information(pose);  // its inverse, for a fusion: <evmarker/model/information.hpp>
  const auto of_camera = evmarker::inverse(pose);        // in the marker's frame: <evmarker/model/relative_pose.hpp>
  if (pose.twist) { /* velocity [m/s], then turn rate [rad/s] of the marker, camera frame */ }
}

void one_marker(const PinholeCamera& camera, const Detector& detector, const Pose& T_camera_marker,
                const evmarker::Event& event, evmarker::Timestamp t) {
  evmarker::MarkerTracker tracker(camera, detector.model(7), T_camera_marker, {.events_per_update = 20});
  if (const auto* pose = tracker.push(event)) { /* pose->t, pose->T_camera_marker; valid until the next push */ }
  const auto now = tracker.pose_at(t);  // any time since: moved on with its velocity, less certain with its age
}

void board(const PinholeCamera& camera, const Detector& detector) {
  const auto board = evmarker::opencv::load_board("board.yml", "DICT_4X4_50");    // <evmarker/opencv/board.hpp>
  evmarker::BoardDetector boards(camera, detector, {board});                      // markers on no board pass through
  evmarker::Tracker tracker(camera, boards);
}

void wireframe(const PinholeCamera& camera, const evmarker::Event& event) {
  const auto body = evmarker::opencv::load_wireframe("body.yml");   // <evmarker/opencv/wireframe.hpp>, or a model of your own,
  evmarker::WireframeTracker tracker(camera, body);                 // as {.id = 200, .model = make_rectangle_marker(0.3, 0.2), .start = T}
  if (const auto* pose = tracker.push(event)) { /* as of a marker */ }
}

void threads(const PinholeCamera& camera, const Detector& detector, std::span<const evmarker::Event> events,
             evmarker::Timestamp t) {
  evmarker::live::Pipeline pipeline(camera, detector, [](const evmarker::PoseEstimate& pose) { /* on its own thread */ },
                                    {.overload = evmarker::live::OverloadPolicy::drop_oldest});  // or block, thin
  pipeline.push(events);                                       // a range, or begin and end, from any thread
  const auto now = pipeline.poses_at(t);                       // every marker moved on to a time, for a fixed rate
  const auto status = pipeline.status();                       // events in, filtered, dropped, backlog, latency, markers
  pipeline.flush();                                            // at the end: waits until all that was pushed is tracked
  pipeline.stop();                                             // drops what is left, throws what was thrown on the threads
}

void settings(const PinholeCamera& camera, const Detector& detector, const Pose& T_camera_marker) {
  evmarker::Tracker tracker(camera, detector, {.marker = {.events_per_update = 20}});
  evmarker::Tracker by_the_paper(camera, detector, evmarker::TrackerSettings<evmarker::DecoupledUpdate>{});
  evmarker::MarkerTracker<evmarker::DecoupledUpdate> marker(camera, detector.model(7), T_camera_marker);
}
