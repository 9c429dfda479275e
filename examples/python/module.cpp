// The Python module: what is bound, under which names.
#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cstdint>
#include <evmarker/opencv/calibration.hpp>
#include <exception>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "docstrings.hpp"
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

py::dict as_dict(const evmarker::TrackerStatistics& s) {
  return py::dict("events"_a = s.events, "off_sensor"_a = s.off_sensor, "hot"_a = s.hot, "filtered"_a = s.filtered,
                  "time_faults"_a = s.time_faults, "matched"_a = s.matched, "time_steps_back"_a = s.time_steps_back,
                  "outages"_a = s.outages, "detections"_a = s.detections, "unusable_poses"_a = s.unusable_poses,
                  "registered"_a = s.registered, "replayed"_a = s.replayed, "replays_cut"_a = s.replays_cut,
                  "lost"_a = s.lost);
}

py::dict as_dict(const evmarker::io::RecordingStatistics& s) {
  return py::dict("events"_a = s.events, "triggers"_a = s.triggers, "dropped_before_time"_a = s.dropped_before_time,
                  "off_sensor"_a = s.off_sensor, "time_steps_back"_a = s.time_steps_back,
                  "unknown_words"_a = s.unknown_words, "garbled_times"_a = s.garbled_times,
                  "truncated_bytes"_a = s.truncated_bytes);
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
           "fisheye"_a = py::tuple(), doc::kPinholeCamera)
      .def_property_readonly(
          "sensor_size",
          [](const PinholeCamera& camera) { return Size(camera.sensor_size().width, camera.sensor_size().height); },
          "Width and height [px].")
      .def_property_readonly("fx", &PinholeCamera::fx, "[px]")
      .def_property_readonly("fy", &PinholeCamera::fy, "[px]")
      .def_property_readonly("cx", &PinholeCamera::cx, "[px]")
      .def_property_readonly("cy", &PinholeCamera::cy, "[px]");
  module.def(
      "load_calibration",
      [](const py::object& path, const std::string& camera_name, const std::optional<std::pair<int, int>>& size) {
        evmarker::opencv::CalibrationOptions options{.camera = camera_name};
        if (size) options.sensor_size = {size->first, size->second};
        return evmarker::opencv::load_calibration(path_text(path), options);
      },
      "path"_a, "camera_name"_a = "", "size"_a = py::none(), doc::kLoadCalibration);
}

void bind_tracker(py::module_& module) {
  py::class_<Tracker>(module, "Tracker", doc::kTracker)
      .def(py::init([](const evmarker::PinholeCamera& camera, const std::optional<std::string>& dictionary,
                       const std::optional<MarkerLength>& marker_length, const std::optional<py::object>& boards,
                       const std::optional<std::vector<int>>& ids, std::optional<int> events_per_update,
                       std::optional<int> filter_window_us, std::optional<double> latency_us,
                       std::optional<double> latency_sigma_us) {
             return std::make_unique<Tracker>(
                 camera,
                 TrackerOptions{dictionary, marker_length, boards ? std::optional(path_text(*boards)) : std::nullopt,
                                ids, events_per_update, filter_window_us, latency_us, latency_sigma_us});
           }),
           "camera"_a, "dictionary"_a = py::none(), "marker_length"_a = py::none(), py::kw_only(),
           "boards"_a = py::none(), "ids"_a = py::none(), "events_per_update"_a = py::none(),
           "filter_window_us"_a = py::none(), "latency_us"_a = py::none(), "latency_sigma_us"_a = py::none(),
           doc::kTrackerOptions)
      .def(
          "push",
          [](Tracker& tracker, const py::object& events) {
            const py::array array = require_array(events);
            return tracker.push(EventArray(array));
          },
          "events"_a, doc::kPush)
      .def(
          "push",
          [](Tracker& tracker, const py::array& x, const py::array& y, const py::array& t, const py::array& p) {
            return tracker.push(EventColumns(x, y, t, p));
          },
          py::kw_only(), "x"_a, "y"_a, "t"_a, "p"_a, "The same with an array (n,) of integers for each field.")
      .def("poses_at", &Tracker::poses_at, "t_us"_a, doc::kPosesAt)
      .def_property_readonly(
          "statistics", [](Tracker& tracker) { return as_dict(tracker.statistics()); },
          "Counts of events and markers so far, by name, as in evmarker::TrackerStatistics.");
}

void bind_reader(py::module_& module) {
  py::class_<Reader>(module, "Reader", "An open recording: an iterator of arrays (n,) of EVENT_DTYPE.")
      .def("__iter__", [](const py::object& reader) { return reader; })
      .def("__next__", &Reader::next)
      .def_property_readonly("sensor_size", &Reader::sensor_size, "Width and height [px].")
      .def_property_readonly("format", &Reader::format, "What was recognised, as \"Prophesee RAW, EVT3\".")
      .def_property_readonly(
          "statistics", [](Reader& reader) { return as_dict(reader.statistics()); },
          "Counts of what was delivered and dropped so far, by name, as in evmarker::io::RecordingStatistics.");
  module.def(
      "read",
      [](const py::object& path, const std::optional<Size>& sensor_size, const std::string& topic,
         const std::string& columns, const std::string& time_unit) {
        const std::string text = path_text(path);
        const py::gil_scoped_release unlocked;  // a FIFO is opened when somebody writes to it
        return std::make_unique<Reader>(text, ReaderOptions{sensor_size, topic, columns, time_unit});
      },
      "path"_a, py::kw_only(), "sensor_size"_a = py::none(), "topic"_a = "", "columns"_a = "", "time_unit"_a = "",
      doc::kRead);
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
      "frequency_hz"_a = hand.frequency_hz, "seed"_a = hand.seed, doc::kHandheld);
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
           "seed"_a = 1, doc::kSimulatorOptions)
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
