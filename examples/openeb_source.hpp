#pragma once
// From OpenEB's cameras and files to whatever takes events, as `live::Pipeline` does; OpenEB 3 to 5.
#include <metavision/sdk/version.h>
#if METAVISION_SDK_VERSION_MAJOR >= 5
#include <metavision/sdk/stream/camera.h>
#else
#include <metavision/sdk/driver/camera.h>
#endif
#include <evmarker/events/event.hpp>
#include <mutex>
#include <stdexcept>
#include <string>
#include <system_error>

class OpenEbSource {
 public:
  /// Opens a file or, where there is none, the camera with this serial number, or the first that it finds.
  /// @throws std::runtime_error with OpenEB's reason
  OpenEbSource(const std::string& file, const std::string& serial, bool real_time) try
      : camera_(file.empty() ? Metavision::Camera::from_serial(serial) : open(file, real_time)) {
  } catch (const std::system_error& error) {
    throw std::runtime_error(file.empty() ? "camera: " + reason(error) : file + ": " + reason(error));
  }

  /// @param push called on the camera's thread with the first event and the one behind the last
  void start(const Metavision::EventsCDCallback& push) {
    camera_.cd().add_callback(push);
    camera_.add_runtime_error_callback([this](const Metavision::CameraException& error) {
      const std::lock_guard lock(mutex_);
      if (error_.empty()) error_ = reason(error);
    });
    if (!camera_.start()) throw std::runtime_error("camera: it does not start");
  }
  void stop() { camera_.stop(); }
  bool running() { return camera_.is_running(); }                          ///< also false at the end of a file
  std::string error() const { return (std::lock_guard(mutex_), error_); }  ///< why it stopped by itself, if it did
#if METAVISION_SDK_VERSION_MAJOR >= 5
  evmarker::SensorSize sensor_size() { return {camera_.geometry().get_width(), camera_.geometry().get_height()}; }
#else
  evmarker::SensorSize sensor_size() { return {camera_.geometry().width(), camera_.geometry().height()}; }
#endif
 private:
  static Metavision::Camera open(const std::string& path, bool real_time) {  // times as recorded, not shifted to zero
#if METAVISION_SDK_VERSION_MAJOR >= 4
    const auto hints = Metavision::FileConfigHints().real_time_playback(real_time).time_shift(false);
    return Metavision::Camera::from_file(path, hints);
#else
    Metavision::RawFileConfig config;
    config.do_time_shifting_ = false;
    return Metavision::Camera::from_file(path, real_time, config);
#endif
  }
  static std::string reason(const std::system_error& error) { return error.system_error::what(); }  // in one line

  Metavision::Camera camera_;
  mutable std::mutex mutex_;
  std::string error_;
};
