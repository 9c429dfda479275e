// Tracks the markers that a camera sees, or any file that OpenEB opens, while they are shown on the screen. Cameras are
// Prophesee's, by OpenEB, and iniVation's, by libcaer: those of the libraries that there were when this was built.
#include <algorithm>
#include <chrono>
#include <cinttypes>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/live/pipeline.hpp>
#include <evmarker/opencv/aruco_detector.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <exception>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <thread>
#include <type_traits>
#include <vector>

#include "console.hpp"
#include "interruption.hpp"
#include "live_options.hpp"
#include "recording_checks.hpp"
#include "screen.hpp"
#include "tracking_view.hpp"
#include "trigger_output.hpp"
#ifdef EVMARKER_HAS_OPENEB
#include "openeb_source.hpp"
#endif
#ifdef EVMARKER_HAS_LIBCAER
#include "libcaer_source.hpp"
#endif

using namespace evmarker;
using namespace std::chrono_literals;

namespace {

struct CameraOptions : LiveOptions {
  std::string serial;
  bool every_event = false, no_display = false;

  void add_to(CLI::App& app) {
    LiveOptions::add_to(app);
    CLI::Option* file = app.get_option("recording");
    CLI::Option* camera_serial = app.add_option("--serial", serial, kSerialHelp);
    if constexpr (kOpensFiles) {
      file->required(false)->description("any file that OpenEB opens, in place of a camera")->excludes(camera_serial);
      app.add_flag("--every-event", every_event,
                   "of a file: as fast as tracking goes and nothing dropped, for the poses of track_file")
          ->needs(file)
          ->excludes("--policy");
    } else {
      app.remove_option(file);
    }
    app.add_flag("--no-display", no_display, "no window but a line per second");
    app.footer(console::exit_codes("2 not both of --relative were found, "));
    app.get_option("--quiet")->description("no line per second");
  }

  template <PoseUpdateRule Rule>
  live::PipelineSettings<Rule> camera_settings(const typename Rule::Settings& rule, PoseOutput& poses,
                                               TriggerOutput& trigger_output) const {
    live::PipelineSettings<Rule> settings = pipeline_settings<Rule>(rule, poses);
    settings.on_trigger = [&](const TriggerEvent& trigger) { trigger_output.write(trigger); };
    if (!every_event) return settings;
    settings.overload = live::OverloadPolicy::block;
    settings.wait_for_detector = true;
    return settings;
  }

  std::string name() const { return recording.empty() ? "camera" : recording; }

  /// Calls `use(source)` with the file or the camera: the first that a library finds.
  template <typename Use>
  void with_source(const Use& use) const {
    std::string reasons;
    const auto with_camera_of = [&]<typename Source>(const std::type_identity<Source>&) {
      std::unique_ptr<Source> source;
      try {
        source = std::make_unique<Source>(serial);
      } catch (const std::runtime_error& error) {
        reasons += (reasons.empty() ? "" : "; ") + std::string(error.what());
        return false;
      }
      use(*source);
      return true;
    };
#ifdef EVMARKER_HAS_OPENEB
    if (!recording.empty()) {
      OpenEbSource source(recording, !every_event);
      return use(source);
    }
    if (with_camera_of(std::type_identity<OpenEbSource>())) return;
#endif
#ifdef EVMARKER_HAS_LIBCAER
    if (with_camera_of(std::type_identity<LibcaerSource>())) return;
#endif
    throw std::runtime_error(reasons);
  }

 private:
#ifdef EVMARKER_HAS_OPENEB
  static constexpr bool kOpensFiles = true;
#else
  static constexpr bool kOpensFiles = false;
#endif
#ifdef EVMARKER_HAS_LIBCAER
  static constexpr const char* kSerialHelp =
      "the camera with this serial number, or the eDVS at this port, as /dev/ttyUSB0; default: the first one";
#else
  static constexpr const char* kSerialHelp = "the camera with this serial number; default: the first one";
#endif
};

// Buffers events between the camera's thread and the picture; the camera's thread never waits for the drawing.
class EventTap {
 public:
  explicit EventTap(SensorSize size) : frame_(size) { waiting_.reserve(kMost); }

