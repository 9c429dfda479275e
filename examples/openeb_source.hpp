#pragma once
// From OpenEB's cameras and files to whatever takes events, as `live::Pipeline` does; OpenEB 3 to 5.
#include <metavision/sdk/version.h>
#if METAVISION_SDK_VERSION_MAJOR >= 5
#include <metavision/sdk/stream/camera.h>
#else
#include <metavision/sdk/driver/camera.h>
#endif
#include <metavision/hal/facilities/i_trigger_in.h>

#include <evmarker/events/event.hpp>
#include <evmarker/events/trigger_event.hpp>
#include <fstream>
#include <functional>
#include <mutex>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>

class OpenEbSource {
 public:
  using Event = Metavision::EventCD;

  /// Opens the camera with this serial number or, if it is empty, the first that is found.
  /// @throws std::runtime_error with OpenEB's reason
  explicit OpenEbSource(const std::string& serial) try : camera_(Metavision::Camera::from_serial(serial)) {
#if METAVISION_SDK_VERSION_MAJOR >= 4
    auto* const inputs = camera_.get_device().get_facility<Metavision::I_TriggerIn>();
    if (inputs != nullptr)
      for (const auto& input : inputs->get_available_channels()) inputs->enable(input.first);
#endif
  } catch (const std::system_error& error) {
    throw std::runtime_error("OpenEB: " + reason(error));
  }

  /// Opens a file.
  /// @param real_time at the pace of the recording, or as fast as its events are taken
  /// @throws std::runtime_error with OpenEB's reason
  OpenEbSource(const std::string& file, bool real_time) try : camera_(open(file, real_time)) {
  } catch (const std::system_error& error) {
    throw std::runtime_error(file + ": " + reason(error));
  }

  /// Both functions are called on the camera's thread. Trigger events come after the events of the same delivery.
  /// @throws std::runtime_error if the camera does not start
  void start(const std::function<void(std::span<const Event>)>& on_events,
             const std::function<void(const evmarker::TriggerEvent&)>& on_trigger) {
    camera_.cd().add_callback([on_events](const Event* begin, const Event* end) { on_events({begin, end}); });
    add_trigger_callback(on_trigger);
    camera_.add_runtime_error_callback([this](const Metavision::CameraException& error) {
      const std::lock_guard lock(mutex_);
      if (error_.empty()) error_ = reason(error);
    });
    if (!camera_.start()) throw std::runtime_error("camera: it does not start");
  }
  void stop() { camera_.stop(); }
  bool running() { return camera_.is_running(); }  ///< also false at the end of a file
  std::string error() const {                      ///< why it stopped by itself, if it did
    const std::lock_guard lock(mutex_);
    return error_;
  }
#if METAVISION_SDK_VERSION_MAJOR >= 5
  evmarker::SensorSize sensor_size() { return {camera_.geometry().get_width(), camera_.geometry().get_height()}; }
#else
  evmarker::SensorSize sensor_size() { return {camera_.geometry().width(), camera_.geometry().height()}; }
#endif

 private:
  static Metavision::Camera open(const std::string& path, bool real_time) {  // times as recorded, not shifted to zero
    require_size_in_dat(path);
#if METAVISION_SDK_VERSION_MAJOR >= 4
    const auto hints = Metavision::FileConfigHints().real_time_playback(real_time).time_shift(false);
    return Metavision::Camera::from_file(path, hints);
#else
    Metavision::RawFileConfig config;
    config.do_time_shifting_ = false;
    return Metavision::Camera::from_file(path, real_time, config);
#endif
  }

  // Of a DAT file without its sensor's size, Camera::geometry() would be a reference to nothing.
  static void require_size_in_dat(const std::string& path) {
    if (!path.ends_with(".dat")) return;
    std::ifstream file(path, std::ios::binary);
    bool width = false, height = false;
    for (std::string line; file.peek() == '%' && std::getline(file, line);) {
      width |= line.starts_with("% Width ");
      height |= line.starts_with("% Height ");
    }
    if (file && !(width && height))
      throw std::runtime_error(path +
                               ": its header has no Width and Height, which OpenEB needs; track_file takes --size");
  }

  void add_trigger_callback(const std::function<void(const evmarker::TriggerEvent&)>& on_trigger) {
    try {
      camera_.ext_trigger().add_callback(
          [on_trigger](const Metavision::EventExtTrigger* begin, const Metavision::EventExtTrigger* end) {
            for (const auto& trigger : std::span(begin, end)) on_trigger({trigger.id, trigger.p > 0, trigger.t});
          });
    } catch (const Metavision::CameraException&) {  // it has no inputs for triggers
    }
  }

  static std::string reason(const std::system_error& error) { return error.system_error::what(); }  // in one line

  mutable std::mutex mutex_;
  std::string error_;
  Metavision::Camera camera_;  // its threads use what is before it
};
