#pragma once
// A picture of the tracking at one moment, the same for recordings and cameras: events, markers, rates.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <evmarker/evmarker.hpp>
#include <evmarker/opencv/overlay.hpp>
#include <map>
#include <mutex>
#include <opencv2/core.hpp>
#include <optional>
#include <ranges>
#include <string>
#include <vector>

/// A count of something as 950, 12.3 k or 4.56 M.
inline std::string short_number(double value) {
  char text[32];
  if (value >= 1e6)
    std::snprintf(text, sizeof text, "%.2f M", value * 1e-6);
  else if (value >= 1e3)
    std::snprintf(text, sizeof text, "%.1f k", value * 1e-3);
  else
    std::snprintf(text, sizeof text, "%.0f", value);
  return text;
}

/// Counts poses and draws; poses may be added from another thread.
class TrackingView {
 public:
  explicit TrackingView(const evmarker::PinholeCamera& camera) : camera_(camera) {}

  /// Pixels of the picture to a pixel of the sensor: text needs room.
  int scale() const { return std::max(1, 1280 / camera_.sensor_size().width); }
  cv::Size picture_size() const {
    const evmarker::SensorSize size = camera_.sensor_size();
    return {size.width * scale(), size.height * scale()};
  }

  void add(const evmarker::PoseEstimate& pose) {
    const std::lock_guard lock(mutex_);
    ++poses_[pose.id];
  }

  /// @param events until now
  /// @param model_of gives the model of a marker's id
  /// @param lines of text below the first one, which has the time and the rate of events
  template <std::ranges::input_range Poses, typename ModelOf>
  cv::Mat draw(const evmarker::PolarityFrame& frame, std::uint64_t events, const Poses& poses, const ModelOf& model_of,
               const std::vector<std::string>& lines = {}) {
    measure(frame.t(), events);
    cv::Mat picture = evmarker::opencv::draw_frame(frame, scale(), std::chrono::milliseconds(120));
    std::vector<std::string> all{caption(frame.t())};
    all.insert(all.end(), lines.begin(), lines.end());
    const int below_lines = evmarker::opencv::draw_lines_of_text(picture, all);
    for (const evmarker::PoseEstimate& pose : poses) {
      const auto rate = pose_rates_.find(pose.id);
      evmarker::opencv::draw_marker(picture, camera_, model_of(pose.id), pose,
                                    rate == pose_rates_.end() ? "" : short_number(rate->second) + " poses/s",
                                    below_lines);
    }
    evmarker::opencv::draw_lines_of_text(picture, all);  // again, over the markers' edges
    return picture;
  }

 private:
  // Rates of camera time, over a time long enough to read them.
  void measure(evmarker::Timestamp t, std::uint64_t events) {
    constexpr std::uint64_t kPeriod_us = 250000;
    if (!since_ || t < *since_) {
      since_ = t;
      events_ = events;
      return;
    }
    const std::uint64_t since_us = evmarker::elapsed_us(*since_, t);
    if (since_us < kPeriod_us) return;
    const double seconds = 1e-6 * static_cast<double>(since_us);
    event_rate_ = static_cast<double>(events - events_) / seconds;
    pose_rates_.clear();
    const std::lock_guard lock(mutex_);
    for (const auto& [id, count] : poses_) pose_rates_[id] = static_cast<double>(count) / seconds;
    poses_.clear();
    since_ = t;
    events_ = events;
  }

  std::string caption(evmarker::Timestamp t) const {
    char time[48];
    std::snprintf(time, sizeof time, "%.2f s", 1e-6 * static_cast<double>(t));
    return time + (event_rate_ ? "  " + short_number(*event_rate_) + " events/s" : std::string());
  }

  evmarker::PinholeCamera camera_;
  std::optional<evmarker::Timestamp> since_;
  std::uint64_t events_ = 0;  // until then
  std::optional<double> event_rate_;
  std::map<evmarker::MarkerId, double> pose_rates_;
  std::mutex mutex_;
  std::map<evmarker::MarkerId, std::uint64_t> poses_;  // since then
};
