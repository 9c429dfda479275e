#pragma once
// From iniVation's cameras, by libcaer, to whatever takes events, as `live::Pipeline` does: DAVIS, DVXplorer, DVS128,
// DVS132S, Samsung's EVK, and eDVS on a serial port.
#include <libcaer/devices/device_discover.h>
#include <libcaer/events/packetContainer.h>
#include <libcaer/events/polarity.h>
#include <libcaer/events/special.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <evmarker/events/event.hpp>
#include <evmarker/events/trigger_event.hpp>
#include <functional>
#include <memory>
#include <optional>
#include <semaphore>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

class LibcaerSource {
 public:
  using Event = evmarker::Event;

  /// Opens the camera with this serial number or, if it is empty, the first that is found; an eDVS by the name of its
  /// port, as /dev/ttyUSB0.
  /// @throws std::runtime_error if there is none, or if it cannot be opened
  explicit LibcaerSource(const std::string& serial) {
    caerLogLevelSet(CAER_LOG_EMERGENCY);  // errors are reported here
    if (serial.starts_with('/'))
      open_port(serial);
    else
      open_usb(serial);
    if (!caerDeviceSendDefaultConfig(camera_.get())) throw std::runtime_error("libcaer: the camera is not configured");
    // The least delay: containers of 1 ms in place of 10, taken when they are told of.
    caerDeviceConfigSet(camera_.get(), CAER_HOST_CONFIG_PACKETS, CAER_HOST_CONFIG_PACKETS_MAX_CONTAINER_INTERVAL, 1000);
  }

  LibcaerSource(const LibcaerSource&) = delete;
  LibcaerSource& operator=(const LibcaerSource&) = delete;
  ~LibcaerSource() { stop(); }

  /// Both functions are called on a thread of this source. Trigger events come after the events of the same delivery.
  /// @throws std::runtime_error if the camera does not start
  void start(std::function<void(std::span<const Event>)> on_events,
             std::function<void(const evmarker::TriggerEvent&)> on_trigger) {
    on_events_ = std::move(on_events);
    on_trigger_ = std::move(on_trigger);
    running_ = true;
    const auto delivered = [](void* self) { static_cast<LibcaerSource*>(self)->delivered_.release(); };
    const auto ended = [](void* self) {
      static_cast<LibcaerSource*>(self)->running_ = false;
      static_cast<LibcaerSource*>(self)->delivered_.release();
    };
    if (!caerDeviceDataStart(camera_.get(), delivered, nullptr, this, ended, this)) {
      running_ = false;
      throw std::runtime_error("camera: it does not start");
    }
    if (is_davis_) caerDeviceConfigSet(camera_.get(), DAVIS_CONFIG_APS, DAVIS_CONFIG_APS_RUN, 0);  // frames disturb
    thread_ = std::thread([this] { deliver(); });
  }

  void stop() {
    stopping_ = true;
    running_ = false;
    delivered_.release();
    if (!thread_.joinable()) return;
    thread_.join();
    caerDeviceDataStop(camera_.get());
  }

  bool running() const { return running_; }
  std::string error() const {  ///< why it stopped by itself, if it did
    return running_ || stopping_ ? "" : "the camera was disconnected, or its driver failed";
  }
  evmarker::SensorSize sensor_size() const { return sensor_size_; }

 private:
  struct Close {
    void operator()(caerDeviceHandle camera) const { caerDeviceClose(&camera); }
  };
  struct Found {
    std::string name, serial;
    evmarker::SensorSize size;
  };

  static std::optional<Found> found(const caer_device_discovery_result& result) {
    const auto camera = [](const char* name, const auto& info) {
      return Found{name, info.deviceSerialNumber, {info.dvsSizeX, info.dvsSizeY}};
    };
    const auto& info = result.deviceInfo;
    switch (result.deviceType) {
      case CAER_DEVICE_DVS128: return camera("DVS128", info.dvs128Info);
      case CAER_DEVICE_DAVIS_FX2:
      case CAER_DEVICE_DAVIS_FX3:
      case CAER_DEVICE_DAVIS_RPI:
      case CAER_DEVICE_DAVIS: return camera("DAVIS", info.davisInfo);
      case CAER_DEVICE_DVS132S: return camera("DVS132S", info.dvs132sInfo);
      case CAER_DEVICE_DVXPLORER: return camera("DVXplorer", info.dvXplorerInfo);
      case CAER_DEVICE_SAMSUNG_EVK: return camera("Samsung EVK", info.samsungEVKInfo);
      case CAER_DEVICE_EDVS:
        return Found{"eDVS", info.edvsInfo.serialPortName, {info.edvsInfo.dvsSizeX, info.edvsInfo.dvsSizeY}};
      default: return std::nullopt;  // not a camera
    }
  }