  template <EventLike E>
  void push(std::span<const E> events) {
    const std::lock_guard lock(mutex_);
    for (const E& event : events.last(std::min(events.size(), kMost - waiting_.size())))
      waiting_.push_back(to_event(event));
  }

  /// The frame at the time of the poses, so that events and poses match; with all events where nothing moves.
  const PolarityFrame& frame(const std::vector<PoseEstimate>& poses) {
    {
      const std::lock_guard lock(mutex_);
      taken_.insert(taken_.end(), waiting_.begin(), waiting_.end());
      waiting_.clear();
    }
    if (taken_.empty()) return frame_;
    constexpr Timestamp kMostBehind_us = 100000;
    Timestamp until = poses.empty() ? taken_.back().t : taken_.front().t;
    for (const PoseEstimate& pose : poses) until = std::max(until, pose.quality.updated_t);
    if (taken_.back().t - until > kMostBehind_us) until = taken_.back().t;
    const auto later = std::ranges::find_if(taken_, [&](const Event& event) { return event.t > until; });
    const SensorSize size = frame_.sensor_size();
    for (auto event = taken_.begin(); event != later; ++event)
      if (size.contains(event->x, event->y)) frame_.update(*event);
    taken_.erase(taken_.begin(), later);
    return frame_;
  }

 private:
  static constexpr std::size_t kMost = 1u << 20;  // between two pictures; they need no more
  std::mutex mutex_;
  std::vector<Event> waiting_, taken_;
  PolarityFrame frame_;
};

std::string latency_text(const live::Status& s) {
  if (s.push_to_pose.count == 0) return "no pose yet";
  char text[96];
  std::snprintf(text, sizeof text, "latency %.0f us, 99 %% within %.0f us", s.push_to_pose.p50_us,
                s.push_to_pose.p99_us);
  return text;
}

std::vector<std::string> overlay_lines(const live::Status& s) {
  std::vector<std::string> lines{latency_text(s)};
  if (s.dropped > 0) lines.push_back(std::to_string(s.dropped) + " events dropped");
  return lines;
}

/// A line on the terminal once a second.
class StatusLines {
 public:
  void print_if_due(const live::Status& s) {
    const auto now = live::Clock::now();
    const std::chrono::duration<double> since = now - last_;
    if (since < 1s) return;
    const auto rate = [&](std::uint64_t a, std::uint64_t b) {
      return short_number(static_cast<double>(a - b) / since.count());
    };
    std::string markers;
    for (const live::MarkerStatus& marker : s.markers)
      markers += ", marker " + std::to_string(marker.id) + " " + to_string(marker.state);
    std::printf("%.0f s: %s events/s, %s poses/s, %s, %" PRIu64 " dropped%s\n",
                std::chrono::duration<double>(now - start_).count(), rate(s.events, events_).c_str(),
                rate(s.poses, poses_).c_str(), latency_text(s).c_str(), s.dropped,
                markers.empty() ? ", no marker" : markers.c_str());
    std::fflush(stdout);
    last_ = now;
    events_ = s.events;
    poses_ = s.poses;
  }

 private:
  live::Clock::time_point start_ = live::Clock::now(), last_ = start_;
  std::uint64_t events_ = 0, poses_ = 0;
};

// The window and what it shows; without a window, nothing.
class Display {
 public:
  Display(const PinholeCamera& camera, bool wanted) : view_(camera), tap_(camera.sensor_size()) {
    if (wanted && Window::possible()) window_.emplace("track_camera");
  }

  bool shown() const { return window_.has_value(); }
  bool closed() const { return window_ && window_->closed(); }

  void add(const PoseEstimate& pose) {
    if (window_) view_.add(pose);
  }
  template <EventLike E>
  void add(std::span<const E> events) {
    if (window_) tap_.push(events);
  }

