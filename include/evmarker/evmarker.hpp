#pragma once
// What nearly every user needs: events, cameras, models, both rules, trackers of one and of many markers. Recordings,
// OpenCV, threads, the simulator and what judges poses are in io/, opencv/, live/, simulation/ and evaluation/.
#include "evmarker/detection/board_detector.hpp"
#include "evmarker/events/event.hpp"
#include "evmarker/events/event_stream.hpp"
#include "evmarker/events/spatiotemporal_filter.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/model/board.hpp"
#include "evmarker/model/camera.hpp"
#include "evmarker/model/marker_model.hpp"
#include "evmarker/model/pose_estimate.hpp"
#include "evmarker/model/undistortion_table.hpp"
#include "evmarker/model/wireframe.hpp"
#include "evmarker/tracking/marker_tracker.hpp"
#include "evmarker/tracking/tracker.hpp"
#include "evmarker/tracking/wireframe_tracker.hpp"
#include "evmarker/update/decoupled_update.hpp"
#include "evmarker/update/kalman_update.hpp"
