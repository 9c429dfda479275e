#pragma once
// The simulator as an iterator of arrays, with trajectories that are written in C++ or in Python.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <evmarker/base/so3.hpp>
#include <evmarker/opencv/aruco_shim.hpp>
#include <evmarker/simulation/sensor_preset.hpp>
#include <evmarker/simulation/simulator.hpp>
#include <evmarker/simulation/trajectory.hpp>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "reader.hpp"

namespace python {

using Matrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;

/// @param whose it is, in errors
/// @throws std::invalid_argument unless the object is an array of 4 x 4 numbers that are a rotation and a translation
inline Eigen::Isometry3d pose_of(const py::object& object, const std::string& whose) {
  const auto numbers = py::array_t<double, py::array::c_style | py::array::forcecast>::ensure(object);
  if (!numbers || numbers.ndim() != 2 || numbers.shape(0) != 4 || numbers.shape(1) != 4)
    throw std::invalid_argument(whose + " is no array of 4 x 4 numbers");
  Eigen::Isometry3d T;
  T.matrix() = Eigen::Map<const Matrix4>(numbers.data());
  const bool affine = T.matrix().row(3) == Eigen::RowVector4d(0, 0, 0, 1);
  if (!affine || !evmarker::is_finite(T) || !evmarker::is_rotation(T.linear()))
    throw std::invalid_argument(whose + " is no rotation and translation");
  return T;
}

/// A trajectory of the library, called from Python like a function.
struct NamedTrajectory {
  evmarker::Trajectory T_camera_marker;

  Matrix4 operator()(double seconds) const { return T_camera_marker(seconds).matrix(); }
};

/// A trajectory that a Python function computes. It may be called, copied and destroyed without the interpreter's lock.
inline evmarker::Trajectory python_trajectory(const py::object& function, const std::string& name) {
  const std::shared_ptr<py::object> held(new py::object(function), [](py::object* object) {
    const py::gil_scoped_acquire locked;
    delete object;
  });
  return [held, name](double seconds) {
    const py::gil_scoped_acquire locked;
    return pose_of((*held)(seconds), name);
  };
}

struct SimulatorSetting {
  const char* name;
  double evmarker::SimulatorSettings::*value;
};

inline constexpr std::array kSimulatorSettings = [] {
  using S = evmarker::SimulatorSettings;
  return std::to_array<SimulatorSetting>({{"duration_s", &S::duration_s},
                                          {"contrast_threshold_on", &S::contrast_threshold_on},
                                          {"contrast_threshold_off", &S::contrast_threshold_off},
                                          {"threshold_mismatch", &S::threshold_mismatch},
                                          {"refractory_us", &S::refractory_us},
                                          {"pixel_time_constant_us", &S::pixel_time_constant_us},
                                          {"light_time_constant_us", &S::light_time_constant_us},
                                          {"point_spread_px", &S::point_spread_px},
                                          {"noise_hz_per_px", &S::noise_hz_per_px},
                                          {"leak_hz_per_px", &S::leak_hz_per_px},
                                          {"leak_spread", &S::leak_spread},
                                          {"latency_jitter_us", &S::latency_jitter_us}});
}();

/// Changes the settings that are named.
/// @throws py::type_error naming the one that there is not
inline void change_settings(const py::kwargs& changes, evmarker::SimulatorSettings& settings) {
  for (const auto& [key, value] : changes) {
    const auto name = key.cast<std::string>();
    const auto* const known = std::ranges::find(kSimulatorSettings, name, &SimulatorSetting::name);
    if (known == kSimulatorSettings.end()) throw py::type_error("simulator: there is no setting " + name);
    if (!py::isinstance<py::float_>(value) && !py::isinstance<py::int_>(value))
      throw py::type_error("simulator: " + name + " is no number");
    settings.*known->value = value.cast<double>();
  }
}

class Simulator {
 public:
  /// @param markers trajectory of each, by id
  /// @throws std::invalid_argument naming what makes no sense
  Simulator(const evmarker::PinholeCamera& camera, const std::map<int, py::object>& markers, double marker_length,
            const std::string& dictionary, const evmarker::SimulatorSettings& settings)
      : simulator_(camera, make_markers(markers, marker_length, dictionary), settings) {}

  py::array_t<evmarker::Event> next() { return next_array(simulator_, mutex_); }
  Size sensor_size() const { return {simulator_.sensor_size().width, simulator_.sensor_size().height}; }

 private:
  static std::vector<evmarker::SimulatedMarker> make_markers(const std::map<int, py::object>& markers, double length,
                                                             const std::string& dictionary) {
    const cv::aruco::Dictionary codes = evmarker::opencv::make_dictionary(dictionary);
    std::vector<evmarker::SimulatedMarker> scene;
    for (const auto& [id, motion] : markers) {
      const std::string name = "simulator: the pose of marker " + std::to_string(id);
      if (!PyCallable_Check(motion.ptr())) throw py::type_error(name + " is no function of the seconds");
      const bool named = py::isinstance<NamedTrajectory>(motion);
      scene.push_back({.id = id,
                       .length = length,
                       .bits = evmarker::opencv::marker_bits(codes, id, dictionary),
                       .T_camera_marker =
                           named ? motion.cast<NamedTrajectory>().T_camera_marker : python_trajectory(motion, name)});
    }
    return scene;
  }

  std::mutex mutex_;
  evmarker::Simulator simulator_;
};

}  // namespace python