  void open_usb(const std::string& serial) {
    caer_device_discovery_result* results = nullptr;
    const auto count = caerDeviceDiscover(CAER_DEVICE_DISCOVER_ALL, &results);
    const std::unique_ptr<caer_device_discovery_result, decltype(&std::free)> owner(results, std::free);
    std::string others;
    for (auto& result : std::span(results, static_cast<std::size_t>(std::max<ssize_t>(count, 0)))) {
      const auto camera = found(result);
      if (!camera) continue;
      if (serial.empty() || camera->serial == serial) return open(*camera, result);
      others += (others.empty() ? "" : ", ") + camera->name + " " + camera->serial;
    }
    if (others.empty()) throw std::runtime_error("libcaer: no camera is found");
    throw std::runtime_error("libcaer: no camera has the serial number " + serial + ", but there is " + others);
  }

  void open(const Found& found, caer_device_discovery_result& result) {
    camera_.reset(caerDeviceDiscoverOpen(kSource, &result));
    if (!camera_)
      throw std::runtime_error("libcaer: " + found.name + " " + found.serial +
                               " cannot be opened: is another program " + "using it, or may only root (udev rules)?");
    sensor_size_ = found.size;
    is_davis_ = found.name == "DAVIS";
  }

  void open_port(const std::string& port) {
    for (const int baud : {CAER_HOST_CONFIG_SERIAL_BAUD_RATE_12M, CAER_HOST_CONFIG_SERIAL_BAUD_RATE_8M,
                           CAER_HOST_CONFIG_SERIAL_BAUD_RATE_4M, CAER_HOST_CONFIG_SERIAL_BAUD_RATE_2M}) {
      camera_.reset(caerDeviceOpenSerial(kSource, CAER_DEVICE_EDVS, port.c_str(), static_cast<std::uint32_t>(baud)));
      if (!camera_) continue;
      const caer_edvs_info info = caerEDVSInfoGet(camera_.get());
      sensor_size_ = {info.dvsSizeX, info.dvsSizeY};
      return;
    }
    throw std::runtime_error("libcaer: " + port + ": no eDVS answers");
  }

  void deliver() {
    while (true) {
      delivered_.acquire();
      if (stopping_) return;
      while (const caerEventPacketContainer container = caerDeviceDataGet(camera_.get())) {
        deliver(container);
        caerEventPacketContainerFree(container);
      }
      if (!running_) return;
    }
  }

  void deliver(caerEventPacketContainerConst container) {
    if (const auto* packet = caerEventPacketContainerFindEventPacketByTypeConst(container, POLARITY_EVENT)) {
      read(caerPolarityEventPacketFromPacketHeaderConst(packet));
      if (!events_.empty()) on_events_(events_);
    }
    if (const auto* packet = caerEventPacketContainerFindEventPacketByTypeConst(container, SPECIAL_EVENT))
      deliver_triggers(caerSpecialEventPacketFromPacketHeaderConst(packet));
  }

  void read(caerPolarityEventPacketConst packet) {
    events_.clear();
    const std::int32_t count = caerEventPacketHeaderGetEventNumber(&packet->packetHeader);
    for (std::int32_t i = 0; i < count; ++i) {
      const auto* event = caerPolarityEventPacketGetEventConst(packet, i);
      if (!caerPolarityEventIsValid(event)) continue;
      events_.push_back({caerPolarityEventGetX(event), caerPolarityEventGetY(event),
                         caerPolarityEventGetPolarity(event) ? std::int16_t{1} : std::int16_t{0},
                         caerPolarityEventGetTimestamp64(event, packet)});
    }
  }

  struct Input {
    int id;
    std::uint8_t rising, falling, pulse;
  };
  static constexpr std::array<Input, 3> kInputs{{
      {0, EXTERNAL_INPUT_RISING_EDGE, EXTERNAL_INPUT_FALLING_EDGE, EXTERNAL_INPUT_PULSE},
      {1, EXTERNAL_INPUT1_RISING_EDGE, EXTERNAL_INPUT1_FALLING_EDGE, EXTERNAL_INPUT1_PULSE},
      {2, EXTERNAL_INPUT2_RISING_EDGE, EXTERNAL_INPUT2_FALLING_EDGE, EXTERNAL_INPUT2_PULSE},
  }};

  void deliver_triggers(caerSpecialEventPacketConst packet) {
    const std::int32_t count = caerEventPacketHeaderGetEventNumber(&packet->packetHeader);
    for (std::int32_t i = 0; i < count; ++i) {
      const auto* event = caerSpecialEventPacketGetEventConst(packet, i);
      if (!caerSpecialEventIsValid(event)) continue;
      const evmarker::Timestamp t = caerSpecialEventGetTimestamp64(event, packet);
      const auto type = caerSpecialEventGetType(event);
      for (const Input& input : kInputs)
        if (type == input.rising || type == input.pulse || type == input.falling)
          on_trigger_({input.id, type != input.falling, t});
    }
  }

  static constexpr std::uint16_t kSource = 1;  // its number in libcaer's packets

  std::unique_ptr<caer_device_handle, Close> camera_;
  evmarker::SensorSize sensor_size_;
  bool is_davis_ = false;
  std::function<void(std::span<const Event>)> on_events_;
  std::function<void(const evmarker::TriggerEvent&)> on_trigger_;
  std::vector<Event> events_;  // of the delivery
  std::counting_semaphore<> delivered_{0};
  std::atomic<bool> running_ = false, stopping_ = false;
  std::thread thread_;
};
