#include "evmarker/found_marker.hpp"

#include <doctest/doctest.h>

#include "evmarker/accuracy.hpp"
#include "simulated.hpp"

using namespace evmarker;

namespace {

constexpr double seconds(Timestamp t) { return static_cast<double>(t) * 1e-6; }

// The true pose and one that is tilted the other way.
MarkerDetection detection(const Eigen::Isometry3d& T, bool right_one_first) {
  Eigen::Isometry3d tilted = T;
  tilted.linear() = Eigen::AngleAxisd(0.6, Eigen::Vector3d::UnitX()).toRotationMatrix() * T.linear();
  MarkerDetection found{.id = 3, .t = 0, .T_camera_marker = right_one_first ? T : tilted};
  found.T_camera_marker_alternative = right_one_first ? tilted : T;
  return found;
}

}  // namespace

TEST_CASE("of both poses the right one goes on, whichever was first and however soon one must decide") {
  const Trajectory motion = simulated::near_motion(81);
  const auto events = simulated::filtered(simulated::near_events(motion, 0.2, 81));
  const UndistortionTable lines(simulated::camera);
  const MarkerModel model = make_code_marker(simulated::kMarkerLength, simulated::code());
  for (const bool right_one_first : {true, false})
    for (const int converging_events : {2000, 300, 0}) {
      if (!right_one_first && converging_events == 0) continue;  // nothing to decide by
      CAPTURE(right_one_first);
      CAPTURE(converging_events);
      MarkerTrackerSettings<> settings{.converging_events = converging_events, .start_search = std::nullopt};
      FoundMarker<KalmanUpdate> marker(lines, model, detection(motion(0), right_one_first), settings);
      AccuracyMeter meter;
      Timestamp last = 0;
      int back = 0, empty = 0;
      for (const Event& event : events)
        if (const PoseEstimate* const pose = marker.push(event)) {
          back += pose->t < last;
          empty += pose->id != 3 || pose->T_camera_marker.translation().z() < 0.1;
          last = pose->t;
          if (pose->t > 100000) meter.add(*pose, motion(seconds(pose->t)));
        }
      REQUIRE(meter.tracking() > 100);
      CHECK(meter.rotation_deg().mean < 1);
      CHECK(back == 0);
      CHECK(empty == 0);
    }
}
