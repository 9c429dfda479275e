// The Python module: what is bound, under which names.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <evmarker/opencv/calibration.hpp>
#include <opencv2/core.hpp>
#include <string>

#include "reader.hpp"
#include "simulator.hpp"
#include "tracker.hpp"

namespace py = pybind11;
using namespace python;
using namespace pybind11::literals;

namespace {

// What the library refuses is a value that makes no sense, in an argument or in a file; the sentence is the library's.
void become_value_error(std::exception_ptr thrown) {
  const auto raise = [](std::string sentence) {
    std::ranges::replace(sentence, '\n', ' ');  // OpenCV's may have several lines
    PyErr_SetString(PyExc_ValueError, sentence.c_str());
  };
  try {
    if (thrown) std::rethrow_exception(thrown);
  } catch (const py::builtin_exception&) {
    throw;
  } catch (const std::invalid_argument& error) {
    raise(error.what());
  } catch (const std::runtime_error& error) {
    raise(error.what());
  } catch (const cv::Exception& error) {
    raise(error.what());
  }
}

// Of a str or an os.PathLike.
std::string path_text(const py::object& path) {
  return py::module_::import("os").attr("fspath")(path).cast<std::string>();
}

evmarker::Distortion distortion(const std::vector<double>& radtan, const std::vector<double>& fisheye) {
  const auto fail = [](const char* name, std::size_t count, const char* expected) {
    throw std::invalid_argument(std::string("camera: ") + name + " has " + std::to_string(count) + " numbers, not " +
                                expected);
  };
  if (!radtan.empty() && !fisheye.empty()) throw std::invalid_argument("camera: has both radtan and fisheye");
  if (!fisheye.empty()) {
    if (fisheye.size() != 4) fail("fisheye", fisheye.size(), "4: k1 k2 k3 k4");
    return evmarker::EquidistantDistortion{fisheye[0], fisheye[1], fisheye[2], fisheye[3]};
  }
  if (radtan.empty()) return evmarker::NoDistortion{};
  if (radtan.size() != 4 && radtan.size() != 5) fail("radtan", radtan.size(), "4 or 5: k1 k2 p1 p2 k3");
  return evmarker::BrownConradyDistortion{radtan[0], radtan[1], radtan[2], radtan[3],
                                          radtan.size() == 5 ? radtan[4] : 0};
}

void bind_camera(py::module_& module) {
  using evmarker::PinholeCamera;
  py::class_<PinholeCamera>(module, "PinholeCamera",
                            "A pinhole camera behind a lens. Frame: x right, y down, z forward.")
      .def(py::init([](const Size& size, double fx, double fy, double cx, double cy, const std::vector<double>& radtan,
                       const std::vector<double>& fisheye) {
             return PinholeCamera({size.first, size.second}, fx, fy, cx, cy, distortion(radtan, fisheye));
           }),
           "sensor_size"_a, "fx"_a, "fy"_a, "cx"_a, "cy"_a, py::kw_only(), "radtan"_a = py::tuple(),
           "fisheye"_a = py::tuple(),
           "sensor_size: width and height [px]. fx, fy: focal lengths [px]. cx, cy: principal point [px]; (0, 0) is\n"
           "the centre of the top left pixel. radtan: k1 k2 p1 p2 [k3], or fisheye: k1 k2 k3 k4, as in OpenCV.\n"
           "Raises ValueError naming the parameter that makes no sense.")
      .def_property_readonly(
          "sensor_size",
          [](const PinholeCamera& camera) { return Size(camera.sensor_size().width, camera.sensor_size().height); },
          "Width and height [px].")
      .def_property_readonly("fx", &PinholeCamera::fx, "[px]")
      .def_property_readonly("fy", &PinholeCamera::fy, "[px]")
      .def_property_readonly("cx", &PinholeCamera::cx, "[px]")
      .def_property_readonly("cy", &PinholeCamera::cy, "[px]");
  module.def(
      "load_calibration", [](const py::object& path) { return evmarker::opencv::load_calibration(path_text(path)); },
      "path"_a,
      "Reads a PinholeCamera from a calibration of OpenCV (YAML, XML, JSON) or a ROS camera_info.\n"
      "Raises ValueError naming file, field and value.");
}

void bind_tracker(py::module_& module) {
  py::class_<Tracker>(module, "Tracker",
                      "Tracks every marker and board that it sees, from its detection on. The same events give the\n"
                      "same poses, however they are divided among calls.")
      .def(
          py::init([](const evmarker::PinholeCamera& camera, const std::optional<std::string>& dictionary,
                      const std::optional<MarkerLength>& marker_length, const std::optional<py::object>& boards,
                      const std::optional<std::vector<int>>& ids, std::optional<int> events_per_update,
                      std::optional<int> filter_window_us) {
            return std::make_unique<Tracker>(
                camera,
                TrackerOptions{dictionary, marker_length, boards ? std::optional(path_text(*boards)) : std::nullopt,
                               ids, events_per_update, filter_window_us});
          }),
          "camera"_a, "dictionary"_a = py::none(), "marker_length"_a = py::none(), py::kw_only(),
          "boards"_a = py::none(), "ids"_a = py::none(), "events_per_update"_a = py::none(),
          "filter_window_us"_a = py::none(),
          "dictionary: OpenCV's name; by default that of the boards, or DICT_4X4_50. marker_length: side of the black\n"
          "square [m], of all markers or, as {3: 0.05}, of those to track. boards: a file of boards, each of which is\n"
          "tracked as one. ids: track only these markers. events_per_update, filter_window_us: automatic by default.\n"
          "Raises ValueError naming what makes no sense.")
      .def(
          "push", [](Tracker& tracker, const py::array& events) { return tracker.push(EventArray(events)); },
          "events"_a,
          "Takes events: a structured array (n,) with the fields x, y [px], t [us] and p (above 0: brighter) of\n"
          "integer types, in any order. Where its dtype is EVENT_DTYPE, nothing is copied. Other threads run "
          "meanwhile,\n"
          "which must not change the array.\n"
          "Returns the poses to which they lead, an array (m,) of POSE_DTYPE.\n"
          "Raises ValueError for other arrays, before any event is taken.")
      .def(
          "push",
          [](Tracker& tracker, const py::array& x, const py::array& y, const py::array& t, const py::array& p) {
            return tracker.push(EventColumns(x, y, t, p));
          },
          py::kw_only(), "x"_a, "y"_a, "t"_a, "p"_a, "The same with an array (n,) of integers for each field.")
      .def("poses_at", &Tracker::poses_at, "t_us"_a,
           "The poses of all tracked markers, moved on to a time [us] up to which all events have been pushed:\n"
           "an array (m,) of POSE_DTYPE.")
      .def_property_readonly(
          "statistics",
          [](Tracker& tracker) {
            const evmarker::TrackerStatistics s = tracker.statistics();
            return py::dict("events"_a = s.events, "off_sensor"_a = s.off_sensor, "hot"_a = s.hot,
                            "filtered"_a = s.filtered, "time_faults"_a = s.time_faults, "matched"_a = s.matched,
                            "time_steps_back"_a = s.time_steps_back, "outages"_a = s.outages,
                            "detections"_a = s.detections, "registered"_a = s.registered, "lost"_a = s.lost);
          },
          "Counts of events and markers so far, by name, as in evmarker::TrackerStatistics.");
}

void bind_reader(py::module_& module) {
  py::class_<Reader>(module, "Reader", "An open recording: an iterator of arrays (n,) of EVENT_DTYPE.")
      .def("__iter__", [](const py::object& reader) { return reader; })
      .def("__next__", &Reader::next)
      .def_property_readonly("sensor_size", &Reader::sensor_size, "Width and height [px].")
      .def_property_readonly("format", &Reader::format, "What was recognised, as \"Prophesee RAW, EVT3\".")
      .def_property_readonly(
          "statistics",
          [](Reader& reader) {
            const evmarker::io::RecordingStatistics s = reader.statistics();
            return py::dict("events"_a = s.events, "triggers"_a = s.triggers,
                            "dropped_before_time"_a = s.dropped_before_time, "off_sensor"_a = s.off_sensor,
                            "time_steps_back"_a = s.time_steps_back, "unknown_words"_a = s.unknown_words,
                            "garbled_times"_a = s.garbled_times, "truncated_bytes"_a = s.truncated_bytes);
          },
          "Counts of what was delivered and dropped so far, by name, as in evmarker::io::RecordingStatistics.");
  module.def(
      "read",
      [](const py::object& path, const std::optional<Size>& sensor_size, const std::string& topic,
         const std::string& columns, const std::string& time_unit) {
        return std::make_unique<Reader>(path_text(path), ReaderOptions{sensor_size, topic, columns, time_unit});
      },
      "path"_a, py::kw_only(), "sensor_size"_a = py::none(), "topic"_a = "", "columns"_a = "", "time_unit"_a = "",
      "Opens a recording of any kind that track_file reads, in memory that does not grow with its length.\n"
      "sensor_size: width and height [px], for a recording that does not state it. topic: of a ROS recording.\n"
      "columns, time_unit: of a text recording, as \"t,x,y,p\" and \"us\", where they are not recognised.\n"
      "Raises ValueError with file, position and reason, also while it is read.");
}

void bind_simulator(py::module_& module) {
  py::class_<NamedTrajectory>(module, "Trajectory", "T_camera_marker as a function of time.")
      .def("__call__", &NamedTrajectory::operator(), "seconds"_a, "The pose at a time [s], an array (4, 4) [m].");
  using Vector = Eigen::Vector3d;
  const evmarker::trajectory::Handheld hand;
  module.def(
      "handheld",
      [](double distance, const Vector& amplitude_m, const Vector& amplitude_rad, double frequency_hz,
         std::uint64_t seed) {
        return NamedTrajectory{evmarker::trajectory::handheld({.T_centre = evmarker::facing_pose({0, 0, distance}),
                                                               .amplitude_m = amplitude_m,
                                                               .amplitude_rad = amplitude_rad,
                                                               .frequency_hz = frequency_hz,
                                                               .seed = seed})};
      },
      "distance"_a = 0.6, py::kw_only(), "amplitude_m"_a = hand.amplitude_m, "amplitude_rad"_a = hand.amplitude_rad,
      "frequency_hz"_a = hand.frequency_hz, "seed"_a = hand.seed,
      "The Trajectory of a marker in a hand before the camera, at a distance [m]: it sways along and about the\n"
      "camera's axes by up to amplitude_m [m] and amplitude_rad [rad].");
  py::class_<Simulator>(module, "Simulator",
                        "An event camera in front of moving markers: an iterator of arrays (n,) of EVENT_DTYPE.")
      .def(py::init([](const evmarker::PinholeCamera& camera, const std::map<int, py::object>& markers,
                       double marker_length, const std::string& dictionary, const std::string& sensor,
                       std::uint64_t seed, const py::kwargs& changes) {
             evmarker::SimulatorSettings settings = evmarker::sensor_preset(sensor).settings;
             settings.seed = seed;
             change_settings(changes, settings);
             return std::make_unique<Simulator>(camera, markers, marker_length, dictionary, settings);
           }),
           "camera"_a, "markers"_a, "marker_length"_a = 0.10,
           "dictionary"_a = std::string(evmarker::opencv::kDefaultDictionary), py::kw_only(), "sensor"_a = "default",
           "seed"_a = 1,
           "markers: of each its T_camera_marker (4, 4) [m] as a function of the time [s] from 0 on, by id, as\n"
           "{7: handheld()}. marker_length: side of the black square [m]. sensor: default, dvs128, davis240, ..., as "
           "for\n"
           "the program simulate; duration_s and the other settings of evmarker::SimulatorSettings change single\n"
           "numbers of it. The same arguments give the same events.\n"
           "Raises ValueError naming what makes no sense.")
      .def("__iter__", [](const py::object& simulator) { return simulator; })
      .def("__next__", &Simulator::next)
      .def_property_readonly("sensor_size", &Simulator::sensor_size, "Width and height [px].");
}

}  // namespace

PYBIND11_MODULE(_evmarker, module) {
  py::register_exception_translator(become_value_error);
  using evmarker::Event;
  PYBIND11_NUMPY_DTYPE(Event, x, y, p, t);
  module.attr("EVENT_DTYPE") = py::dtype::of<Event>();
  module.attr("POSE_DTYPE") = pose_dtype();
  module.attr("__version__") = EVMARKER_VERSION;
  bind_camera(module);
  bind_tracker(module);
  bind_reader(module);
  bind_simulator(module);
}
