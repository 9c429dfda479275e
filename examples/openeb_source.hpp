#pragma once
// From OpenEB's cameras and files to anything that takes events, as `live::Pipeline` does; OpenEB 3 to 5.
#include <metavision/sdk/version.h>
#if METAVISION_SDK_VERSION_MAJOR >= 5
#include <metavision/sdk/stream/camera.h>
#else
#include <metavision/sdk/driver/camera.h>
#endif
#include <evmarker/event.hpp>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>

class OpenEbSource {
 public:
  /// Opens a file or, where its path is empty, the camera with this serial number; without one, the first that it
  /// finds.
  /// @throws std::runtime_error with OpenEB's reason
  OpenEbSource(const std::string& file, const std::string& serial, bool real_time) try
      : camera_(file.empty() ? Metavision::Camera::from_serial(serial) : open(file, real_time)) {
  } catch (const Metavision::BaseException& error) {
    throw std::runtime_error((file.empty() ? "camera " + serial : file) + ": " + reason(error));
  }

  evmarker::SensorSize sensor_size() { return size_of(camera_.geometry()); }

  /// @param push called on the camera's thread with the first event and the one behind the last
  void start(Metavision::EventsCDCallback push) {
    camera_.cd().add_callback(std::move(push));
    camera_.add_runtime_error_callback([this](const Metavision::CameraException& error) {
      const std::lock_guard lock(mutex_);
      if (error_.empty()) error_ = reason(error);
    });
    if (!camera_.start()) throw std::runtime_error("camera: it does not start");
  }
  void stop() { camera_.stop(); }
  bool running() { return camera_.is_running(); }                          ///< also false at the end of a file
  std::string error() const { return (std::lock_guard(mutex_), error_); }  ///< why it stopped by itself, if it did

 private:
  // Time as it was recorded, not shifted to begin at zero.
  static Metavision::Camera open(const std::string& path, bool real_time) {
#if METAVISION_SDK_VERSION_MAJOR >= 4
    return Metavision::Camera::from_file(path,
                                         Metavision::FileConfigHints().real_time_playback(real_time).time_shift(false));
#else
    Metavision::RawFileConfig config;
    config.do_time_shifting_ = false;
    return Metavision::Camera::from_file(path, real_time, config);
#endif
  }

  template <typename Geometry>
  static evmarker::SensorSize size_of(const Geometry& geometry) {
    if constexpr (requires { geometry.get_width(); })
      return {geometry.get_width(), geometry.get_height()};
    else
      return {geometry.width(), geometry.height()};
  }

  static std::string reason(const std::system_error& error) { return error.system_error::what(); }  // in one line

  Metavision::Camera camera_;
  mutable std::mutex mutex_;
  std::string error_;
};