  /// Draws the poses of the last updates and the events before them, and waits for the keyboard until the given time.
  template <typename Pipeline, typename ModelOf>
  void show(const Pipeline& pipeline, const live::Status& status, const ModelOf& model_of,
            live::Clock::time_point until) {
    const auto poses = pipeline.poses_at(std::numeric_limits<Timestamp>::min());  // not moved on
    window_->show(view_.draw(tap_.frame(poses), status.events, poses, model_of, overlay_lines(status)), until);
  }

 private:
  std::optional<Window> window_;
  TrackingView view_;
  EventTap tap_;
};

// Shows the tracking until the events end, the window is closed or a signal comes.
template <typename Source, typename Pipeline, typename ModelOf>
void watch(Source& source, const Pipeline& pipeline, Display& display, const ModelOf& model_of, bool quiet) {
  StatusLines lines;
  while (source.running() && !interruption::requested && !display.closed()) {
    const live::Status status = pipeline.status();
    if (!status.error.empty()) break;
    const auto until = live::Clock::now() + 40ms;
    if (display.shown())
      display.show(pipeline, status, model_of, until);
    else
      std::this_thread::sleep_until(until);
    if (!display.shown() && !quiet) lines.print_if_due(status);
  }
}

template <PoseUpdateRule Rule, typename Source>
void track(const CameraOptions& options, const PinholeCamera& camera, const typename Rule::Settings& rule,
           io::PoseColumns columns, Source& source) {
  recording_checks::require_size(source.sensor_size(), options.name(), camera.sensor_size(), options.camera.path);
  auto detector = options.detector(camera);
  Display display(camera, !options.no_display);
  PoseOutput output(options, options.track_one(), columns);
  TriggerOutput triggers(options.triggers);

  live::Pipeline pipeline(
      camera, detector,
      [&](const PoseEstimate& pose) {
        output.write(pose);
        display.add(pose);
      },
      options.camera_settings<Rule>(rule, output, triggers));
  source.start(
      [&](std::span<const typename Source::Event> events) {
        pipeline.push(events);
        display.add(events);
      },
      [&](const TriggerEvent& trigger) { pipeline.push(trigger); });
  const struct Stop {  // also after an exception: the camera's thread uses the pipeline
    Source& source;
    ~Stop() {
      try {
        source.stop();
      } catch (const std::exception&) {  // of a camera that has failed: why is reported already
      }
    }
  } stop{source};
  const auto start = live::Clock::now();
  watch(
      source, pipeline, display, [&](MarkerId id) { return detector.model(id); }, options.quiet);

  const bool ended = !source.running(), interrupted = interruption::requested;
  source.stop();
  pipeline.flush();
  pipeline.stop();
  output.close();  // after a failure of the camera, too: what was tracked until then is right
  triggers.close();
  if (const std::string error = source.error(); !error.empty()) throw std::runtime_error(options.name() + ": " + error);
  if (ended && options.recording.empty()) throw std::runtime_error("camera: it stopped and gave no reason");
  if (!interrupted) std::printf("ended: %s\n", ended ? "end of the file" : "window closed");
  output.print();
  print_last_line(pipeline.status());
  if (!interrupted) {
    if (const std::string none = output.no_relative(); !none.empty()) throw console::Exit(kNothingFound, none);
    return;
  }
  std::vector<std::string> kept = output.kept();
  for (const std::string& file : triggers.kept()) kept.push_back(file);
  interruption::end(std::chrono::duration<double>(live::Clock::now() - start).count(), kept);
}

template <PoseUpdateRule Rule>
void track(const CameraOptions& options, const typename Rule::Settings& rule, io::PoseColumns columns) {
  require_distinct(options.files_read(), {{"--output", options.output}, {"--triggers", options.triggers}});
  interruption::watch();
  const PinholeCamera camera = options.camera.load();
  options.detector(camera);  // what is wrong with the options is said before a camera is looked for
  options.with_source([&](auto& source) { track<Rule>(options, camera, rule, columns, source); });
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<CameraOptions>(
      "track_camera", "Tracks fiducial markers with an event camera, live, and shows them.", argc, argv,
      [](const CameraOptions& options) {
        options.with_rule([&]<PoseUpdateRule Rule>(const auto&... chosen) { track<Rule>(options, chosen...); });
      });
}
