#pragma once
// What `help` says of the parts of the Python module that need more than a line.

namespace doc {

inline constexpr const char* kPinholeCamera =
    R"(sensor_size: width and height [px]. fx, fy: focal lengths [px]. cx, cy: principal point [px]; (0, 0) is the
centre of the top left pixel. radtan: k1 k2 p1 p2 [k3], or fisheye: k1 k2 k3 k4, as in OpenCV.
Raises ValueError naming the parameter that makes no sense.)";

inline constexpr const char* kLoadCalibration =
    R"(Reads a PinholeCamera from a calibration of OpenCV (YAML, XML, JSON), ROS, Kalibr, Metavision, DSEC or RPG.
camera_name: which, of a file of several cameras; size: width and height [px], of a file that does not state them.
Raises ValueError naming file, field and value.)";

inline constexpr const char* kTracker =
    R"(Tracks every marker and board that it sees, from its detection on. The same events give the same poses,
however they are divided among calls.)";

inline constexpr const char* kTrackerOptions =
    R"(dictionary: OpenCV's name; by default that of the boards, or DICT_4X4_50. marker_length: side of the black
square [m], of all markers or, as {3: 0.05}, of those to track. boards: a file of boards, each of which is
tracked as one. ids: track only these markers. events_per_update, filter_window_us: automatic by default.
latency_us: known delay of the camera's events [us], 0 by default: poses are moved forward by it.
latency_sigma_us: its standard deviation [us], 100 by default: it widens the covariance along the motion.
Raises ValueError naming what makes no sense.)";

inline constexpr const char* kPush =
    R"(Takes events: a structured array (n,) with the fields x, y [px], t [us] and p (above 0: brighter) of integer
types, in any order. Where its dtype is EVENT_DTYPE, nothing is copied. Other threads run meanwhile, which
must not change the array.
Returns the poses to which they lead, an array (m,) of POSE_DTYPE.
Warns of a board that is refused, as its markers are seen elsewhere than its file says.
Raises ValueError for other arrays, before any event is taken.)";

inline constexpr const char* kPosesAt =
    R"(The poses of all tracked markers, moved on to a time [us] up to which all events have been pushed: an array
(m,) of POSE_DTYPE.)";

inline constexpr const char* kRead =
    R"(Opens a recording of any kind that track_file reads, in memory that does not grow with its length.
sensor_size: width and height [px], for a recording that does not state it. topic: of a ROS recording.
columns, time_unit: of a text recording, as "t,x,y,p" and "us", where they are not recognised.
Raises ValueError with file, position and reason, also while it is read.)";

inline constexpr const char* kHandheld =
    R"(The Trajectory of a marker in a hand before the camera, at a distance [m]: it sways along and about the
camera's axes by up to amplitude_m [m] and amplitude_rad [rad].)";

inline constexpr const char* kSimulatorOptions =
    R"(markers: of each its T_camera_marker (4, 4) [m] as a function of the time [s] from 0 on, by id, as {7:
handheld()}. marker_length: side of the black square [m]. sensor: default, dvs128, davis240 and so on, as
for the program simulate; duration_s and the other settings of evmarker::SimulatorSettings change single
numbers of it. The same arguments give the same events.
Raises ValueError naming what makes no sense.)";

}  // namespace doc
