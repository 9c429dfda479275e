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
    detect_both_edges();
    // For the least delay: containers of 1 ms instead of 10, each taken as soon as libcaer reports it.
    caerDeviceConfigSet(camera_.get(), CAER_HOST_CONFIG_PACKETS, CAER_HOST_CONFIG_PACKETS_MAX_CONTAINER_INTERVAL, 1000);
  }

  LibcaerSource(const LibcaerSource&) = delete;
  LibcaerSource& operator=(const LibcaerSource&) = delete;
  ~LibcaerSource() { stop(); }

  /// Both functions are called on a thread of this source, and must not throw. Trigger events come after the events of
  /// the same delivery. To be called once.
  /// @throws std::runtime_error if the camera does not start
  void start(std::function<void(std::span<const Event>)> on_events,
             std::function<void(const evmarker::TriggerEvent&)> on_trigger) {
    on_events_ = std::move(on_events);
    on_trigger_ = std::move(on_trigger);
    running_ = true;
    const auto delivered = [](void* self) { static_cast<LibcaerSource*>(self)->delivered_.release(); };
    const auto failed = [](void* self) {  // not called after DataStop
      static_cast<LibcaerSource*>(self)->failed_ = true;
      static_cast<LibcaerSource*>(self)->running_ = false;
      static_cast<LibcaerSource*>(self)->delivered_.release();
    };
    if (!caerDeviceDataStart(camera_.get(), delivered, nullptr, this, failed, this)) {
      running_ = false;
      throw std::runtime_error("camera: it does not start");
    }
    started_ = true;
    // No frames, which disturb the events; only now, as DataStart switches them on.
    if (kind_ == "DAVIS") caerDeviceConfigSet(camera_.get(), DAVIS_CONFIG_APS, DAVIS_CONFIG_APS_RUN, 0);
    thread_ = std::thread([this] { deliver(); });
  }

  void stop() {
    running_ = false;
    delivered_.release();
    if (thread_.joinable()) thread_.join();
    if (started_) caerDeviceDataStop(camera_.get());
    started_ = false;
  }

  bool running() const { return running_; }
  std::string error() const {  ///< why it stopped by itself, if it did
    return failed_ ? "the camera was disconnected, or its driver failed" : "";
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
      default: return std::nullopt;  // not a camera
    }
  }

  // Each kind by itself: to look for all would write to every serial port, in search of an eDVS.
  void open_usb(const std::string& serial) {
    std::string others;
    constexpr std::array<std::int16_t, 6> kKinds{CAER_DEVICE_DAVIS,   CAER_DEVICE_DVXPLORER,   CAER_DEVICE_DVS128,
                                                 CAER_DEVICE_DVS132S, CAER_DEVICE_SAMSUNG_EVK, CAER_DEVICE_DAVIS_RPI};
    for (const std::int16_t kind : kKinds) {
      caer_device_discovery_result* results = nullptr;
      const auto count = caerDeviceDiscover(kind, &results);
      const std::unique_ptr<caer_device_discovery_result, decltype(&std::free)> owner(results, std::free);
      for (auto& result : std::span(results, static_cast<std::size_t>(std::max<ssize_t>(count, 0)))) {
        const auto camera = found(result);
        if (!camera) continue;
        if (serial.empty() || camera->serial == serial) return open(*camera, result);
        others += (others.empty() ? "" : ", ") + camera->name + " " + camera->serial;
        if (result.deviceErrorOpen) others += " (which cannot be opened: in use, or for root only?)";
      }
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
    kind_ = found.name;
  }

  // Of signals at the input, instead of pulses, which have no end and are reported once they have lasted for a while.
  void detect_both_edges() {
    if (kind_ != "DAVIS" && kind_ != "DVXplorer" && kind_ != "DVS132S") return;
    static_assert(DVX_EXTINPUT == DAVIS_CONFIG_EXTINPUT && DVS132S_CONFIG_EXTINPUT == DAVIS_CONFIG_EXTINPUT &&
                  DVX_EXTINPUT_DETECT_PULSES == DAVIS_CONFIG_EXTINPUT_DETECT_PULSES);  // they share their addresses
    const auto set = [&](std::uint8_t what, std::uint32_t value) {
      caerDeviceConfigSet(camera_.get(), DAVIS_CONFIG_EXTINPUT, what, value);
    };
    set(DAVIS_CONFIG_EXTINPUT_DETECT_RISING_EDGES, 1);
    set(DAVIS_CONFIG_EXTINPUT_DETECT_FALLING_EDGES, 1);
    set(DAVIS_CONFIG_EXTINPUT_DETECT_PULSES, 0);
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
    while (running_) {
      delivered_.acquire();
      while (running_) {
        const caerEventPacketContainer container = caerDeviceDataGet(camera_.get());
        if (container == nullptr) break;
        deliver(container);
        caerEventPacketContainerFree(container);
      }
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

  std::counting_semaphore<> delivered_{0};
  std::atomic<bool> running_ = false, failed_ = false;
  std::unique_ptr<caer_device_handle, Close> camera_;  // its threads use what is before it
  bool started_ = false;
  std::string kind_;
  evmarker::SensorSize sensor_size_;
  std::function<void(std::span<const Event>)> on_events_;
  std::function<void(const evmarker::TriggerEvent&)> on_trigger_;
  std::vector<Event> events_;  // of the delivery
  std::thread thread_;
};
