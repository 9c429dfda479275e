#pragma once
// What people see of a recording: a picture of its end, a video, a window; frames at a fixed rate of recorded time.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/output_file.hpp>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "screen.hpp"
#include "tracking_view.hpp"

struct ViewerOptions {
  std::string overlay, video;
  double video_fps = 50;
  bool show = false;
};

class Viewer {
 public:
  /// @throws std::runtime_error where the picture or video cannot be written, or no window can be opened
  Viewer(const evmarker::PinholeCamera& camera, const ViewerOptions& options)
      : wanted_(!options.overlay.empty() || !options.video.empty() || options.show),
        period_us_(options.video.empty() && !options.show ? 1e5 : 1e6 / options.video_fps),
        view_(camera),
        picture_ending_(std::filesystem::path(options.overlay).extension().string()) {
    if (!options.overlay.empty()) {
      if (picture_ending_.empty() || !cv::haveImageWriter(options.overlay))
        throw std::runtime_error(options.overlay + ": no picture has the ending '" + picture_ending_ + "'; try .png");
      picture_file_.emplace(options.overlay);
    }
    if (options.show) {
      if (!Window::possible()) throw std::runtime_error("--show: no window can be opened here; try --video");
      window_.emplace("track_file");
    }
    if (!options.video.empty()) video_.emplace(options.video, options.video_fps, view_.picture_size());
  }

  void add(const evmarker::PoseEstimate& pose) {
    if (wanted_) view_.add(pose);
  }

  /// Takes every frame that is due before an event of time `t`; `model_of` gives the model of a marker's id.
  template <typename Tracker, typename ModelOf>
  void advance(evmarker::Timestamp t, const Tracker& tracker, const ModelOf& model_of) {
    using evmarker::elapsed_us;
    constexpr std::uint64_t kStepBack_us = 100000, kJump_us = 1000000;  // the clock was set, no time passed
    if (!wanted_) return;
    const bool jumped = t < last_t_ ? elapsed_us(t, last_t_) > kStepBack_us : elapsed_us(last_t_, t) > kJump_us;
    if (!started_ || jumped) restart(t);
    last_t_ = std::max(last_t_, t);
    for (; due(t); next_us_ = frame_us(++frames_since_start_ + 1)) take(tracker, model_of);
  }

  /// The first of some events, and those after it that come before a frame is due.
  std::span<const evmarker::Event> before_next_frame(std::span<const evmarker::Event> events) const {
    if (!wanted_) return events;
    std::size_t count = 1;
    while (count < events.size() && !due(events[count].t) && events[count].t >= last_t_) ++count;
    return events.first(count);
  }

  /// Takes the last frame and completes the files.
  template <typename Tracker, typename ModelOf>
  void finish(const Tracker& tracker, const ModelOf& model_of) {
    if (!wanted_) return;
    take(tracker, model_of);
    if (picture_file_) {
      std::vector<uchar> bytes;
      cv::imencode(picture_ending_, picture_, bytes);
      picture_file_->write(std::as_bytes(std::span(bytes)));
      picture_file_->close();
    }
    if (video_) video_->close();
  }

 private:
  void restart(evmarker::Timestamp t) {
    started_ = true;
    start_t_ = last_t_ = t;
    frames_since_start_ = 0;
    next_us_ = frame_us(1);
  }

  // Time of a frame since the start, so that a period which is no whole microsecond adds up.
  std::uint64_t frame_us(std::uint64_t number) const {
    return static_cast<std::uint64_t>(std::llround(static_cast<double>(number) * period_us_));
  }

  bool due(evmarker::Timestamp t) const { return t >= start_t_ && evmarker::elapsed_us(start_t_, t) >= next_us_; }

  template <typename Tracker, typename ModelOf>
  void take(const Tracker& tracker, const ModelOf& model_of) {
    std::vector<evmarker::PoseEstimate> poses;  // Clang 14 cannot compile libstdc++'s views::transform
    for (const auto& marker : tracker.markers()) poses.push_back(marker.estimate());
    const bool any = !tracker.markers().empty();
    const bool moving = video_ || (window_ && !window_->closed());
    if (!moving && (!picture_file_ || (shows_marker_ && !any))) return;  // the picture is the last one of a marker
    const cv::Mat picture = view_.draw(tracker.polarity_frame(), tracker.statistics().events, poses, model_of);
    if (any || !shows_marker_) picture_ = picture;
    shows_marker_ = shows_marker_ || any;
    if (video_) video_->write(picture);
    if (window_) show(picture);
  }

  // At the pace of the recording, or as fast as tracking goes.
  void show(const cv::Mat& picture) {
    const auto now = std::chrono::steady_clock::now();
    shown_until_ = std::max(shown_until_, now) + std::chrono::microseconds(std::llround(period_us_));
    window_->show(picture, shown_until_);
  }

  bool wanted_;
  double period_us_;
  TrackingView view_;
  std::string picture_ending_;
  std::optional<evmarker::io::OutputFile> picture_file_;
  std::optional<VideoFile> video_;
  std::optional<Window> window_;

  bool started_ = false;
  evmarker::Timestamp start_t_ = 0, last_t_ = 0;
  std::uint64_t frames_since_start_ = 0, next_us_ = 0;
  bool shows_marker_ = false;
  cv::Mat picture_;
  std::chrono::steady_clock::time_point shown_until_{};
};
