// All that is public, made for every rule: what a compiler has to be able to compile without a word, see
// CMakeLists.txt.
#include "evmarker/base/box.hpp"
#include "evmarker/base/require.hpp"
#include "evmarker/base/so3.hpp"
#include "evmarker/base/vector.hpp"
#include "evmarker/detection/board_check.hpp"
#include "evmarker/detection/board_detector.hpp"
#include "evmarker/detection/detection_request.hpp"
#include "evmarker/detection/marker_detector.hpp"
#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/events/background_activity.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/events/event_history.hpp"
#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/polarity_frame.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/events/time_guard.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/block_reader.hpp"
#include "evmarker/io/csv_reader.hpp"
#include "evmarker/io/csv_writer.hpp"
#include "evmarker/io/decimal.hpp"
#include "evmarker/io/event_checks.hpp"
#include "evmarker/io/event_reader.hpp"
#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/line_reader.hpp"
#include "evmarker/io/output_file.hpp"
#include "evmarker/io/pose_format.hpp"
#include "evmarker/io/pose_reader.hpp"
#include "evmarker/io/pose_writer.hpp"
#include "evmarker/io/raw_header.hpp"
#include "evmarker/io/raw_reader.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_statistics.hpp"
#include "evmarker/io/text_layout.hpp"
#include "evmarker/io/trajectory.hpp"
#include "evmarker/live/detection_thread.hpp"
#include "evmarker/live/event_intake.hpp"
#include "evmarker/live/latency_histogram.hpp"
#include "evmarker/live/pipeline.hpp"
#include "evmarker/live/pipeline_settings.hpp"
#include "evmarker/live/published_state.hpp"
#include "evmarker/live/status.hpp"
#include "evmarker/live/thread_priority.hpp"
#include "evmarker/live/tick_clock.hpp"
#include "evmarker/matching/closest_points.hpp"
#include "evmarker/matching/correspondence.hpp"
#include "evmarker/matching/event_group.hpp"
#include "evmarker/matching/grid_correspondence.hpp"
#include "evmarker/matching/grid_edges.hpp"
#include "evmarker/matching/grid_matcher.hpp"
#include "evmarker/matching/nearest_lines.hpp"
#include "evmarker/matching/projected_grid.hpp"
#include "evmarker/matching/segment_matcher.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/information.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/projection.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/model/wireframe.hpp"
#include "evmarker/opencv/aruco_detector.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/opencv/board.hpp"
#include "evmarker/opencv/calibration.hpp"
#include "evmarker/opencv/code_book.hpp"
#include "evmarker/opencv/dark_quads.hpp"
#include "evmarker/opencv/frame_fit.hpp"
#include "evmarker/opencv/guessed_image.hpp"
#include "evmarker/opencv/overlay.hpp"
#include "evmarker/opencv/settings_file.hpp"
#include "evmarker/opencv/wireframe.hpp"
#include "evmarker/search/cell_region.hpp"
#include "evmarker/search/distinct_best.hpp"
#include "evmarker/search/edge_evidence.hpp"
#include "evmarker/search/fading_counts.hpp"
#include "evmarker/search/pose_grid_search.hpp"
#include "evmarker/search/start_pose_search.hpp"
#include "evmarker/search/wireframe_points.hpp"
#include "evmarker/simd/lanes.hpp"
#include "evmarker/simd/pack.hpp"
#include "evmarker/simd/wide_vectors.hpp"
#include "evmarker/simulation/event_pixel.hpp"
#include "evmarker/simulation/event_queue.hpp"
#include "evmarker/simulation/leak_schedule.hpp"
#include "evmarker/simulation/marker_view.hpp"
#include "evmarker/simulation/pixel_noise.hpp"
#include "evmarker/simulation/printed_marker.hpp"
#include "evmarker/simulation/random.hpp"
#include "evmarker/simulation/scene.hpp"
#include "evmarker/simulation/scene_renderer.hpp"
#include "evmarker/simulation/sensor_pixel.hpp"
#include "evmarker/simulation/sensor_preset.hpp"
#include "evmarker/simulation/simulator.hpp"
#include "evmarker/simulation/simulator_settings.hpp"
#include "evmarker/simulation/texture.hpp"
#include "evmarker/simulation/tile_grid.hpp"
#include "evmarker/simulation/trajectory.hpp"
#include "evmarker/tracking/background_share.hpp"
#include "evmarker/tracking/by_time.hpp"
#include "evmarker/tracking/confirmed_markers.hpp"
#include "evmarker/tracking/detection_schedule.hpp"
#include "evmarker/tracking/edge_activity.hpp"
#include "evmarker/tracking/edge_follower.hpp"
#include "evmarker/tracking/marker_range.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/marker_tracker_settings.hpp"
#include "evmarker/tracking/occlusion.hpp"
#include "evmarker/tracking/planar_hypotheses.hpp"
#include "evmarker/tracking/pose_comparison.hpp"
#include "evmarker/tracking/tentative_markers.hpp"
#include "evmarker/tracking/tile_map.hpp"
#include "evmarker/tracking/track_health.hpp"
#include "evmarker/tracking/tracker.hpp"
#include "evmarker/tracking/tracker_core.hpp"
#include "evmarker/tracking/tracker_settings.hpp"
#include "evmarker/tracking/verification.hpp"
#include "evmarker/tracking/wireframe_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/error_state.hpp"
#include "evmarker/update/kalman_measurements.hpp"
#include "evmarker/update/kalman_settings.hpp"
#include "evmarker/update/kalman_update.hpp"
#include "evmarker/update/motion_model.hpp"
#include "evmarker/update/sequential_update.hpp"
#include "evmarker/update/update_rule.hpp"

namespace evmarker {

using Detector = opencv::ArucoDetector<PinholeCamera>;

template class Verification<KalmanUpdate>;
template class Verification<DecoupledUpdate>;
template class EdgeFollower<KalmanUpdate>;
template class MarkerTracker<KalmanUpdate>;
template class MarkerTracker<DecoupledUpdate>;
template class PlanarHypotheses<KalmanUpdate>;
template class PlanarHypotheses<DecoupledUpdate>;
template class WireframeTracker<KalmanUpdate>;
template class WireframeTracker<DecoupledUpdate>;
template class TrackerCore<KalmanUpdate>;
template class TrackerCore<DecoupledUpdate>;
template class Tracker<Detector, KalmanUpdate>;
template class Tracker<Detector, DecoupledUpdate>;
template class BoardDetector<Detector>;
template class opencv::ArucoDetector<PinholeCamera>;
template class live::Pipeline<Detector, KalmanUpdate>;

}  // namespace evmarker

// Members that are templates themselves.
int main() {
  using namespace evmarker;
  const PinholeCamera camera{{640, 480}, 533, 533, 319.5, 239.5};
  const Detector detector(camera, {});
  const std::vector<Event> events;
  const auto use = [](const PoseEstimate&) {};
  Tracker tracker(camera, detector);
  tracker.push(Event{});
  tracker.push(events, use);
  std::size_t updates = 0;
  for (const auto& marker : tracker.markers()) updates += static_cast<std::size_t>(marker.follower().skipped_updates());
  MarkerTracker marker(camera, make_square_marker(0.1), facing_pose({0, 0, 1}));
  marker.push(Event{});
  marker.push(events, use);
  WireframeTracker body(camera, Wireframe{.model = make_square_marker(0.1), .start = facing_pose({0, 0, 1})});
  body.push(Event{});
  body.push(events, use);
  live::Pipeline pipeline(camera, detector, use);
  pipeline.push(events);
  return static_cast<int>(updates);
}
