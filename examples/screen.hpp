#pragma once
// A window and a video file. Both need parts of OpenCV that a machine without a screen may lack.
#include <filesystem>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

#ifdef EVMARKER_HAS_SCREEN

#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <evmarker/io/output_file.hpp>
#include <map>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/highgui.hpp>
#include <opencv2/videoio.hpp>
#include <system_error>
#include <utility>
#include <vector>

class Window {
 public:
  /// Whether a window can be opened. Call it before there are other threads: a screen that cannot be reached ends the
  /// whole process, so that another one has to try.
  static bool possible() {
    const pid_t child = fork();
    if (child == 0) {
      std::signal(SIGABRT, [](int) { _exit(1); });
      const bool silent = std::freopen("/dev/null", "w", stderr) != nullptr;
      try {
        cv::namedWindow("evmarker", cv::WINDOW_NORMAL);
      } catch (...) {
        _exit(1);
      }
      _exit(silent ? 0 : 1);
    }
    int status = -1;
    return child > 0 && waitpid(child, &status, 0) == child && status == 0;
  }

  explicit Window(std::string title) : title_(std::move(title)) {
    cv::namedWindow(title_, cv::WINDOW_NORMAL | cv::WINDOW_KEEPRATIO | cv::WINDOW_GUI_NORMAL);
  }
  Window(const Window&) = delete;
  Window& operator=(const Window&) = delete;
  ~Window() {
    if (!closed_) cv::destroyWindow(title_);
  }

  /// Shows a picture until the given time, or until somebody closes the window or presses Escape or q.
  void show(const cv::Mat& picture, std::chrono::steady_clock::time_point until) {
    if (closed_) return;
    if (!resized_) cv::resizeWindow(title_, picture.size());
    resized_ = true;
    cv::imshow(title_, picture);
    do {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - std::chrono::steady_clock::now());
      const int key = cv::waitKey(static_cast<int>(std::clamp<std::int64_t>(left.count(), 1, 50)));
      const bool visible = cv::getWindowProperty(title_, cv::WND_PROP_VISIBLE) > 0;
      if (visible && (key == 27 || key == 'q')) cv::destroyWindow(title_);
      closed_ = !visible || key == 27 || key == 'q';
    } while (!closed_ && std::chrono::steady_clock::now() < until);
  }

  bool closed() const { return closed_; }

 private:
  std::string title_;
  bool resized_ = false, closed_ = false;
};

/// A video that appears under its name only when it is whole.
class VideoFile {
 public:
  /// @throws std::runtime_error where it cannot be written
  VideoFile(const std::filesystem::path& path, double fps, cv::Size size)
      : path_(path), target_(evmarker::io::link_target(path)), part_(target_) {
    const std::string ending = path.extension().string();
    part_.replace_extension(".part" + ending);  // the ending selects the container
    const auto codecs = kCodecs.find(ending);
    if (codecs == kCodecs.end()) throw fail("no video has the ending '" + ending + "'; try .mp4");
    { const evmarker::io::OutputFile probe(path); }  // throws with the reason if it cannot be created
    const Silence silence;
    for (const auto& codec : codecs->second)
      if (writer_.open(part_.string(), cv::VideoWriter::fourcc(codec[0], codec[1], codec[2], codec[3]), fps, size))
        return;
    remove_part();
    throw fail("OpenCV's videoio has no codec here for " + std::to_string(size.width) + " x " +
               std::to_string(size.height) + " px at " + std::to_string(fps) + " frames/s; try .avi");
  }
  VideoFile(const VideoFile&) = delete;
  VideoFile& operator=(const VideoFile&) = delete;
  ~VideoFile() {
    if (!writer_.isOpened()) return;
    writer_.release();
    remove_part();
  }

  void write(const cv::Mat& picture) {
    writer_.write(picture);
    ++frames_;
  }

  /// @throws std::runtime_error where frames are missing, as on a full disk: the writer reports no errors
  void close() {
    if (!writer_.isOpened()) return;
    writer_.release();
    const Silence silence;
    const double written = cv::VideoCapture(part_.string()).get(cv::CAP_PROP_FRAME_COUNT);
    std::error_code error;
    if (written + 0.5 >= static_cast<double>(frames_)) {
      std::filesystem::rename(part_, target_, error);
      if (!error) return;
    }
    remove_part();
    throw fail(error ? error.message()
                     : "cannot write: " + std::to_string(static_cast<long>(written)) + " of " +
                           std::to_string(frames_) + " frames arrived");
  }

 private:
  // Mutes OpenCV's own messages about what fails: the one line of the error is enough.
  class Silence {
   public:
    Silence() = default;
    Silence(const Silence&) = delete;
    Silence& operator=(const Silence&) = delete;
    ~Silence() { cv::utils::logging::setLogLevel(level_); }

   private:
    cv::utils::logging::LogLevel level_ = cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  };

  // The first that works: not every build of OpenCV can write H.264.
  inline static const std::map<std::string, std::vector<std::string>> kCodecs{
      {".mp4", {"avc1", "mp4v"}}, {".mkv", {"H264", "mp4v"}}, {".avi", {"MJPG"}}};

  std::runtime_error fail(const std::string& reason) const {
    return std::runtime_error(path_.string() + ": " + reason);
  }

  void remove_part() noexcept {
    std::error_code ignored;
    std::filesystem::remove(part_, ignored);
  }

  std::filesystem::path path_, target_, part_;
  cv::VideoWriter writer_;
  std::uint64_t frames_ = 0;
};

#else

#include <chrono>

class Window {
 public:
  static bool possible() { return false; }
  explicit Window(const std::string&) { throw std::runtime_error("built without OpenCV's highgui"); }
  void show(const cv::Mat&, std::chrono::steady_clock::time_point) {}
  bool closed() const { return true; }
};

class VideoFile {
 public:
  VideoFile(const std::filesystem::path& path, double, cv::Size) {
    throw std::runtime_error(path.string() + ": built without OpenCV's videoio");
  }
  void write(const cv::Mat&) {}
  void close() {}
};

#endif
