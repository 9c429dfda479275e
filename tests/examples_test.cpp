// What a user of the programs in examples/ meets: the way from a recording to its error, the README's code, bad input.
// One CTest runs all cases, in one process: they share a simulated recording.
#include <doctest/doctest.h>
#include <fcntl.h>
#include <poll.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <random>
#include <regex>
#include <sstream>
#include <string>
#include <thread>
#include <tuple>
#include <utility>
#include <variant>
#include <vector>

#include "evmarker/io/csv_writer.hpp"
#include "evmarker/io/event_reader.hpp"
#include "evmarker/io/raw_reader.hpp"
#include "evmarker/io/raw_writer.hpp"
#include "evmarker/opencv/aruco_shim.hpp"
#include "evmarker/opencv/board.hpp"
#include "evmarker/opencv/calibration.hpp"
#include "io/hdf5_bytes.hpp"
#include "io/recording_bytes.hpp"
#include "io/ros_bytes.hpp"
#include "io/test_support.hpp"
#include "sanitized.hpp"

#ifdef EVMARKER_HAS_SCREEN
#include <opencv2/videoio.hpp>
#endif

using namespace evmarker::io::test;

namespace {

const std::map<std::string, std::string> kPrograms{
    {"quickstart", EVMARKER_QUICKSTART},   {"paper", EVMARKER_PAPER},           {"simulate", EVMARKER_SIMULATE},
    {"track_file", EVMARKER_TRACK_FILE},   {"evaluate", EVMARKER_EVALUATE},     {"replay", EVMARKER_REPLAY},
    {"print_board", EVMARKER_PRINT_BOARD}, {"make_board", EVMARKER_MAKE_BOARD}, {"calibrate", EVMARKER_CALIBRATE},
    {"calibration", EVMARKER_CALIBRATION}, {"convert", EVMARKER_CONVERT},       {"info", EVMARKER_INFO}};
#ifdef EVMARKER_HAS_SCREEN
constexpr bool kScreen = true;
#else
constexpr bool kScreen = false;
#endif
const std::filesystem::path kSource = EVMARKER_SOURCE_DIR;
const std::string kOptions = " --camera camera.yml --marker-length 0.10";
const char* const kPoseHeader =
    "t_us,marker_id,state,tx,ty,tz,qx,qy,qz,qw,matched,residual_px,backtrack_px,backtrack_rad,health,loss_reason";

const char* const kBoard = R"(board: 100
markers:
  - { id: 1, length: 0.05, rotation: [0, 0, 0], translation: [-0.04, 0, 0] }
  - { id: 2, length: 0.05, rotation: [0, 0, 0], translation: [0.04, 0, 0] }
)";

// The black square of marker 7 as four edges.
const char* const kTwoCameras = "cam0:\n  intrinsics: [500, 500, 320, 240]\ncam1:\n  intrinsics: [1]\n";

const char* const kBody = R"(wireframe: 200
vertices: [[-0.05, 0.05, 0], [0.05, 0.05, 0], [0.05, -0.05, 0], [-0.05, -0.05, 0]]
edges:
  - { from: 0, to: 1, dark_side: [0, -1, 0], face_normal: [0, 0, 1] }
  - { from: 1, to: 2, dark_side: [-1, 0, 0], face_normal: [0, 0, 1] }
  - { from: 2, to: 3, dark_side: [0, 1, 0], face_normal: [0, 0, 1] }
  - { from: 3, to: 0, dark_side: [1, 0, 0], face_normal: [0, 0, 1] }
)";

struct Result {
  int code = -1;
  std::string out, err;
};

/// `track_file recording.raw ...` and the like with the program's path.
std::string with_path(const std::string& command) {
  const auto space = std::min(command.find(' '), command.size());
  return "'" + kPrograms.at(command.substr(0, space)) + "'" + command.substr(space);
}

Result result_of(const TemporaryFolder& folder, int status) {
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_file(folder / "stdout.txt"),
          read_file(folder / "stderr.txt")};
}

/// Runs `track_file recording.raw ...` and the like in a folder, reading what `input` prints.
Result run(const TemporaryFolder& folder, const std::string& command, const std::string& err_to = "stderr.txt",
           const std::string& input = "") {
  const std::string line =
      "cd '" + (folder / "").string() + "' && " + input + with_path(command) + " >stdout.txt 2>" + err_to;
  return result_of(folder, std::system(line.c_str()));
}

/// A program that runs beside the test, and receives signals.
class Child {
 public:
  Child(const TemporaryFolder& folder, const std::string& command)
      : folder_(folder),
        line_("cd '" + (folder / "").string() + "' && exec " + with_path(command) + " >stdout.txt 2>stderr.txt") {
    int until_exec[2];  // until then, it catches signals as the test does
    REQUIRE(::pipe2(until_exec, O_CLOEXEC) == 0);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::signal(SIGINT, SIG_DFL);  // a test in the background may ignore it
      ::execl("/bin/sh", "sh", "-c", line_.c_str(), nullptr);
      ::_exit(127);
    }
    ::close(until_exec[1]);
    char none = 0;
    CHECK(::read(until_exec[0], &none, 1) == 0);
    ::close(until_exec[0]);
  }
  ~Child() {
    if (running()) ::kill(pid_, SIGKILL);
    wait();
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  bool running() {
    if (!status_ && ::waitpid(pid_, &ended_, WNOHANG) == pid_) status_ = ended_;
    return !status_;
  }

  /// Waits for something that the program does; false if it ends without.
  bool wait_until(const std::function<bool()>& done) {
    while (running() && !done()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    return done();
  }

  /// True while the program does not leave a signal to the system.
  bool catches(int signal) const {
    std::error_code gone;  // the shell that starts the program catches signals, too, until it has become the program
    if (std::filesystem::equivalent("/proc/" + std::to_string(pid_) + "/exe", "/bin/sh", gone)) return false;
    const std::string status = read_file("/proc/" + std::to_string(pid_) + "/status");
    const auto at = status.find("SigCgt:");
    return at != std::string::npos && (std::stoull(status.substr(at + 7), nullptr, 16) >> (signal - 1) & 1) != 0;
  }

  /// True while the program has this file open.
  bool reads(const std::filesystem::path& file) const {
    std::error_code gone;
    const std::filesystem::directory_iterator open("/proc/" + std::to_string(pid_) + "/fd", gone);
    return std::any_of(begin(open), end(open),
                       [&](const auto& entry) { return std::filesystem::read_symlink(entry.path(), gone) == file; });
  }

  void kill(int signal) { ::kill(pid_, signal); }

  Result wait() {
    if (running() && ::waitpid(pid_, &ended_, 0) == pid_) status_ = ended_;
    return result_of(folder_, *status_);
  }
  /// The signal that ended it, or 0.
  int ended_by() const { return WIFSIGNALED(*status_) ? WTERMSIG(*status_) : 0; }

 private:
  const TemporaryFolder& folder_;
  std::string line_;
  pid_t pid_ = -1;
  int ended_ = 0;
  std::optional<int> status_;
};

/// Recording, calibration and truth, simulated once.
const TemporaryFolder& simulated() {
  static const TemporaryFolder folder;
  static const Result result = run(
      folder, "simulate recording.raw --calibration camera.yml --truth truth.csv --ids 7 --duration 0.6 --noise 0.3");
  REQUIRE_MESSAGE(result.code == 0, result.err);
  REQUIRE(result.err.empty());
  return folder;
}

std::string simulated_file(const char* name) { return read_file(simulated() / name); }

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  auto at = text.find(what);
  REQUIRE_MESSAGE(at != std::string::npos, what);
  for (; at != std::string::npos; at = text.find(what, at + with.size())) text.replace(at, what.size(), with);
  return text;
}

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts;
  std::istringstream in(text);
  for (std::string part; std::getline(in, part, separator);) parts.push_back(part);
  return parts;
}

struct Row {
  double t_us = 0;
  std::string id, state;
  Eigen::Vector3d translation;
  Eigen::Quaterniond rotation;
};

std::vector<Row> read_table(const std::string& text) {
  std::vector<Row> rows;
  const auto lines = split(text, '\n');
  REQUIRE(!lines.empty());
  const std::size_t columns = split(lines[0], ',').size();  // a rule may add some behind the 14 of every one
  REQUIRE(lines[0].starts_with(kPoseHeader));
  for (std::size_t i = 1; i < lines.size(); ++i) {
    const auto f = split(lines[i], ',');
    REQUIRE(f.size() == columns);
    const auto number = [&](std::size_t column) { return std::stod(f[column]); };
    rows.push_back({number(0), f[1], f[2], {number(3), number(4), number(5)}, {}});
    rows.back().rotation = Eigen::Quaterniond(number(9), number(6), number(7), number(8));
  }
  return rows;
}

struct MeanError {
  std::size_t poses = 0;
  double mm = 0, deg = 0;
};

/// By hand, so that it owes nothing to the code that `evaluate` is made of.
MeanError mean_tracking_error(const std::vector<Row>& poses, const std::vector<Row>& truth) {
  MeanError error;
  for (const Row& pose : poses) {
    if (pose.state != "tracking") continue;
    const auto after = std::ranges::lower_bound(truth, pose.t_us, {}, &Row::t_us);
    if (after == truth.begin() || after == truth.end()) continue;
    const auto before = after - 1;
    const double part = (pose.t_us - before->t_us) / (after->t_us - before->t_us);
    const Eigen::Vector3d translation = (1 - part) * before->translation + part * after->translation;
    const Eigen::Quaterniond rotation = before->rotation.slerp(part, after->rotation);
    ++error.poses;
    error.mm += 1000 * (pose.translation - translation).norm();
    error.deg += pose.rotation.angularDistance(rotation) * 180 / std::numbers::pi;
  }
  error.mm /= static_cast<double>(error.poses);
  error.deg /= static_cast<double>(error.poses);
  return error;
}

/// The whole recording with `bytes` in place of what follows its header.
std::string with_body(const std::function<std::string(std::string)>& change) {
  const std::string whole = simulated_file("recording.raw");
  const auto body = whole.find("% end\n") + 6;
  return whole.substr(0, body) + change(whole.substr(body));
}

std::string random_bytes(std::size_t count) {
  std::mt19937 random(5);
  std::string bytes(count, '\0');
  for (char& byte : bytes) byte = static_cast<char>(random() & 0xFF);
  return bytes;
}

/// Lines of a plausible text recording; those from `off` on lie at x = 640.
std::string text_events(int count, int off, int every_us = 10) {
  std::string text;
  for (int i = 0; i < count; ++i)
    text += std::to_string(i < off ? 100 + i % 300 : 640) + "," + std::to_string(i % 40) + ",1," +
            std::to_string(every_us * i) + "\n";
  return text;
}

}  // namespace

TEST_CASE("examples: simulate, track_file, evaluate from end to end") {
  const TemporaryFolder& folder = simulated();
  const Result tracked =
      run(folder, "track_file recording.raw" + kOptions +
                      " --update decoupled --dictionary DICT_4X4_50 --output poses.csv --overlay overlay.png --truth "
                      "truth.csv");
  REQUIRE_MESSAGE(tracked.code == 0, tracked.err);
  CHECK(tracked.err.empty());  // no bar where stderr is a file
  for (const char* expected : {"events ", " read, ", " kept by the filter", " matched", "marker 7 ",
                               " poses, the first at ", "lost 0 times", " mm ", " of recording"})
    CHECK_MESSAGE(contains(tracked.out, expected), tracked.out);

  const std::string table = read_file(folder / "poses.csv");
  CHECK(table.substr(0, table.find('\n')) == kPoseHeader);
  const auto poses = read_table(table), truth = read_table(simulated_file("truth.csv"));
  REQUIRE(truth.size() == 601);
  for (const Row& pose : poses) CHECK(pose.id == "7");
  const MeanError error = mean_tracking_error(poses, truth);
  REQUIRE(error.poses > 500);
  CHECK(error.mm < 6);
  CHECK(error.deg < 2.5);

  const Result evaluated = run(folder, "evaluate poses.csv --truth truth.csv --errors errors.csv");
  REQUIRE_MESSAGE(evaluated.code == 0, evaluated.err);
  CHECK(evaluated.err.empty());
  const auto lines = split(evaluated.out, '\n');
  REQUIRE(lines.size() == 3);
  CHECK(lines[2] == "written to errors.csv");
  std::istringstream line(lines[1]);
  std::size_t id = 0, count = 0;
  double mm = 0, deg = 0;
  line >> id >> count >> mm >> deg;
  CHECK(id == 7);
  CHECK(count == error.poses);
  CHECK(mm == doctest::Approx(error.mm).epsilon(0.01).scale(0));
  CHECK(deg == doctest::Approx(error.deg).epsilon(0.01).scale(0));
  CHECK(split(read_file(folder / "errors.csv"), '\n').size() == poses.size() + 1);

  const cv::Mat picture = cv::imread((folder / "overlay.png").string());
  REQUIRE(picture.cols == 1280);
  REQUIRE(picture.rows == 960);
  const cv::Vec3b background = picture.at<cv::Vec3b>(0, 0);
  CHECK(std::count_if(picture.begin<cv::Vec3b>(), picture.end<cv::Vec3b>(),
                      [&](const cv::Vec3b& pixel) { return pixel != background; }) > 10000);
  CHECK_FALSE(std::filesystem::exists(folder / "poses.csv.part"));
  CHECK_FALSE(std::filesystem::exists(folder / "overlay.png.part"));
}

#ifdef EVMARKER_HAS_SCREEN

namespace {

/// Of the calibration that `simulate` writes, in a picture of twice the sensor's size.
cv::Point in_picture(const Eigen::Vector3d& P) {
  const auto pixel = [](double centre, double ratio) {
    return static_cast<int>(std::lround(2 * (centre + 533 * ratio) + 0.5));
  };
  return {pixel(319.5, P.x() / P.z()), pixel(239.5, P.y() / P.z())};
}

/// Pixels within 3 px in which one of the colours (blue, green, red) leaves the others far behind.
int count_of_color(const cv::Mat& picture, cv::Point at, int channel) {
  const cv::Mat patch = picture(cv::Rect(at.x - 3, at.y - 3, 7, 7) & cv::Rect({}, picture.size()));
  return static_cast<int>(std::count_if(patch.begin<cv::Vec3b>(), patch.end<cv::Vec3b>(), [&](const cv::Vec3b& c) {
    return c[channel] > 150 && c[channel] > c[(channel + 1) % 3] + 80 && c[channel] > c[(channel + 2) % 3] + 80;
  }));
}

}  // namespace

TEST_CASE("examples: a video has a frame for every 20 ms of the recording and the axes where the marker is") {
  const TemporaryFolder& folder = simulated();
  const auto truth = read_table(simulated_file("truth.csv"));
  const Result without = run(folder, "track_file recording.raw" + kOptions + " --output without.csv");
  REQUIRE_MESSAGE(without.code == 0, without.err);
  struct Case {
    std::string options, file;
    int fps;
  };
  for (const auto& film : std::vector<Case>{
           {"", "film.mp4", 50}, {" --video-fps 25", "film.avi", 25}, {" --video-fps 100", "film.mkv", 100}}) {
    CAPTURE(film.file);
    const auto& [options, file, fps] = film;
    const Result result = run(folder, "track_file recording.raw" + kOptions + options + " --video " + file +
                                          " --overlay last.png --output with.csv");
    REQUIRE_MESSAGE(result.code == 0, result.err);
    CHECK(result.err.empty());
    CHECK(read_file(folder / "with.csv") == read_file(folder / "without.csv"));
    for (const char* part : {"film.part.mp4", "film.part.avi", "film.part.mkv"})
      CHECK_FALSE(std::filesystem::exists(folder / part));

    cv::VideoCapture video((folder / file.c_str()).string());
    REQUIRE(video.isOpened());
    CHECK(video.get(cv::CAP_PROP_FPS) == doctest::Approx(fps));
    int frames = 0, with_axes = 0;
    cv::Mat frame, last;
    while (video.read(frame)) {
      frame.copyTo(last);
      REQUIRE(frame.size() == cv::Size(1280, 960));
      cv::Scalar mean, spread;
      cv::meanStdDev(frame, mean, spread);
      CHECK(cv::norm(spread) > 3);  // not empty: the text alone makes more
      ++frames;
      const auto ms = static_cast<std::size_t>(frames * 1000 / fps);
      if (ms < 100 || ms >= truth.size()) continue;
      const Eigen::Vector3d origin = truth[ms].translation;
      const auto at = [&](const Eigen::Vector3d& offset) { return in_picture(origin + truth[ms].rotation * offset); };
      const bool x_red = count_of_color(frame, at({0.02, 0, 0}), 2) > 3;
      const bool y_green = count_of_color(frame, at({0, 0.02, 0}), 1) > 3;
      const bool elsewhere = count_of_color(frame, at({-0.02, 0, 0}), 2) > 3;  // where the axis would be if mirrored
      with_axes += x_red && y_green && !elsewhere;
    }
    CHECK(frames == 6 * fps / 10);
    CHECK(with_axes >= frames - fps / 10 - 2);  // the marker is found long before 100 ms
    CHECK(cv::norm(last, cv::imread((folder / "last.png").string()), cv::NORM_L1) / (1280 * 960 * 3) < 4);
  }
}

#endif

// The tests of replay ask for poses of a recording of 0.6 s. With a sanitizer, beside other work, a detection
// takes half a second and more, and two must be over long before the recording's end.
constexpr double kReplaySpeed = kSanitized ? 0.02 : 0.2;

TEST_CASE("examples: replay plays a recording at its own pace, tracks it and accounts for every event") {
  if (kPrograms.at("replay").empty()) {
    MESSAGE("skipped: built without the component live");
    return;
  }
  const TemporaryFolder& folder = simulated();
  const auto start = std::chrono::steady_clock::now();
  const Result result = run(folder, "replay recording.raw" + kOptions + " --speed " + std::to_string(kReplaySpeed) +
                                        " --policy block --poses live.csv");
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
  REQUIRE_MESSAGE(result.code == 0, result.err);
  CHECK(result.err.empty());
  CHECK(wall.count() > 0.55 / kReplaySpeed);  // the recording has 0.6 s
  CHECK(contains(result.out, "latency from push to pose"));

  const auto lines = split(result.out, '\n');
  std::map<std::string, double> reported;
  REQUIRE(lines.back().starts_with("latency_us "));
  for (const std::string& field : split(lines.back().substr(11), ' '))
    reported[field.substr(0, field.find('='))] = std::stod(field.substr(field.find('=') + 1));
  REQUIRE(reported.size() == 7);
  CHECK(reported["p50"] > 0);
  CHECK(reported["p50"] <= reported["p99"]);
  CHECK(reported["p99"] <= reported["max"]);
  const Result offline = run(folder, "track_file recording.raw" + kOptions);
  CHECK_MESSAGE(contains(offline.out, std::to_string(static_cast<int>(reported["events"])) + " read"), offline.out);
  CHECK(reported["filtered"] > 0);
  CHECK(reported["filtered"] < reported["events"]);
  CHECK(reported["dropped"] == 0);

  const auto poses = read_table(read_file(folder / "live.csv")), truth = read_table(simulated_file("truth.csv"));
  CHECK(reported["poses"] == static_cast<double>(poses.size()));
  for (const Row& pose : poses) CHECK(pose.id == "7");
  const MeanError error = mean_tracking_error(poses, truth);
  REQUIRE(error.poses > 500);
  CHECK(error.mm < 6);
  CHECK(error.deg < 2.5);

  for (const auto& [option, part] : std::map<std::string, std::string>{{" --policy all", "--policy"},
                                                                       {" --speed 0", "--speed"},
                                                                       {" --queue-events 10", "--queue-events"},
                                                                       {" --delays missing/d.csv", "missing/d.csv"},
                                                                       {" --output missing/o.csv", "missing/o.csv"}}) {
    const Result bad = run(folder, "replay recording.raw" + kOptions + option);
    CAPTURE(bad.err);
    CHECK(bad.code > 0);
    CHECK(std::ranges::count(bad.err, '\n') == 1);
    CHECK(contains(bad.err, part));
    CHECK(bad.out.empty());
  }
}

TEST_CASE("examples: replay passes trigger events on, writes poses at a fixed rate and reports every delay") {
  if (kPrograms.at("replay").empty()) {
    MESSAGE("skipped: built without the component live");
    return;
  }
  const TemporaryFolder& folder = simulated();
  evmarker::io::RawReader reader(folder / "recording.raw");
  evmarker::io::RawWriter writer(folder / "triggers.raw", reader.sensor_size());
  std::string triggers = "t_us,id,rising\n";
  evmarker::Timestamp next = 10000;
  for (const evmarker::Event& event : drain(reader)) {
    for (; event.t > next; next += 10000) {
      writer.write_trigger({.id = 4, .rising = next % 20000 == 0, .t = next});
      triggers += std::to_string(next) + ",4," + (next % 20000 == 0 ? "1" : "0") + "\n";
    }
    writer.write(event);
  }
  writer.close();
  const Result result = run(folder, "replay triggers.raw" + kOptions + " --speed " + std::to_string(kReplaySpeed) +
                                        " --policy block --triggers t.csv --delays d.csv --rate 200 --poses p.csv");
  REQUIRE_MESSAGE(result.code == 0, result.err);
  REQUIRE(next > 500000);
  CHECK(read_file(folder / "t.csv") == triggers);
  CHECK_MESSAGE(contains(result.out, "triggers: " + std::to_string(next / 10000 - 1) + ", 0 dropped"), result.out);

  const auto poses = read_table(read_file(folder / "p.csv")), truth = read_table(simulated_file("truth.csv"));
  for (std::size_t i = 1; i < poses.size(); ++i) CHECK(poses[i].t_us == poses[i - 1].t_us + 5000);
  const MeanError error = mean_tracking_error(poses, truth);
  REQUIRE(error.poses > 50);
  CHECK(error.mm < 6);

  const auto delays = split(read_file(folder / "d.csv"), '\n');
  CHECK(delays[0] == "time_s,delay_ms");
  CHECK_MESSAGE(contains(result.out, " poses=" + std::to_string(delays.size() - 1)), result.out);
  double last_s = 0;
  for (std::size_t i = 1; i < delays.size(); ++i) {
    const auto fields = split(delays[i], ',');
    REQUIRE(fields.size() == 2);
    CHECK(std::stod(fields[0]) >= last_s);
    CHECK(std::stod(fields[1]) > 0);
    last_s = std::stod(fields[0]);
  }
  CHECK(last_s > 0.5);
}

TEST_CASE("examples: simulate takes a calibration in any form, and a recording is tracked with it") {
  const TemporaryFolder folder;
  const std::string radtan = "  distortion_model: radtan\n  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]\n";
  write_file(folder / "chain.yaml", "cam0:\n  camera_model: pinhole\n  intrinsics: [200.5, 201.5, 118.5, 90.25]\n" +
                                        radtan + "  resolution: [240, 180]\ncam1:\n  intrinsics: [1]\n");
  write_file(folder / "calib.txt", "200.5 201.5 118.5 90.25 -0.1 0.02 0.001 -0.002 0\n");
  for (const std::string camera : {" --camera chain.yaml --camera-name cam0", " --camera calib.txt --size 240,180"}) {
    CAPTURE(camera);
    const std::string sway = " r.raw --marker-length 0.2 --duration 0.2 --sway 0.05 --calibration c.yml";
    const Result result = run(folder, "simulate" + camera + sway);
    REQUIRE_MESSAGE(result.code == 0, result.err);
    CHECK_FALSE(std::filesystem::exists(folder / "r.yml"));
    const evmarker::PinholeCamera loaded = evmarker::opencv::load_calibration((folder / "c.yml").string());
    CHECK(loaded.sensor_size() == evmarker::SensorSize{240, 180});
    CHECK(loaded.fx() == 200.5);
    CHECK(loaded.fy() == 201.5);
    CHECK(loaded.cx() == 118.5);
    CHECK(loaded.cy() == 90.25);
    const auto* lens = std::get_if<evmarker::BrownConradyDistortion>(&loaded.distortion());
    REQUIRE(lens);
    CHECK(lens->k1 == -0.1);
    CHECK(lens->p2 == -0.002);
    const Result tracked = run(folder, "track_file" + camera + " --marker-length 0.2 --output p.csv r.raw");
    CHECK_MESSAGE(tracked.code == 0, tracked.err);
    CHECK(contains(read_file(folder / "p.csv"), ",7,tracking,"));
  }
}

TEST_CASE("examples: calibration says what a camera is, and writes what OpenCV reads") {
  const TemporaryFolder folder;
  write_file(
      folder / "chain.yaml",
      "cam0:\n  camera_model: pinhole\n  intrinsics: [200, 200, 119.5, 89.5]\n  distortion_model: equidistant\n"
      "  distortion_coeffs: [0.01, -0.02, 0.003, -0.0004]\n  resolution: [240, 180]\ncam1:\n  intrinsics: [1]\n");
  const Result fisheye = run(folder, "calibration chain.yaml --camera-name cam0 c.json");
  REQUIRE_MESSAGE(fisheye.code == 0, fisheye.err);
  CHECK(contains(fisheye.out, "240 x 180 px\n  fx 200, fy 200, cx 119.5, cy 89.5 px\n"));
  CHECK(contains(fisheye.out, "fisheye (equidistant): k1 0.01, k2 -0.02, k3 0.003, k4 -0.0004"));
  CHECK(fisheye.out.ends_with("\nwritten to c.json\n"));
  const cv::FileStorage read((folder / "c.json").string(), cv::FileStorage::READ);
  CHECK(static_cast<int>(read["image_width"]) == 240);
  CHECK(static_cast<std::string>(read["distortion_model"]) == "fisheye");

  write_file(folder / "calib.txt", "120 90 119.5 89.5 0 0 0 0 0\n");
  const Result square = run(folder, "calibration calib.txt --size 240,180");
  CHECK(contains(square.out, "field of view 90.0 x 90.0 deg"));
  CHECK_FALSE(contains(square.out, "no inverse"));
  write_file(folder / "folded.txt", "120 90 119.5 89.5 -0.5 0 0 0 0\n");
  const Result folded = run(folder, "calibration folded.txt --size 240,180");
  CHECK(folded.code == 0);
  CHECK(contains(folded.out, "no inverse"));

  const Result itself = run(folder, "calibration calib.txt ./calib.txt --size 240,180");
  CHECK(itself.code == 1);
  CHECK(contains(itself.err, "the output ./calib.txt would overwrite the calibration calib.txt"));
  const Result missing = run(folder, "calibration chain.yaml d.yml");
  CHECK(missing.code == 1);
  CHECK(contains(missing.err, "chain.yaml"));
  CHECK_FALSE(std::filesystem::exists(folder / "d.yml"));
}

TEST_CASE("examples: simulate takes a sensor and a lens, writes them down, and single options change the sensor") {
  const TemporaryFolder folder;
  const std::string short_run = " --duration 0.05 --sensor davis346";
  const auto events_after = [&](const std::string& options) {
    const Result result = run(folder, "simulate r.raw" + short_run + options);
    CHECK_MESSAGE(result.code == 0, result.err);
    return std::stoul(result.out.substr(result.out.find(": ") + 2));
  };
  CHECK(events_after(" --lens fisheye:0.01,-0.02,0.003,0.0004 --focal 300") > 1000);
  const evmarker::PinholeCamera fisheye = evmarker::opencv::load_calibration((folder / "r.yml").string());
  CHECK(fisheye.sensor_size().width == 346);
  CHECK(fisheye.sensor_size().height == 260);
  CHECK(fisheye.fx() == 300);
  const auto* bent = std::get_if<evmarker::EquidistantDistortion>(&fisheye.distortion());
  REQUIRE(bent);
  CHECK(bent->k2 == -0.02);
  CHECK(bent->k4 == 0.0004);

  const auto calm = events_after(" --lens radtan:-0.3,0.1,0.001,-0.002 --noise 0 --leak 0");
  const evmarker::PinholeCamera radial = evmarker::opencv::load_calibration((folder / "r.yml").string());
  CHECK(radial.fx() == 324);
  const auto* tangential = std::get_if<evmarker::BrownConradyDistortion>(&radial.distortion());
  REQUIRE(tangential);
  CHECK(tangential->k1 == -0.3);
  CHECK(tangential->p2 == -0.002);
  CHECK(tangential->k3 == 0);
  const auto noisy = events_after(" --lens radtan:-0.3,0.1,0.001,-0.002 --noise 20 --leak 0");
  const double noise = 346 * 260 * 20 * 0.05;
  CHECK(std::abs(static_cast<double>(noisy) - static_cast<double>(calm) - noise) < 0.02 * noise);
}

TEST_CASE("examples: a board of markers is simulated and tracked as one") {
  const TemporaryFolder folder;
  write_file(folder / "board.yml", kBoard);
  const Result made =
      run(folder, "simulate b.raw --board board.yml --truth truth.csv --distance 0.4 --duration 0.4 --noise 0.3");
  REQUIRE_MESSAGE(made.code == 0, made.err);
  const Result tracked = run(folder, "track_file b.raw --camera b.yml --board board.yml --output poses.csv");
  REQUIRE_MESSAGE(tracked.code == 0, tracked.err);
  CHECK(tracked.err.empty());
  CHECK_MESSAGE(contains(tracked.out, "marker 100 "), tracked.out);
  const auto poses = read_table(read_file(folder / "poses.csv")), truth = read_table(read_file(folder / "truth.csv"));
  REQUIRE(truth.size() == 401);
  for (const Row& row : truth) CHECK(row.id == "100");
  for (const Row& pose : poses) CHECK(pose.id == "100");
  const MeanError error = mean_tracking_error(poses, truth);
  REQUIRE(error.poses > 500);
  CHECK(error.mm < 0.5);
  CHECK(error.deg < 0.5);

  // With a length other markers are searched, too; there are none.
  const Result both =
      run(folder, "track_file b.raw --camera b.yml --board board.yml --marker-length 0.1 --output both.csv");
  REQUIRE_MESSAGE(both.code == 0, both.err);
  for (const Row& pose : read_table(read_file(folder / "both.csv"))) CHECK(pose.id == "100");
}

TEST_CASE("examples: markers of several lengths are simulated and tracked, each with its own") {
  const TemporaryFolder folder;
  write_file(folder / "sizes.yml", "markers: [{ id: 3, length: 0.06 }]\n");
  const Result made = run(folder,
                          "simulate m.raw --ids 3,7 --marker-length 0.1 --marker-length 3:0.06 --truth truth.csv "
                          "--duration 0.5 --frequency 2 --noise 0.3");
  REQUIRE_MESSAGE(made.code == 0, made.err);
  const auto truth = read_table(read_file(folder / "truth.csv"));
  for (const char* lengths : {"--marker-length 7:0.1 --markers sizes.yml", "--marker-length 0.1 --markers sizes.yml"}) {
    const Result tracked = run(folder, "track_file m.raw --camera m.yml --output poses.csv " + std::string(lengths));
    REQUIRE_MESSAGE(tracked.code == 0, tracked.err);
    for (const char* id : {"3", "7"}) {
      auto poses = read_table(read_file(folder / "poses.csv"));
      auto true_poses = truth;
      std::erase_if(poses, [&](const Row& row) { return row.id != id; });
      std::erase_if(true_poses, [&](const Row& row) { return row.id != id; });
      const MeanError error = mean_tracking_error(poses, true_poses);
      CAPTURE(id);
      REQUIRE(error.poses > 300);
      CHECK(error.mm < 2);  // a wrong length would be a wrong distance: 240 mm or more
      CHECK(error.deg < 2);
    }
  }
}

namespace {

/// T_first_second from rows of one time.
Eigen::Isometry3d between(const Row& first, const Row& second) {
  const Eigen::Isometry3d T_first = Eigen::Translation3d(first.translation) * first.rotation,
                          T_second = Eigen::Translation3d(second.translation) * second.rotation;
  return T_first.inverse() * T_second;
}

double number_after(const std::string& text, const std::string& before, int number = 0) {
  std::istringstream in(text.substr(text.find(before) + before.size()));
  double value = 0;
  for (char separator = 0; number >= 0; --number) {
    in >> value;
    if (number > 0) in >> separator;
  }
  return value;
}

/// Markers 1 and 2 side by side on a plate that turns, with its truth.
const TemporaryFolder& turning_plate() {
  static const TemporaryFolder folder;
  static const bool made = [] {
    write_file(folder / "board.yml", kBoard);
    const Result result = run(folder,
                              "simulate b.raw --board board.yml --truth truth.csv --distance 0.4 --turn 40,40,20 "
                              "--frequency 0.8 --duration 1.5 --noise 0.3");
    REQUIRE_MESSAGE(result.code == 0, result.err);
    return true;
  }();
  REQUIRE(made);
  return folder;
}

}  // namespace

TEST_CASE("examples: make_board measures a board with which the body is tracked as with the true one") {
  const TemporaryFolder& folder = turning_plate();
  const std::string make = "make_board b.raw --camera b.yml --marker-length 0.05 --ids 1,2";
  const Result made = run(folder, make + " --output made.yml --board-id 55");
  REQUIRE_MESSAGE(made.code == 0, made.err);
  CHECK(made.err.empty());
  CHECK_MESSAGE(contains(made.out, "instants, corners within 0."), made.out);
  CHECK(made.out.ends_with("\nwritten to made.yml\n"));
  const std::string board = read_file(folder / "made.yml");
  CHECK(
      board.starts_with("dictionary: DICT_4X4_50\nboard: 55\nmarkers:\n  - { id: 1, length: 0.05, rotation: [0, 0, 0], "
                        "translation: [0, 0, 0] }"));
  const auto second = [](const std::string& text, const char* what, int i) {
    return number_after(text.substr(text.find("id: 2")), what, i);
  };
  for (int i = 0; i < 3; ++i) {  // 8 cm to the right
    CHECK(second(board, "translation: [", i) == doctest::Approx(i == 0 ? 0.08 : 0).epsilon(3e-4).scale(1));
    CHECK(std::abs(second(board, "rotation: [", i)) < 0.006);
  }
  const Result by_second = run(folder, make + " --output by_second.yml --origin 2");
  REQUIRE_MESSAGE(by_second.code == 0, by_second.err);
  const std::string other = read_file(folder / "by_second.yml");
  CHECK(other.find("id: 2") < other.find("id: 1"));

  const Result tracked = run(folder, "track_file b.raw --camera b.yml --board made.yml --output poses.csv");
  REQUIRE_MESSAGE(tracked.code == 0, tracked.err);
  auto truth = read_table(read_file(folder / "truth.csv"));
  for (Row& row : truth) row.translation += row.rotation * Eigen::Vector3d(-0.04, 0, 0);  // of marker 1
  const MeanError error = mean_tracking_error(read_table(read_file(folder / "poses.csv")), truth);
  REQUIRE(error.poses > 1000);
  CHECK(error.mm < 0.5);
  CHECK(error.deg < 0.5);
}

TEST_CASE("examples: a camera is calibrated by a moving board, unless it hardly moved or is another one") {
  if (kPrograms.at("calibrate").empty()) {
    MESSAGE("skipped: calibrate is not built without Ceres");
    return;
  }
  const TemporaryFolder folder;
  write_file(folder / "grid.yml",
             "markersX: 4\nmarkersY: 3\nmarkerLength: 0.04\nmarkerSeparation: 0.012\ndictionary: DICT_4X4_50\n");
  const std::string simulate = " --board grid.yml --sensor davis346 --quiet";
  const Result moved = run(folder,
                           "simulate g.raw --lens radtan:-0.25,0.09,0.0007,-0.0005 --distance 0.27 --turn 40,40,25 "
                           "--frequency 0.9 --duration 1.2 --seed 7 --light-lag-us 2000" +  // edges lag in dim light
                               simulate);
  REQUIRE_MESSAGE(moved.code == 0, moved.err);
  const std::string calibrate = "calibrate g.raw --board grid.yml --output c.yml --largest-error 3 --quiet";
  const Result calibrated = run(folder, calibrate + " --picture c.png --truth g.yml");
  REQUIRE_MESSAGE(calibrated.code == 0, calibrated.err);
  CHECK(calibrated.err.empty());
  CHECK(calibrated.out.ends_with("\nwritten to c.yml\n"));
  const auto camera = evmarker::opencv::load_calibration((folder / "c.yml").string());
  const auto truth = evmarker::opencv::load_calibration((folder / "g.yml").string());
  const double fx_sigma = number_after(calibrated.out, "+- "), f_error = std::abs(camera.fx() - truth.fx());
  MESSAGE("fx off by " << f_error << " px of +- " << fx_sigma << ", cx by " << camera.cx() - truth.cx() << ", cy by "
                       << camera.cy() - truth.cy());
  CHECK(number_after(calibrated.out, "fx") == doctest::Approx(camera.fx()).epsilon(1e-5));
  CHECK(f_error < 0.005 * truth.fx());
  CHECK(f_error < 4 * fx_sigma);
  CHECK(std::abs(camera.cx() - truth.cx()) < 2);
  CHECK(std::abs(camera.cy() - truth.cy()) < 2);
  for (const double x : {60.0, 172.5, 285.0})  // where the board was
    for (const double y : {50.0, 129.5, 210.0}) {
      const Eigen::Vector2d pixel(x, y);
      CHECK((camera.project(truth.line_of_sight(pixel)) - pixel).norm() < 2.5);  // also by a turn of the camera's axes
    }
  CHECK(number_after(calibrated.out, "off by ") < 0.25);  // px; 0.51 if the errors that all corners share are left in
  const cv::Mat picture = cv::imread((folder / "c.png").string());
  CHECK(picture.rows > 700);
  cv::Mat green;  // the circle where the camera is known worst
  cv::inRange(picture, cv::Scalar(40, 120, 40), cv::Scalar(40, 120, 40), green);
  CHECK(cv::countNonZero(green) > 100);

  // The same board with distances that are not those of the print.
  write_file(folder / "tight.yml",
             "markersX: 4\nmarkersY: 3\nmarkerLength: 0.04\nmarkerSeparation: 0.009\ndictionary: DICT_4X4_50\n");
  const std::string tight = "calibrate g.raw --board tight.yml --output tight_c.yml --largest-error 3 --quiet";
  const Result contradicted = run(folder, tight);
  CHECK(contradicted.code == 2);
  CHECK_MESSAGE(contains(contradicted.err, "lie as tight.yml says"), contradicted.err);
  CHECK_FALSE(std::filesystem::exists(folder / "tight_c.yml"));
  const Result stretched = run(folder, tight + " --free-pitch");
  REQUIRE_MESSAGE(stretched.code == 0, stretched.err);
  const std::string pitch = stretched.out.substr(stretched.out.find("distances between the markers: "));
  CHECK(number_after(pitch, "markers: ") == doctest::Approx(0.052 / 0.049).epsilon(0.003).scale(0));
  CHECK(std::abs(number_after(pitch, "markers: ") - 0.052 / 0.049) < 3 * number_after(pitch, "+- "));

  const std::string track = "track_file g.raw --camera g.yml --output poses.csv --quiet --board ";
  const Result tracked = run(folder, track + "grid.yml"), refused_board = run(folder, track + "tight.yml");
  CHECK(tracked.code == 0);
  CHECK_MESSAGE(tracked.err.empty(), tracked.err);
  CHECK(refused_board.code == 2);
  CHECK_MESSAGE(refused_board.err.starts_with("board 100 does not fit its file: marker "), refused_board.err);
  CHECK(read_table(read_file(folder / "poses.csv")).empty());

  const Result still = run(folder, "simulate s.raw --distance 0.4 --sway 0.03 --turn 3,3,3 --duration 0.6" + simulate);
  REQUIRE_MESSAGE(still.code == 0, still.err);
  const Result refused = run(folder, "calibrate s.raw --board grid.yml --output none.yml --quiet");
  CHECK(refused.code == 2);
  CHECK_MESSAGE(contains(refused.err, "tilt the board"), refused.err);
  CHECK_FALSE(std::filesystem::exists(folder / "none.yml"));
}

TEST_CASE("examples: poses at a rate, of the camera, of one marker in the other's frame, and as TUM") {
  const TemporaryFolder& folder = turning_plate();
  const std::string track = "track_file b.raw --camera b.yml --marker-length 0.05 --ids 1,2";
  const auto rows_of = [&](const std::string& options) {
    const Result result = run(folder, track + options + " --output rows.csv");
    REQUIRE_MESSAGE(result.code == 0, result.err);
    return read_table(read_file(folder / "rows.csv"));
  };
  const auto at_rate = rows_of(" --rate 250"), of_camera = rows_of(" --rate 250 --frame board");
  const Result evaluated = run(folder, "evaluate rows.csv --truth truth.csv");
  CHECK(evaluated.code == 1);
  CHECK_MESSAGE(contains(evaluated.err, "rows.csv: line 2: its poses are T_marker_camera, not T_camera_marker"),
                evaluated.err);
  const auto truth = read_table(read_file(folder / "truth.csv"));
  REQUIRE(at_rate.size() > 500);
  REQUIRE(of_camera.size() == at_rate.size());
  std::size_t tracking = 0;
  for (std::size_t i = 0; i < at_rate.size(); ++i) {
    CHECK(static_cast<long>(at_rate[i].t_us) % 4000 == 0);
    CHECK(of_camera[i].t_us == at_rate[i].t_us);
    CHECK(of_camera[i].id == at_rate[i].id);
    const Eigen::Vector3d back = -(at_rate[i].rotation.conjugate() * at_rate[i].translation);
    CHECK((of_camera[i].translation - back).norm() < 1e-9);
    CHECK(of_camera[i].rotation.angularDistance(at_rate[i].rotation.conjugate()) < 1e-6);
    if (at_rate[i].state != "tracking" || at_rate[i].id != "1") continue;
    ++tracking;
    const Row& board = truth.at(static_cast<std::size_t>(at_rate[i].t_us / 1000));
    CHECK((at_rate[i].translation - board.translation - board.rotation * Eigen::Vector3d(-0.04, 0, 0)).norm() < 8e-3);
  }
  CHECK(tracking > 250);

  const Result relative = run(folder, track + " --relative 1,2 --output rel.csv");
  REQUIRE_MESSAGE(relative.code == 0, relative.err);
  const auto in_first = read_table(read_file(folder / "rel.csv"));
  CHECK(contains(run(folder, "evaluate truth.csv --truth rel.csv").err, "rel.csv: line 2: its poses are T_1_2, not "));
  REQUIRE(in_first.size() > 100);
  for (const Row& row : in_first) {
    CHECK(row.id == "2");
    CHECK(row.state == "tracking");
    CHECK(static_cast<long>(row.t_us) % 10000 == 0);
    std::vector<Row> both;
    for (const Row& single : at_rate)
      if (single.t_us == row.t_us) both.push_back(single);
    if (static_cast<long>(row.t_us) % 4000 != 0) continue;
    REQUIRE(both.size() == 2);
    const bool in_order = both[0].id == "1";
    const Eigen::Isometry3d T = between(both[in_order ? 0 : 1], both[in_order ? 1 : 0]);
    CHECK((row.translation - T.translation()).norm() < 1e-9);
  }
  for (int i = 0; i < 3; ++i)
    CHECK(std::abs(number_after(relative.out, "translation: [", i) - (i == 0 ? 0.08 : 0)) < 3e-4);
  CHECK_MESSAGE(number_after(relative.out, "standard error ") < 0.3, relative.out);

  const Result too_rare = run(folder, track + " --rate 0.1 --output rare.csv");
  CHECK(too_rare.code == 0);
  CHECK(
      too_rare.err ==
      "--rate 0.1: no pose is written: no marker was tracked at a multiple of 10 s, as the recording is 1.50 s long\n");
  CHECK(read_table(read_file(folder / "rare.csv")).empty());

  const Result tum = run(folder, track + " --format tum --rate 250 --output poses.txt");
  REQUIRE_MESSAGE(tum.code == 0, tum.err);
  CHECK_FALSE(std::filesystem::exists(folder / "poses.txt"));
  for (const char* id : {"1", "2"}) {
    std::string expected_t;
    for (const Row& row : at_rate)
      if (row.id == id && row.state == "tracking") {
        char text[32];
        std::snprintf(text, sizeof text, "%.6f ", 1e-6 * row.t_us);
        expected_t += text;
      }
    std::string t;
    for (const std::string& line : split(read_file(folder / (std::string("poses_") + id + ".txt").c_str()), '\n'))
      t += split(line, ' ').at(0) + ' ';
    CHECK(t == expected_t);
    CHECK_MESSAGE(contains(tum.out, std::string("poses in poses_") + id + ".txt"), tum.out);
  }
  const Result again = run(folder, track + " --format tum --output poses.txt");
  CHECK(again.code == 1);
  CHECK_MESSAGE(contains(again.err, "--output poses.txt: there is a poses_"), again.err);
  const Result of_one =
      run(folder, "track_file b.raw --camera b.yml --marker-length 0.05 --ids 2 --format tum --output one.txt");
  REQUIRE_MESSAGE(of_one.code == 0, of_one.err);
  CHECK(split(read_file(folder / "one.txt"), '\n').size() > 200);
  const Result back = run(folder, track + " --format tum --frame board --output back.txt");
  REQUIRE_MESSAGE(back.code == 0, back.err);
  CHECK(read_file(folder / "back_1.txt").starts_with("# T_marker_camera\n"));
}

TEST_CASE("examples: a body of straight edges is tracked from where its file or an option says that it is") {
  const TemporaryFolder folder;
  for (const char* name : {"recording.raw", "camera.yml", "truth.csv"})
    std::filesystem::create_symlink(simulated() / name, folder / name);
  const auto truth = read_table(simulated_file("truth.csv"));
  // 5 mm beside the true place, in both forms.
  const Eigen::Vector3d place = truth[0].translation + Eigen::Vector3d(0.005, 0, 0);
  const Eigen::Quaterniond& q = truth[0].rotation;
  const Eigen::AngleAxisd turn(q);
  const Eigen::Vector3d rotation = turn.angle() * turn.axis();
  const auto text = [](const std::vector<double>& numbers) {
    std::ostringstream out;
    out.precision(12);
    for (std::size_t i = 0; i < numbers.size(); ++i) out << (i > 0 ? "," : "") << numbers[i];
    return out.str();
  };
  const std::string start = text({place.x(), place.y(), place.z(), q.x(), q.y(), q.z(), q.w()});
  const std::string in_file = "start: { rotation: [" + text({rotation.x(), rotation.y(), rotation.z()}) +
                              "], translation: [" + text({place.x(), place.y(), place.z()}) + "] }\n";
  const std::string elsewhere = "start: { rotation: [0, 3.14, 0], translation: [0, 0, 5] }\n";
  write_file(folder / "nowhere.yml", kBody);
  write_file(folder / "here.yml", kBody + in_file);
  write_file(folder / "elsewhere.yml", kBody + elsewhere);

  std::string first;
  for (const std::string& options :
       std::vector<std::string>{" --wireframe here.yml", " --wireframe elsewhere.yml --start=" + start,
                                " --wireframe nowhere.yml --start=" + start}) {
    CAPTURE(options);
    const Result result = run(
        folder, "track_file recording.raw --camera camera.yml" + options + " --output poses.csv --overlay overlay.png");
    REQUIRE_MESSAGE(result.code == 0, result.err);
    CHECK(contains(result.out, "marker 200 "));
    const auto poses = read_table(read_file(folder / "poses.csv"));
    for (const Row& pose : poses) CHECK(pose.id == "200");
    const MeanError error = mean_tracking_error(poses, truth);
    MESSAGE(error.poses << " poses, " << error.mm << " mm, " << error.deg << " deg");
    REQUIRE(error.poses > 200);
    CHECK(error.mm < 10);
    CHECK(error.deg < 3);
    CHECK(cv::imread((folder / "overlay.png").string()).cols == 1280);
  }

  // The truth is of marker 7, not of the body.
  const Result wrong =
      run(folder, "track_file recording.raw --camera camera.yml --wireframe here.yml --truth truth.csv");
  CHECK(wrong.code == 1);
  CHECK(contains(wrong.err, "marker 200"));
}

TEST_CASE("examples: automatic settings are a word, and the default is one of the values that may be given") {
  const Result help = run(simulated(), "track_file --help");
  REQUIRE(help.code == 0);
  CHECK(contains(help.out, "--events-per-update INT:auto or 1..1000000"));
  CHECK(contains(help.out, "--filter-window-us INT:auto or 1..480000000"));
  const Result named = run(simulated(), "track_file recording.raw" + kOptions + " --events-per-update auto");
  CHECK_MESSAGE(named.code == 0, named.err);
}

TEST_CASE("examples: a stated latency moves poses forward along their velocity") {
  const auto table = [](const std::string& options) {
    const Result result = run(simulated(), "track_file recording.raw" + kOptions + " --output late.csv" + options);
    REQUIRE_MESSAGE(result.code == 0, result.err);
    return split(simulated_file("late.csv"), '\n');
  };
  const auto without = table(""), with = table(" --latency-us 2000 --latency-sigma-us 5000");
  REQUIRE(without.size() > 100);
  REQUIRE(with.size() == without.size());
  const auto names = split(without[0], ',');
  const auto velocity = static_cast<std::size_t>(std::ranges::find(names, "vx") - names.begin());
  REQUIRE(velocity + 2 < names.size());
  const auto sigma = static_cast<std::size_t>(std::ranges::find(names, "sigma_t_mm") - names.begin());
  REQUIRE(sigma < names.size());
  for (std::size_t i = 1; i < with.size(); i += 20) {
    const auto a = split(without[i], ','), b = split(with[i], ',');
    CHECK(a[0] == b[0]);
    for (std::size_t k = 0; k < 3; ++k)
      CHECK(std::abs(std::stod(b[3 + k]) - std::stod(a[3 + k]) - 2e-3 * std::stod(a[velocity + k])) < 2e-6);
    // 5 ms in place of the usual 0.1 ms: along the motion, beside all that the pose does not know otherwise.
    const double speed_mm_s =
        1e3 * std::hypot(std::stod(a[velocity]), std::stod(a[velocity + 1]), std::stod(a[velocity + 2]));
    CHECK(std::stod(b[sigma]) ==
          doctest::Approx(std::hypot(std::stod(a[sigma]), 4.999e-3 * speed_mm_s)).epsilon(0.01).scale(0));
  }
}

TEST_CASE("examples: quickstart's pose agrees with the truth that it prints") {
  const TemporaryFolder folder;
  const Result result = run(folder, "quickstart");
  REQUIRE_MESSAGE(result.code == 0, result.err);
  CHECK(contains(result.out, "marker 7 at t = "));
  CHECK(contains(result.out, " is tracking at "));
  const auto position_after = [&](const std::string& word) {
    const auto at = result.out.find(word);
    REQUIRE(at != std::string::npos);
    std::istringstream in(result.out.substr(at + word.size()));
    Eigen::Vector3d p;
    REQUIRE(static_cast<bool>(in >> p.x() >> p.y() >> p.z()));
    return p;
  };
  const Eigen::Vector3d pose = position_after(" is tracking at "), truth = position_after("truth: ");
  CHECK(truth.z() > 0.3);
  CHECK((pose - truth).norm() < 0.01);
}

TEST_CASE("examples: the paper's tracker, line by line, and the library's rule give the same poses") {
  const TemporaryFolder folder;
  const Result result = run(folder, "paper");
  REQUIRE_MESSAGE(result.code == 0, result.err);
  MESSAGE(result.out);
  int poses = 0, verified = 0, ways_back = 0;
  REQUIRE(std::sscanf(result.out.c_str(), "%d poses; %d of %d ways back", &poses, &verified, &ways_back) == 3);
  CHECK(poses > 5000);
  CHECK(ways_back > 50);
  CHECK(verified == ways_back);
  const auto errors_of = [&](const std::string& what) {
    double mm = 0, deg = 0;
    const auto at = result.out.find("\n" + what);
    REQUIRE(at != std::string::npos);
    REQUIRE(std::sscanf(result.out.c_str() + at + 1 + what.size(), "%lf mm %lf deg", &mm, &deg) == 2);
    return std::pair(mm, deg);
  };
  CHECK(errors_of("paper").first < 6);  // 4.6 mm, 10.5 deg: with the paper's own numbers
  CHECK(errors_of("paper").second < 13);
  CHECK(errors_of("difference").first < 0.01);  // rounded, nothing
  CHECK(errors_of("difference").second < 0.01);
}

namespace {

/// The ```<language> blocks of a page.
std::vector<std::string> samples(const std::string& page, const std::string& language) {
  const std::string fence = "```", opening = fence + language + "\n", text = read_file(kSource / page);
  std::vector<std::string> blocks;
  for (auto at = text.find(opening); at != std::string::npos; at = text.find(opening, at)) {
    at += opening.size();
    const auto end = text.find(fence, at);
    REQUIRE(end != std::string::npos);
    blocks.push_back(text.substr(at, end - at));
    at = end;
  }
  return blocks;
}

std::string without_indentation(const std::string& text) {
  std::string lines;
  for (const std::string& line : split(text, '\n'))
    lines += line.substr(std::min(line.find_first_not_of(' '), line.size())) + "\n";
  return lines;
}

}  // namespace

TEST_CASE("examples: the README's C++ sample is quickstart.cpp, those of the other pages are compiled in guide.cpp") {
  CHECK(samples("README.md", "cpp") == std::vector{read_file(kSource / "examples/quickstart.cpp")});
  const std::string guide = without_indentation(read_file(kSource / "tests/guide.cpp"));
  std::size_t count = 0;
  for (const char* page : {"examples/README.md", "bench/README.md", "bench/speed.md", "include/evmarker/README.md",
                           ".github/CONTRIBUTING.md"})
    for (const std::string& sample : samples(page, "cpp")) {
      CHECK_MESSAGE(contains(guide, without_indentation(sample)), page, ":\n", sample);
      ++count;
    }
  CHECK(count > 0);
}

TEST_CASE("examples: the guide's board and wireframe are read by the programs") {
  const auto files = samples("examples/README.md", "yaml");
  REQUIRE(files.size() == 2);
  const TemporaryFolder folder;
  write_file(folder / "board.yml", files[0]);
  write_file(folder / "body.yml", files[1]);
  const Result made = run(folder, "simulate b.raw --board board.yml --duration 0.05");
  CHECK_MESSAGE(made.code == 0, made.err);
  for (const char* target : {"--board board.yml", "--wireframe body.yml"}) {
    const Result tracked = run(folder, std::string("track_file b.raw --camera b.yml ") + target);
    CHECK_MESSAGE(tracked.code != 1, tracked.err);  // too short to find anything
  }
}

namespace {

const char* const kAprilgrid = "target_type: 'aprilgrid'\ntagCols: 3\ntagRows: 2\ntagSize: 0.03\ntagSpacing: 0.3\n";

constexpr double kPixelsPerMm = 20, kFine = 2;  // drawn finer, so that slanted lines are not stairs

/// The black areas of an SVG in millimetres, as a printer without grey would print them.
cv::Mat printed(const std::string& svg) {
  std::smatch size;
  REQUIRE(std::regex_search(svg, size,
                            std::regex(R"re(width="([0-9.]+)mm" height="([0-9.]+)mm" viewBox="0 0 ([0-9. ]+)")re")));
  CHECK(size[3] == size[1].str() + " " + size[2].str());  // a unit is a millimetre
  cv::Mat page(static_cast<int>(std::stod(size[2]) * kFine * kPixelsPerMm),
               static_cast<int>(std::stod(size[1]) * kFine * kPixelsPerMm), CV_8U, cv::Scalar(255));
  const std::regex black("<path[^>]*fill[:=]\"?rgb\\(0%, ?0%, ?0%\\)[^>]* d=\"([^\"]*)\""),
      corner("([MLZ]) ?([0-9.]*) ?([0-9.]*)");
  for (std::sregex_iterator path(svg.begin(), svg.end(), black), end; path != end; ++path) {
    const std::string lines = (*path)[1];
    std::vector<std::vector<cv::Point>> polygons;
    for (std::sregex_iterator at(lines.begin(), lines.end(), corner); at != end; ++at) {
      if ((*at)[1] == "M") polygons.emplace_back();
      if ((*at)[1] == "Z" || (*at)[2].length() == 0) continue;
      const double sixteenths = 16 * kFine * kPixelsPerMm;  // the centre of the first pixel is at 0
      polygons.back().emplace_back(cvRound(std::stod((*at)[2]) * sixteenths - 8),
                                   cvRound(std::stod((*at)[3]) * sixteenths - 8));
    }
    std::erase_if(polygons, [](const auto& polygon) { return polygon.size() < 3; });
    cv::fillPoly(page, polygons, cv::Scalar(0), cv::LINE_8, 4);
  }
  cv::resize(page, page, {}, 1.0 / kFine, 1.0 / kFine, cv::INTER_AREA);
  return page;
}

/// Finds a board's markers on a page by OpenCV's own detector. They may be moved all alike, but neither turned nor
/// scaled.
/// @param down the board's direction that is down on the page
/// @returns the largest distance [mm] of a corner from where the board has it
double largest_deviation(const cv::Mat& page, const evmarker::Board& board, const std::string& dictionary, double down,
                         int border_cells = 1) {
  cv::aruco::DetectorParameters parameters;
  parameters.markerBorderBits = border_cells;
  parameters.cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
  evmarker::opencv::detail::detect_markers(page, evmarker::opencv::make_dictionary(dictionary), parameters, corners,
                                           ids);
  std::vector<Eigen::Vector2d> moved;
  for (const evmarker::BoardMarker& marker : board.markers) {
    const auto found = std::ranges::find(ids, marker.id);
    REQUIRE_MESSAGE(found != ids.end(), marker.id);
    const double h = marker.length / 2;
    const Eigen::Vector3d square[] = {{-h, h, 0}, {h, h, 0}, {h, -h, 0}, {-h, -h, 0}};
    for (std::size_t k = 0; k < 4; ++k) {
      const cv::Point2f seen = corners[static_cast<std::size_t>(found - ids.begin())][k] / kPixelsPerMm;
      const Eigen::Vector3d place = 1000 * (marker.T_board_marker * square[k]);
      moved.emplace_back(seen.x - place.x(), seen.y - down * place.y());
    }
  }
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& one : moved) mean += one / static_cast<double>(moved.size());
  double largest = 0;
  for (const Eigen::Vector2d& one : moved) largest = std::max(largest, (one - mean).norm());
  return largest;
}

}  // namespace

TEST_CASE("examples: print_board draws what OpenCV finds, where the board's file says") {
  if (kPrograms.at("print_board").empty()) {
    MESSAGE("skipped: print_board is not built");
    return;
  }
  const TemporaryFolder folder;
  const Result grid = run(
      folder, "print_board --grid 4x3 --marker-length 0.04 --spacing 0.01 --first-id 5 --board g.yml --output g.svg");
  REQUIRE_MESSAGE(grid.code == 0, grid.err);
  CHECK(grid.out == "g.svg: 12 markers of DICT_4X4_50 on 1 page of 297 x 210 mm\n");
  const auto made = evmarker::opencv::load_boards((folder / "g.yml").string());
  REQUIRE(made.boards.size() == 1);
  const evmarker::Board& board = made.boards[0];
  CHECK(board.id == 100);
  REQUIRE(board.markers.size() == 12);
  CHECK(board.markers[4].id == 9);  // the first of the second row
  CHECK((board.markers[4].T_board_marker.translation() - Eigen::Vector3d(-0.075, 0, 0)).norm() < 1e-12);
  const std::string svg = read_file(folder / "g.svg");
  CHECK(contains(svg, "M 10 192.5 L 110 192.5"));  // the ruler
  CHECK(largest_deviation(printed(svg), board, "DICT_4X4_50", -1) < 0.04);

  const std::tuple<const char*, double, const char*> files[] = {
      {kAprilgrid, -1, "only markers are drawn, without the squares between the tags, which nothing here needs\n"},
      {"squaresX: 4\nsquaresY: 5\nsquareLength: 0.03\nmarkerLength: 0.02\ndictionary: 6X6_250\n", 1,
       "only markers are drawn, without the chessboard, which nothing here needs\n"},
      {"board: 1\nmarkers:\n  - { id: 0, length: 0.03, rotation: [0, 0, 0.5], translation: [0, 0, 0] }\n"
       "  - { id: 1, length: 0.05, rotation: [0, 0, -2], translation: [0.07, 0.01, 0] }\n",
       -1, " mm\n"}};
  for (const auto& [text, down, end] : files) {
    write_file(folder / "b.yml", text);
    const Result drawn = run(folder, "print_board b.yml --output b.svg");
    REQUIRE_MESSAGE(drawn.code == 0, drawn.err);
    CHECK_MESSAGE(drawn.out.ends_with(end), drawn.out);
    const auto file = evmarker::opencv::load_boards((folder / "b.yml").string());
    CHECK(largest_deviation(printed(read_file(folder / "b.svg")), file.boards[0], file.dictionary, down,
                            file.border_cells) < 0.04);
  }
}

TEST_CASE("examples: print_board draws each face of a body, single markers and pages of a PDF") {
  if (kPrograms.at("print_board").empty()) {
    MESSAGE("skipped: print_board is not built");
    return;
  }
  const TemporaryFolder folder;
  write_file(folder / "cube.yml", samples("examples/README.md", "yaml").at(0));
  const Result cube = run(folder, "print_board cube.yml --output cube.svg");
  REQUIRE_MESSAGE(cube.code == 0, cube.err);
  const cv::Mat page = printed(read_file(folder / "cube.svg"));
  for (const evmarker::BoardMarker& marker : evmarker::opencv::load_board((folder / "cube.yml").string()).markers) {
    evmarker::BoardMarker flat = marker;
    flat.T_board_marker.setIdentity();
    // On the side that looks along the board's x, up is its z: the marker's x is down there, its y to the right.
    if (marker.id == 2) flat.T_board_marker.linear() << 0, 1, 0, -1, 0, 0, 0, 0, 1;
    CHECK(largest_deviation(page, {1, {flat}}, "DICT_4X4_50", -1) < 0.04);
  }

  const std::string single = "print_board --ids 0,7,30 --dictionary DICT_5X5_50 --marker-length ";
  const Result fit = run(folder, single + "0.07 --paper fit --output m.svg");
  CHECK(fit.out == "m.svg: 3 markers of DICT_5X5_50 on 1 page of 204 x 219 mm\n");  // 2 x 2 of 90 mm
  const cv::Mat all = printed(read_file(folder / "m.svg"));
  const auto codes = evmarker::opencv::make_dictionary("DICT_5X5_50");
  for (const int id : {0, 7, 30})
    CHECK(largest_deviation(all, {1, {{id, 0.07, evmarker::opencv::marker_bits(codes, id)}}}, "DICT_5X5_50", -1) <
          0.04);
  const Result pages = run(folder, single + "0.12 --output m.pdf");
  CHECK(pages.out == "m.pdf: 3 markers of DICT_5X5_50 on 3 pages of 210 x 297 mm\n");
  CHECK(read_file(folder / "m.pdf").starts_with("%PDF-"));
}

TEST_CASE("examples: print_board says in one line what is wrong, and leaves nothing") {
  if (kPrograms.at("print_board").empty()) {
    MESSAGE("skipped: print_board is not built");
    return;
  }
  const std::string grid = "print_board --grid 4x3 --marker-length 0.1 --output o.svg";
  const std::pair<std::string, std::vector<std::string>> cases[] = {
      {grid, {"--paper A4", "190 x 262 mm", "534 x 400 mm", "--paper fit"}},
      {replaced(grid, "0.1", "0.06"), {"--paper A4", "320 x 240 mm", "--paper A3 is large enough"}},
      {grid + " --paper A5", {"--paper", "A5"}},
      {replaced(grid, "svg", "png") + " --paper fit", {"--output o.png", ".svg", ".pdf"}},
      {replaced(grid, " --marker-length 0.1", ""), {"--marker-length", "required"}},
      {"print_board --output o.svg", {"--ids", "--grid", "required"}},
      {"print_board b.yml", {"--output", "required"}},
      {"print_board missing.yml --output o.svg", {"missing.yml", "No such file"}},
      {"print_board b.yml --output o.svg --ids 3", {"file", "--ids"}},
      {"print_board b.yml --output o.svg --dictionary DICT_4X4_50", {"b.yml", "DICT_4X4_50", "AprilTags"}},
      {grid + " --spacing 0.001", {"--spacing", "0.001 m", "cell"}},
      {grid + " --first-id 40", {"marker id 50", "DICT_4X4_50"}},
      {replaced(grid, "4x3", "4,3"), {"--grid", "4,3", "columns x rows, as 4x3"}},
      {grid + " --board n.raw", {"--board n.raw: must end in .yml or .yaml"}},
      {grid + " --board o.svg", {"--board o.svg", "--output o.svg"}},
      {"print_board --ids 3 --marker-length 0.1 --output o.svg --board n.yml", {"--board", "--grid"}},
      {"print_board b.yml --output missing/o.svg", {"missing/o.svg", "No such file"}},
      {grid + " --paper fit --board missing/n.yml", {"missing/n.yml", "No such file"}},
      {"print_board --ids 3,4 --marker-length 0.13 --output o.svg", {"--output o.svg", "2 pages of A4", ".pdf"}},
  };
  for (const auto& refused : cases) {
    CAPTURE(refused.first);
    const auto& [command, expected] = refused;
    const TemporaryFolder folder;
    write_file(folder / "b.yml", kAprilgrid);
    const Result result = run(folder, command);
    CAPTURE(result.err);
    CHECK(result.code > 0);
    CHECK(std::ranges::count(result.err, '\n') == 1);
    for (const std::string& part : expected) CHECK_MESSAGE(contains(result.err, part), part);
    CHECK(result.out.empty());
    CHECK(folder.files() == 3);  // the board, stdout and stderr
    CHECK(read_file(folder / "b.yml") == kAprilgrid);
  }
  const TemporaryFolder folder;
  write_file(folder / "b.svg", kAprilgrid);
  const Result same = run(folder, "print_board b.svg --output b.svg");
  CHECK_MESSAGE(contains(same.err, "--output b.svg would overwrite the board b.svg"), same.err);
  CHECK(read_file(folder / "b.svg") == kAprilgrid);
}

TEST_CASE("examples: a board of another program is simulated and tracked by the dictionary that its file names") {
  const TemporaryFolder folder;
  write_file(folder / "k.yml", kAprilgrid);
  const Result made =
      run(folder, "simulate k.raw --calibration c.yml --board k.yml --truth truth.csv --distance 0.3 --duration 0.3");
  REQUIRE_MESSAGE(made.code == 0, made.err);
  const Result tracked = run(folder, "track_file k.raw --camera c.yml --board k.yml --output poses.csv");
  REQUIRE_MESSAGE(tracked.code == 0, tracked.err);
  CHECK_MESSAGE(contains(tracked.out, "marker 600 "), tracked.out);
  const MeanError error =
      mean_tracking_error(read_table(read_file(folder / "poses.csv")), read_table(read_file(folder / "truth.csv")));
  REQUIRE(error.poses > 500);
  CHECK(error.mm < 0.3);
  CHECK(error.deg < 0.3);
  write_file(folder / "o.yml", kBoard);
  const Result both = run(folder, "track_file k.raw --camera c.yml --board k.yml --board o.yml");
  CHECK(both.code == 1);
  CHECK_MESSAGE(
      contains(both.err, "--board o.yml: its markers are from DICT_4X4_50, those of k.yml from DICT_APRILTAG"),
      both.err);
}

namespace {

/// The simulated recording, calibration and truth, by symlinks.
void link_simulated(const TemporaryFolder& folder) {
  for (const char* name : {"recording.raw", "camera.yml", "truth.csv"})
    std::filesystem::create_symlink(simulated() / name, folder / name);
}

/// The simulated recording as text.
std::string simulated_text() {
  const TemporaryFolder folder;
  evmarker::io::RawReader reader(simulated() / "recording.raw");
  evmarker::io::CsvWriter writer(folder / "recording.csv", reader.sensor_size());
  writer.write(drain(reader));
  writer.close();
  return read_file(folder / "recording.csv");
}

bool is_filled(const std::filesystem::path& path) {
  std::error_code none;
  const auto bytes = std::filesystem::file_size(path, none);
  return !none && bytes > 0;
}

}  // namespace

TEST_CASE("examples: a pipe and a FIFO give the poses of the file, RAW and text") {
  const TemporaryFolder folder;
  link_simulated(folder);
  write_file(folder / "recording.csv", simulated_text());
  const Result whole = run(folder, "track_file recording.raw" + kOptions + " --output whole.csv");
  REQUIRE_MESSAGE(whole.code == 0, whole.err);
  const std::string events = whole.out.substr(0, whole.out.find(" read"));
  const auto check = [&](const Result& result) {
    CHECK_MESSAGE(result.code == 0, result.err);
    CHECK(result.out.substr(0, result.out.find(" read")) == events);
    CHECK(read_file(folder / "poses.csv") == read_file(folder / "whole.csv"));
  };
  for (const char* name : {"recording.raw", "recording.csv"}) {
    CAPTURE(name);
    check(run(folder, "track_file /dev/stdin" + kOptions + " --output poses.csv", "stderr.txt",
              std::string("cat ") + name + " | "));
    {
      Fifo fifo(folder / "fifo", read_file(folder / name));
      auto end = std::async(std::launch::async, [&] { fifo.end(); });
      check(run(folder, "track_file fifo" + kOptions + " --output poses.csv"));
    }
    std::filesystem::remove(folder / "fifo");
  }
}

namespace {

#ifdef EVMARKER_HAS_HDF5
constexpr bool kHdf5 = true;
#else
constexpr bool kHdf5 = false;
#endif

struct Content {
  evmarker::SensorSize size;
  std::vector<evmarker::Event> events;
  std::vector<evmarker::TriggerEvent> triggers;
};

Content content_of(const std::filesystem::path& path) {
  evmarker::io::EventReader reader(path);
  Content content{reader.sensor_size(), {}, {}};
  content.events = drain(reader, &content.triggers);
  return content;
}

/// Events of a second and a trigger every 10 ms, in a RAW file.
Content write_raw(const std::filesystem::path& path, evmarker::io::RawFormat format, int triggers_from_input) {
  Content content{{346, 260}, random_events({346, 260}, 20000, 77), {}};
  evmarker::io::RawWriter writer(path, content.size, format);
  std::size_t written = 0;
  for (std::size_t i = 0; i < content.events.size(); i += 500) {
    writer.write(std::span(content.events).subspan(written, i - written));
    written = i;
    content.triggers.push_back({triggers_from_input, i % 1000 == 0, content.events[i].t});
    writer.write_trigger(content.triggers.back());
  }
  writer.write(std::span(content.events).subspan(written));
  writer.close();
  return content;
}

}  // namespace

TEST_CASE("examples: convert gives the same events and poses in every format") {
  const TemporaryFolder folder;
  link_simulated(folder);
  const Content recorded = content_of(folder / "recording.raw");
  const Result whole = run(folder, "track_file recording.raw" + kOptions + " --output whole.csv");
  REQUIRE_MESSAGE(whole.code == 0, whole.err);
  std::vector<std::pair<std::string, std::string>> formats{
      {"2.raw --format evt2", "EVT2"}, {"3.raw", "EVT3"}, {"a.csv", "CSV"}, {"b.bin --format csv", "CSV"}};
  if (kHdf5) formats.insert(formats.end(), {{"a.h5", "HDF5"}, {"b.hdf5 --compression none", "HDF5"}});
  for (const auto& written : formats) {
    CAPTURE(written.first);
    const auto& [arguments, format] = written;
    const std::string name = arguments.substr(0, arguments.find(' '));
    const Result result = run(folder, "convert recording.raw " + arguments);
    REQUIRE_MESSAGE(result.code == 0, result.err);
    CHECK(result.err.empty());
    CHECK(result.out.starts_with(format + ": " + std::to_string(recorded.events.size()) + " events in " + name));
    const Content converted = content_of(folder / name.c_str());
    CHECK(converted.size == recorded.size);
    CHECK(converted.events == recorded.events);
    REQUIRE(run(folder, "track_file " + name + kOptions + " --output poses.csv").code == 0);
    CHECK(read_file(folder / "poses.csv") == read_file(folder / "whole.csv"));
    REQUIRE(run(folder, "convert " + name + " back.raw").code == 0);
    CHECK(read_file(folder / "back.raw") == read_file(folder / "recording.raw"));
  }
}

TEST_CASE("examples: convert keeps triggers where the format holds them, and says what is lost") {
  const TemporaryFolder folder;
  for (const auto& recording : {std::pair(evmarker::io::RawFormat::evt3, 3), {evmarker::io::RawFormat::evt2, 20}}) {
    const auto& [from, input] = recording;
    const Content recorded = write_raw(folder / "a.raw", from, input);
    for (const char* format : {"evt2", "evt3", "csv"}) {
      CAPTURE(format);
      CAPTURE(recording.second);
      const Result result = run(folder, std::string("convert a.raw b --format ") + format);
      REQUIRE_MESSAGE(result.code == 0, result.err);
      const bool held = format == std::string("evt2") || (format == std::string("evt3") && input < 16);
      const Content converted = content_of(folder / "b");
      CHECK(converted.events == recorded.events);
      CHECK(converted.triggers == (held ? recorded.triggers : std::vector<evmarker::TriggerEvent>()));
      const std::string triggers = std::to_string(recorded.triggers.size()) + " triggers";
      CHECK(contains(result.out, " events and " + triggers + " in b") == held);
      CHECK(contains(result.out, "recording  " + triggers + " are lost, which ") == !held);
    }
  }
}

TEST_CASE("examples: info shows and convert keeps the triggers of AEDAT 4 and HDF5") {
  using namespace evmarker::io::test;
  const TemporaryFolder folder;
  const auto events = random_events({346, 260}, 3000, 7);
  const evmarker::Timestamp t = events[1000].t + 1, end = events.back().t + 100;
  const std::vector<evmarker::TriggerEvent> triggers{{0, true, t}, {0, false, t + 1}, {0, true, end}};
  const std::vector<Aedat4Trigger> of_dv{{t, 1}, {t + 1, 2}, {end, 3}};
  const std::span all(events);
  write_file(folder / "a.aedat4", aedat4_header(0, -1, aedat4_streams({346, 260})) +
                                      aedat4_packet(1, aedat4_events(all.first(1001))) +
                                      aedat4_packet(3, aedat4_triggers(std::span(of_dv).first(2))) +
                                      aedat4_packet(1, aedat4_events(all.subspan(1001))) +
                                      aedat4_packet(3, aedat4_triggers(std::span(of_dv).last(1))));
  std::vector<std::string> files{"a.aedat4"};
#ifdef EVMARKER_HAS_HDF5
  Hdf5Bytes hdf5;
  hdf5.add_compounds("CD/events", events);
  hdf5.add_triggers("EXT_TRIGGER/events", triggers);
  hdf5.add_attribute("geometry", "346x260");
  write_file(folder / "a.h5", hdf5.bytes());
  files.emplace_back("a.h5");
#endif
  for (const std::string& file : files) {
    CAPTURE(file);
    const Result shown = run(folder, "info " + file);
    CHECK_MESSAGE(contains(shown.out, "triggers   input 0: 2 rising, 1 falling"), shown.out);
    const Result result = run(folder, "convert " + file + " b.raw");
    REQUIRE_MESSAGE(result.code == 0, result.err);
    CHECK(contains(result.out, " events and 3 triggers in b.raw"));
    const Content converted = content_of(folder / "b.raw");
    CHECK(converted.events == events);
    CHECK(converted.triggers == triggers);
  }
}

TEST_CASE("examples: convert takes a part of a recording, in time and in the image") {
  const TemporaryFolder folder;
  const Content recorded = write_raw(folder / "a.raw", evmarker::io::RawFormat::evt3, 3);
  const evmarker::Timestamp first = recorded.events.front().t, begin = first + 150000, end = first + 400000;
  REQUIRE(recorded.events.back().t > end);
  struct Case {
    const char* options;
    bool in_time, in_region, shift_time, shift_region;
  };
  for (const auto& part : {Case{"--from 0.15 --to 0.4", true, false, false, false},
                           {"--shift-time", false, false, true, false},
                           {"--from 0.15 --to 0.4 --shift-time", true, false, true, false},
                           {"--region 100,50,80,60", false, true, false, false},
                           {"--region 100,50,80,60 --shift-region --from 0.15 --to 0.4", true, true, false, true}}) {
    CAPTURE(part.options);
    const auto& [options, in_time, in_region, shift_time, shift_region] = part;
    const evmarker::Timestamp zero = !shift_time ? 0 : in_time ? begin : first;
    Content wanted{shift_region ? evmarker::SensorSize{80, 60} : recorded.size, {}, {}};
    for (evmarker::Event event : recorded.events) {
      if (in_time && (event.t < begin || event.t >= end)) continue;
      if (in_region && (event.x < 100 || event.x >= 180 || event.y < 50 || event.y >= 110)) continue;
      if (shift_region) event.x = static_cast<std::uint16_t>(event.x - 100);
      if (shift_region) event.y = static_cast<std::uint16_t>(event.y - 50);
      event.t -= zero;
      wanted.events.push_back(event);
    }
    for (evmarker::TriggerEvent trigger : recorded.triggers) {
      if (in_time && (trigger.t < begin || trigger.t >= end)) continue;
      trigger.t -= zero;
      wanted.triggers.push_back(trigger);
    }
    REQUIRE(wanted.events.size() > 100);
    const Result result = run(folder, std::string("convert a.raw b.raw ") + options);
    REQUIRE_MESSAGE(result.code == 0, result.err);
    const Content converted = content_of(folder / "b.raw");
    CHECK(converted.size == wanted.size);
    CHECK(converted.events == wanted.events);
    CHECK(converted.triggers == wanted.triggers);
  }
}

TEST_CASE("examples: convert says which times a format cannot hold, and shifts them on request") {
  const TemporaryFolder folder;
  std::string text = "%geometry:640,480\n";
  for (int i = 0; i < 1000; ++i) text += "1,2,1," + std::to_string(1504645177000000 + 10 * i) + "\n";
  write_file(folder / "epoch.csv", text);
  const Result refused = run(folder, "convert epoch.csv a.raw");
  CHECK(refused.code == 1);
  CHECK(refused.err ==
        "convert: a.raw: EVT3 can hold none of the times, t is 1504645177000000 us: --shift-time makes them begin at "
        "0\n");
  CHECK(folder.files() == 3);
  REQUIRE(run(folder, "convert epoch.csv a.raw --shift-time").code == 0);
  const Content shifted = content_of(folder / "a.raw");
  REQUIRE(shifted.events.size() == 1000);
  CHECK(shifted.events.back() == evmarker::Event{1, 2, 1, 9990});

  // Two events before the clock of EVT3 wraps, at 2^24 us, that come when it has.
  write_file(folder / "late.csv",
             "%geometry:640,480\n1,2,1,16777200\n1,2,1,16777217\n1,2,1,16777210\n"
             "1,2,1,16777211\n1,2,1,16777220\n");
  const Result late = run(folder, "convert late.csv b.raw");
  CHECK_MESSAGE(late.code == 0, late.err);
  CHECK(contains(late.out, "recording  2 events are lost, whose times EVT3 cannot hold\n"));
  CHECK(contains(late.out, "EVT3: 3 events in b.raw"));
  CHECK(content_of(folder / "b.raw").events ==
        std::vector<evmarker::Event>{{1, 2, 1, 16777200}, {1, 2, 1, 16777217}, {1, 2, 1, 16777220}});
}

TEST_CASE("examples: convert writes to a pipe, and keeps what there is when it is interrupted") {
  const TemporaryFolder folder;
  link_simulated(folder);
  REQUIRE(run(folder, "track_file recording.raw" + kOptions + " --output whole.csv").code == 0);
  const Result piped = run(folder, "track_file /dev/stdin" + kOptions + " --output poses.csv", "stderr.txt",
                           with_path("convert recording.raw /dev/stdout --format evt2") + " 2>summary.txt | ");
  CHECK_MESSAGE(piped.code == 0, piped.err);
  CHECK(read_file(folder / "poses.csv") == read_file(folder / "whole.csv"));
  CHECK(contains(read_file(folder / "summary.txt"), " events in /dev/stdout"));

  const Content recorded = content_of(folder / "recording.raw");
  const Fifo fifo(folder / "fifo", read_file(folder / "recording.raw"));  // which stays open
  Child child(folder, "convert fifo a.raw");
  REQUIRE(child.wait_until([&] { return is_filled(folder / "a.raw.part"); }));
  child.kill(SIGINT);
  const Result result = child.wait();
  CHECK_MESSAGE(result.code == 130, result.err);
  const Content kept = content_of(folder / "a.raw");
  CHECK(kept.events.size() > 1000);
  REQUIRE(kept.events.size() <= recorded.events.size());
  CHECK(std::ranges::equal(kept.events, std::span(recorded.events).first(kept.events.size())));
  CHECK(result.err.starts_with("convert: interrupted after 0."));
  CHECK(result.err.ends_with(" kept " + std::to_string(kept.events.size()) + " events in a.raw\n"));
  CHECK_FALSE(std::filesystem::exists(folder / "a.raw.part"));
}

TEST_CASE("examples: info reports what was put into a recording") {
  // Noise of 2 Hz per pixel, two hot pixels, a pause, triggers and an event whose time is wrong.
  const TemporaryFolder folder;
  const evmarker::SensorSize size{320, 240};
  std::mt19937 random(9);
  std::exponential_distribution<double> interval_us(2e-6 * size.width * size.height);
  const auto below = [&](int limit) { return static_cast<std::uint16_t>(random() % static_cast<unsigned>(limit)); };
  evmarker::io::RawWriter writer(folder / "a.raw", size, evmarker::io::RawFormat::evt2);
  std::uint64_t events = 0, on = 0;
  const auto write = [&](const evmarker::Event& event) {
    writer.write(event);
    ++events;
    on += event.p == 1;
  };
  double t_us = 1000000;
  evmarker::Timestamp next_hot = 1000000;
  while (t_us < 3000000) {
    t_us += interval_us(random);
    if (t_us > 2000000 && t_us < 2050000) t_us = 2050000 + 5;
    const auto t = static_cast<evmarker::Timestamp>(t_us);
    for (; next_hot < t; next_hot += 200) {
      if (next_hot > 2000000 && next_hot < 2050000) continue;
      write({100, 50, 1, next_hot});
      if (next_hot % 400 == 0) write({200, 150, 1, next_hot});
    }
    write({below(size.width), below(size.height), static_cast<std::int16_t>(below(4) == 0), t});
    if (events == 100000) write({5, 5, 1, 900000000});
  }
  for (int i = 0; i < 5; ++i) writer.write_trigger({6, i % 2 == 0, 3000000});
  writer.close();

  const Result result = run(folder, "info a.raw");
  CAPTURE(result.out);
  REQUIRE_MESSAGE(result.code == 0, result.err);
  CHECK(result.err.empty());
  CHECK(result.out.starts_with("a.raw\nformat     Prophesee RAW, EVT2\nsensor     320 x 240 px\nevents     " +
                               std::to_string(events) + ", "));
  const auto number_after = [&](const std::string& word) {
    const auto at = result.out.find(word);
    REQUIRE_MESSAGE(at != std::string::npos, word);
    return std::stod(result.out.substr(at + word.size()));
  };
  CHECK(number_after(std::to_string(events) + ", ") ==
        doctest::Approx(100 * static_cast<double>(on) / static_cast<double>(events)).epsilon(0.002).scale(0));
  CHECK(contains(result.out, "time       1.0000"));
  CHECK(contains(result.out, " s: 2.00 s\n"));
  CHECK(number_after("rate       ") == doctest::Approx(static_cast<double>(events) / 2000).epsilon(0.01).scale(0));
  CHECK(contains(result.out, " k/s mean, "));
  CHECK(number_after("gaps       longest ") == doctest::Approx(50).epsilon(0.01).scale(0));
  CHECK(contains(result.out, " ms, after 2.000000 s; 1 of more than 0."));
  CHECK(number_after("noise      ") == doctest::Approx(2).epsilon(0.1).scale(0));
  CHECK(contains(result.out, "hot pixels 2: (100, 50) 4.88 k/s, (200, 150) 2.44 k/s\n"));
  CHECK(contains(result.out, "triggers   input 6: 3 rising, 2 falling\n"));
  CHECK(contains(result.out, "recording  1 events whose time neither"));
  CHECK(contains(result.out, "recording  1 steps back in time\n"));
}

TEST_CASE("examples: info plots the rate, and goes on behind a recording that it cannot read") {
  const TemporaryFolder folder;
  std::string text = "%geometry:640,480\n";  // 1 kHz for a second, then 4 kHz
  for (int i = 0; i < 5000; ++i) text += "1,2,1," + std::to_string(i < 1000 ? 1000 * i : 750000 + 250 * i) + "\n";
  write_file(folder / "a.csv", text);
  write_file(folder / "cut.csv", text_events(100, 100) + "1,2,x,3\n");
  const Result result = run(folder, "info --size 640,480 cut.csv a.csv missing.raw");
  CAPTURE(result.out);
  CHECK(result.code == 1);
  CHECK(contains(result.out, "cut.csv\nformat     text, columns x y p t, time in us\n"));
  CHECK(contains(result.out, "events     100, 100.0 % ON\n"));
  CHECK(contains(result.out, "events     5000, 100.0 % ON\n"));
  CHECK(contains(result.err, "info: cut.csv: line 101: p is 'x'"));
  CHECK(contains(result.err, "info: missing.raw: "));
  CHECK(result.err.ends_with("info: 2 of 3 recordings cannot be read to the end\n"));

  const std::string plot = result.out.substr(result.out.find("\na.csv"));
  std::vector<std::string> rows;
  for (const std::string& line : split(plot, '\n')) {
    if (line.find('|') != 10) continue;
    CHECK(line.size() <= 80);
    rows.push_back(line.substr(11));
  }
  REQUIRE(rows.size() == 8);
  REQUIRE(rows.back().size() == 66);
  for (std::size_t row = 0; row < rows.size(); ++row)
    for (const std::size_t column :
         {std::size_t{0}, std::size_t{15}, std::size_t{30}, std::size_t{36}, std::size_t{64}}) {
      const char mark = column < rows[row].size() ? rows[row][column] : ' ';
      CAPTURE(row);
      CAPTURE(column);
      CHECK((mark == '#') == (column > 33 || row >= 6));  // 2 and 8 of 8 rows
    }
}

TEST_CASE("examples: track_file keeps its poses when it is interrupted") {
  for (const auto& [signal, code] : {std::pair(SIGINT, 130), std::pair(SIGTERM, 143)}) {
    const TemporaryFolder folder;
    link_simulated(folder);
    const Result whole = run(folder, "track_file recording.raw" + kOptions + " --output whole.csv");
    REQUIRE_MESSAGE(whole.code == 0, whole.err);
    const Fifo fifo(folder / "fifo", read_file(folder / "recording.raw"));  // which stays open
    Child child(folder, "track_file fifo" + kOptions + " --output poses.csv --overlay overlay.png --truth truth.csv");
    REQUIRE(child.wait_until([&] { return is_filled(folder / "poses.csv.part"); }));
    child.kill(signal);
    const Result result = child.wait();
    CHECK_MESSAGE(result.code == code, result.err);
    const std::string poses = read_file(folder / "poses.csv");
    CHECK(poses.ends_with('\n'));
    CHECK(read_file(folder / "whole.csv").starts_with(poses));
    CHECK(std::ranges::count(result.err, '\n') == 1);
    CHECK_MESSAGE(result.err.starts_with("track_file: interrupted after 0."), result.err);
    CHECK_MESSAGE(result.err.ends_with(" s of the recording: kept " + std::to_string(read_table(poses).size()) +
                                       " poses in poses.csv, overlay.png\n"),
                  result.err);
    CHECK(read_table(poses).size() > 100);
    CHECK(contains(result.out, "marker 7 "));
    CHECK(is_filled(folder / "overlay.png"));
    CHECK(folder.files() == 9);  // three links, two tables, picture, FIFO, stdout and stderr: no parts
  }
}

TEST_CASE("examples: an interruption ends the waiting for a FIFO, and a second one the program at once") {
  const TemporaryFolder folder;
  link_simulated(folder);
  const Fifo silent(folder / "silent", "");
  {
    Child child(folder, "track_file silent" + kOptions + " --output poses.csv --overlay overlay.png");
    REQUIRE(child.wait_until([&] { return child.catches(SIGINT); }));
    child.kill(SIGINT);
    const Result result = child.wait();
    CHECK(result.code == 130);
    CHECK(result.err == "track_file: interrupted after 0.00 s of the recording\n");
    CHECK(folder.files() == 6);
  }
  // Reading the truth is not interrupted.
  Child child(folder, "track_file recording.raw" + kOptions + " --truth silent");
  REQUIRE(child.wait_until([&] { return child.reads(folder / "silent"); }));
  child.kill(SIGINT);
  REQUIRE(child.wait_until([&] { return !child.catches(SIGINT); }));
  child.kill(SIGINT);
  child.wait();
  CHECK(child.ended_by() == SIGINT);
}

TEST_CASE("examples: simulate keeps the recording and its truth when it is interrupted") {
  const TemporaryFolder folder;
  Child child(folder, "simulate long.raw --duration 100000 --truth truth.csv --noise 10");
  REQUIRE(child.wait_until([&] { return is_filled(folder / "long.raw.part"); }));
  child.kill(SIGTERM);
  const Result result = child.wait();
  CHECK_MESSAGE(result.code == 143, result.err);
  evmarker::io::RawReader reader(folder / "long.raw");
  const auto events = drain(reader);
  CHECK(reader.statistics().truncated_bytes == 0);
  const auto truth = read_table(read_file(folder / "truth.csv"));
  REQUIRE(!events.empty());
  CHECK(std::abs(static_cast<double>(events.back().t) - truth.back().t_us) < 10000);
  CHECK_MESSAGE(
      contains(result.err, " s of the recording: kept " + std::to_string(events.size()) + " events in long.raw, " +
                               std::to_string(truth.size()) + " poses in truth.csv\n"),
      result.err);
  CHECK(folder.files() == 5);  // with the calibration, stdout and stderr
}

TEST_CASE("examples: replay keeps its poses and delays when it is interrupted") {
  if (kPrograms.at("replay").empty()) {
    MESSAGE("skipped: built without the component live");
    return;
  }
  const TemporaryFolder folder;
  link_simulated(folder);
  Child child(folder, "replay recording.raw" + kOptions + " --speed 0.0001 --output poses.csv --delays delays.csv");
  REQUIRE(child.wait_until([&] { return std::filesystem::exists(folder / "delays.csv.part"); }));
  child.kill(SIGINT);
  const Result result = child.wait();
  CHECK_MESSAGE(result.code == 130, result.err);
  const auto poses = read_table(read_file(folder / "poses.csv"));
  CHECK_MESSAGE(contains(result.err, ": kept " + std::to_string(poses.size()) + " poses in poses.csv, "), result.err);
  CHECK(read_file(folder / "delays.csv").starts_with("time_s,delay_ms\n"));
  CHECK(folder.files() == 7);
}

TEST_CASE("examples: no file is overwritten by way of a link, and a link stays") {
  const TemporaryFolder folder;
  for (const char* name : {"recording.raw", "camera.yml", "truth.csv"})
    std::filesystem::copy(simulated() / name, folder / name);
  std::filesystem::create_hard_link(folder / "recording.raw", folder / "hard");
  std::filesystem::create_symlink("recording.raw", folder / "soft");
  std::filesystem::create_symlink("new.csv", folder / "to_new");
  const std::string track = "track_file recording.raw" + kOptions;
  for (const char* output : {"hard", "soft", "./recording.raw"}) {
    const Result result = run(folder, track + " --output " + output);
    CHECK(result.code == 1);
    CHECK_MESSAGE(contains(result.err, std::string("--output ") + output + " would overwrite the recording"),
                  result.err);
    CHECK(read_file(folder / "recording.raw") == simulated_file("recording.raw"));
  }
  const Result twice = run(folder, track + " --output to_new --overlay new.csv");
  CHECK_MESSAGE(contains(twice.err, "--overlay new.csv would overwrite --output to_new"), twice.err);
  CHECK(folder.files() == 8);

  const Result linked = run(folder, track + " --output to_new");
  CHECK_MESSAGE(linked.code == 0, linked.err);
  CHECK(std::filesystem::is_symlink(folder / "to_new"));
  CHECK(is_filled(folder / "new.csv"));
  const Result nowhere = run(folder, track + " --output /dev/null --overlay overlay.png");
  CHECK_MESSAGE(nowhere.code == 0, nowhere.err);
}

TEST_CASE("examples: where no marker is found, track_file says so with an exit code of its own") {
  const TemporaryFolder folder;
  link_simulated(folder);
  const Result none = run(folder, "track_file recording.raw" + kOptions + " --ids 3 --output poses.csv");
  CHECK(none.code == 2);
  CHECK_MESSAGE(none.err.starts_with("track_file: no marker was tracked, but others were read: 7"), none.err);
  CHECK(contains(none.out, " read, "));
  CHECK(read_table(read_file(folder / "poses.csv")).empty());
  const Result one = run(folder, "track_file recording.raw" + kOptions + " --relative 7,8 --output rel.csv");
  CHECK(one.code == 2);
  CHECK(one.err ==
        "track_file: --relative: 7 and 8 were never tracking at the same time (markers of a board are not tracked "
        "alone)\n");
  CHECK(read_table(read_file(folder / "rel.csv")).empty());
  const Result help = run(folder, "track_file --help");
  CHECK_MESSAGE(contains(help.out, "2 no marker or body was found"), help.out);
  CHECK_MESSAGE(contains(help.out, "130 or 143 interrupted"), help.out);

  if (kPrograms.at("replay").empty()) return;  // built without the component live
  const Result replayed = run(folder, "replay recording.raw" + kOptions + " --ids 3");
  CHECK(replayed.code == 2);
  CHECK_MESSAGE(replayed.err.starts_with("replay: no marker was tracked: "), replayed.err);
  CHECK(contains(replayed.out, "latency_us "));
  CHECK(contains(run(folder, "replay --help").out, "2 no marker was found"));
}

TEST_CASE("examples: where no marker is tracked, what was read tells why") {
  const TemporaryFolder folder;
  link_simulated(folder);
  std::string mirrored = "x,y,p,t_us\n", swapped = mirrored, unordered = mirrored;
  evmarker::io::EventReader recording(folder / "recording.raw");
  for (auto batch = recording.next_batch(); !batch.empty(); batch = recording.next_batch())
    for (const evmarker::Event& e : batch) {
      const auto line = [&](int x, int p, evmarker::Timestamp t) {
        return std::to_string(x) + "," + std::to_string(e.y) + "," + std::to_string(p) + "," + std::to_string(t) + "\n";
      };
      mirrored += line(639 - e.x, e.p, e.t);
      swapped += line(e.x, 1 - e.p, e.t);
      unordered += line(e.x, e.p, 7919 * e.t % 600000);
    }
  write_file(folder / "mirrored.csv", mirrored);
  write_file(folder / "swapped.csv", swapped);
  write_file(folder / "unordered.csv", unordered);
  write_file(folder / "wide.yml",
             "board: 100\nborder: 2\nmarkers: [{id: 7, length: 0.1, rotation: [0, 0, 0], translation: [0, 0, 0]}]\n");
  const std::string alone = "track_file recording.raw --camera camera.yml --marker-length ";
  for (const auto& [command, said] : std::vector<std::pair<std::string, std::string>>{
           {alone + "3:0.1", "but others were read: 7; name them in --ids"},
           {alone + "0.1 --ids 3", "but others were read: 7; name them in --ids"},
           {alone + "0.1 --dictionary DICT_6X6_250",
            "of another dictionary are read: 7; give --dictionary DICT_4X4_50\n"},
           {"track_file recording.raw --camera camera.yml --board wide.yml",
            "of another dictionary are read: 7; give --dictionary DICT_4X4_50, and a --board with border: 1\n"},
           {"track_file mirrored.csv" + kOptions, "are read in the mirrored image: 7;"},
           {"track_file swapped.csv" + kOptions, "are read with ON and OFF exchanged: 7;"},
           {"track_file unordered.csv" + kOptions, "are its events in the order of time?"}}) {
    const Result result = run(folder, command);
    CHECK(result.code == 2);
    CHECK_MESSAGE(contains(result.err, "track_file: no marker was tracked"), result.err);
    CHECK_MESSAGE(contains(result.err, said), result.err);
  }
}

TEST_CASE("examples: a marker's length that may be in centimetres is asked about") {
  const Result ten = run(simulated(), "track_file recording.raw --camera camera.yml --marker-length 10");
  CHECK(contains(ten.err, "a marker's length of 10 is taken as metres: for 10 cm give 0.1\n"));
  const Result half = run(simulated(), "track_file recording.raw --camera camera.yml --marker-length 7:0.5");
  CHECK_MESSAGE(half.err.empty(), half.err);
}

TEST_CASE("examples: a truth of other markers or times is named at the end, and the poses are kept") {
  const TemporaryFolder folder;
  link_simulated(folder);
  const std::string truth = simulated_file("truth.csv");
  // TUM, with each time multiplied by a factor or shifted.
  const auto tum = [&](double factor, double shift_s) {
    std::string text;
    for (const Row& row : read_table(truth)) {
      char line[200];
      std::snprintf(line, sizeof line, "%.9f %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n", factor * 1e-6 * row.t_us + shift_s,
                    row.translation.x(), row.translation.y(), row.translation.z(), row.rotation.x(), row.rotation.y(),
                    row.rotation.z(), row.rotation.w());
      text += line;
    }
    return text;
  };
  write_file(folder / "other.csv", replaced(truth, ",7,tracking", ",9,tracking"));
  write_file(folder / "later.txt", tum(1, 100));
  write_file(folder / "us.txt", tum(1e6, 0));
  write_file(folder / "good.txt", tum(1, 0));
  write_file(folder / "half.txt", [&] {
    std::string text = tum(1, 0);
    return text.substr(0, text.find('\n', text.size() / 2) + 1);
  }());

  struct Case {
    std::string truth;
    int code;
    std::vector<std::string> said;
  };
  const std::vector<Case> cases{
      {"other.csv", 1, {"other.csv: true poses of marker 9", "of recording.raw are of marker 7"}},
      {"later.txt", 1, {"later.txt: true poses from 100.000 to 100.600 s", "from 0.0", "seconds in TUM format"}},
      {"us.txt", 0, {"us.txt: only 0 of its poses are from 0.0", "interpolated", "seconds in TUM format"}},
      {"good.txt", 0, {}},
      {"half.txt", 0, {}},
  };
  std::map<std::string, std::string> printed;
  for (const Case& compared : cases) {
    CAPTURE(compared.truth);
    const Result tracked =
        run(folder, "track_file recording.raw" + kOptions + " --output poses.csv --truth " + compared.truth);
    printed[compared.truth] = tracked.out;
    CHECK_MESSAGE(tracked.code == compared.code, tracked.err);
    CHECK(std::ranges::count(tracked.err, '\n') == (compared.said.empty() ? 0 : 1));
    for (const std::string& part : compared.said) CHECK_MESSAGE(contains(tracked.err, part), tracked.err);
    CHECK(contains(tracked.out, "marker 7 "));
    CHECK(read_table(read_file(folder / "poses.csv")).size() > 500);
    const Result evaluated = run(folder, "evaluate poses.csv --truth " + compared.truth);
    CHECK_MESSAGE(evaluated.code == compared.code, evaluated.err);
    CHECK(evaluated.err.empty() == compared.said.empty());
  }
  // Poses without a true one are tracked all the same, but their errors are not known.
  const auto line_with = [&](const char* file, const char* part) {
    for (const std::string& line : split(printed[file], '\n'))
      if (contains(line, part)) return line;
    return std::string();
  };
  CHECK(line_with("half.txt", "tracked in") == line_with("good.txt", "tracked in"));
  CHECK(contains(line_with("good.txt", "tracked in"), " % of the 10 ms slots"));
  CHECK(line_with("good.txt", "of its").empty());
  CHECK_MESSAGE(contains(line_with("half.txt", "of its"), "no true one is known"), printed["half.txt"]);
}

TEST_CASE("examples: of a ROS recording, the topic that is named gives the poses of the same events in RAW") {
  const TemporaryFolder folder;
  link_simulated(folder);
  evmarker::io::RawReader recording(folder / "recording.raw");
  const auto events = drain(recording);
  const std::string type = "event_camera_msgs/msg/EventPacket",
                    channels = mcap_channel(1, "/left/events", type) + mcap_channel(2, "/right/events", type);
  std::string ros = mcap_begin() + channels;
  for (const std::string& message : event_messages(events, recording.sensor_size(), RosEvents::libcaer, true))
    ros += mcap_message(1, message);
  write_file(folder / "a.mcap", ros + mcap_end(ros.size(), channels));

  const Result raw = run(folder, "track_file recording.raw" + kOptions + " --output raw.csv");
  REQUIRE_MESSAGE(raw.code == 0, raw.err);
  const Result left = run(folder, "track_file a.mcap --topic /left/events" + kOptions + " --output left.csv");
  REQUIRE_MESSAGE(left.code == 0, left.err);
  CHECK(read_file(folder / "left.csv") == read_file(folder / "raw.csv"));
  for (const std::string& topic : {std::string(), std::string(" --topic /events")}) {
    const Result other = run(folder, "track_file a.mcap" + topic + kOptions + " --output other.csv");
    CHECK(other.code == 1);
    CHECK_MESSAGE(
        contains(other.err, "a.mcap: " + std::string(topic.empty() ? "several topics" : "topic is '/events'")),
        other.err);
    CHECK_MESSAGE(contains(other.err, "/left/events and /right/events"), other.err);
    CHECK(std::count(other.err.begin(), other.err.end(), '\n') == 1);
    CHECK(!std::filesystem::exists(folder / "other.csv"));
  }
}

TEST_CASE("examples: times at both ends of their range are survived") {
  const TemporaryFolder folder;
  link_simulated(folder);
  const std::string first = "-9223372036854775808", last = "9223372036854775807";
  std::string text;
  for (const std::string& t : {first, last, first, std::string("0"), last, last, std::string("0"), first})
    for (const char* x : {"100", "101", "102"}) text += std::string(x) + ",100,1," + t + "\n";
  write_file(folder / "a.csv", text);
  const Result result =
      run(folder, "track_file a.csv --time-unit us" + kOptions + " --output poses.csv --overlay overlay.png");
  CHECK_MESSAGE(result.code == 2, result.err);
  CHECK(contains(result.out, "24 read"));
}

TEST_CASE("examples: bad input gives one clear line and leaves nothing") {
  const std::string calibration = simulated_file("camera.yml"), whole = simulated_file("recording.raw");
  const std::string track = "track_file recording.raw" + kOptions, simulate = "simulate new.raw --duration 0.02";
  const std::string alone = "track_file recording.raw --camera camera.yml";
  const std::string with_camera = "track_file recording.raw --marker-length 0.10 --camera ";
  const auto track_this = [](const std::string& name) { return "track_file " + name + kOptions; };
  const auto body = [](std::string text) { return [text](const std::string&) { return text; }; };
  std::string seconds;
  for (int i = 0; i < 1000; ++i) seconds += "100,100,1,0.00" + std::to_string(1000 + i) + "\n";
  for (const char* screen : {"DISPLAY", "WAYLAND_DISPLAY"}) ::unsetenv(screen);

  struct Case {
    std::string command;
    std::vector<std::string> expected;    // parts of the line
    std::string file = "", content = "";  // made before
  };
  const std::vector<Case> cases{
      {track_this("missing.raw"), {"missing.raw", "No such file"}},
      {track_this("empty.raw"), {"empty.raw", "empty"}, "empty.raw", ""},
      {track_this("empty.csv"), {"empty.csv", "empty"}, "empty.csv", ""},
      {track_this("."), {".", "directory"}},
      {track + " --dictionary DICT_9X9_50", {"DICT_9X9_50", "DICT_4X4_50"}},
      {with_camera + "missing.yml", {"missing.yml", "No such file"}},
      {with_camera + ".", {"calibration .", "directory"}},
      {with_camera + "c.yml", {"c.yml", "empty"}, "c.yml", ""},
      {with_camera + "c.yml", {"c.yml", "image_width"}, "c.yml", replaced(calibration, "image_width", "width")},
      {with_camera + "c.yml", {"c.yml", "camera_matrix"}, "c.yml", replaced(calibration, "camera_matrix", "matrix")},
      {with_camera + "c.yml",
       {"c.yml", "distortion_coefficients"},
       "c.yml",
       replaced(calibration, "distortion_coefficients", "D")},
      {with_camera + "c.yml",
       {"c.yml", "camera_matrix[0]", "nan"},
       "c.yml",
       replaced(calibration, "[ 533.,", "[ .Nan,")},
      {with_camera + "c.yml", {"c.yml", "image_width", "-640"}, "c.yml", replaced(calibration, "640", "-640")},
      {with_camera + "c.yml", {"c.yml"}, "c.yml", random_bytes(500)},
      {with_camera + "c.yml", {"c.yml", "nested"}, "c.yml", "a: " + std::string(300000, '[') + "\n"},
      {with_camera + "c.yml",
       {"recording.raw", "640 x 480", "c.yml", "320 x 480"},
       "c.yml",
       replaced(calibration, "640", "320")},
      {"track_file recording.raw --camera camera.yml --marker-length 0", {"--marker-length", "0 "}},
      {"track_file recording.raw --camera camera.yml --marker-length -0.1", {"--marker-length", "-0.1"}},
      {"track_file recording.raw --camera camera.yml --marker-length nan", {"--marker-length", "nan"}},
      {"track_file recording.raw --camera camera.yml --marker-length wide", {"--marker-length", "wide"}},
      {"track_file recording.raw --camera camera.yml --marker-length 100",
       {"--marker-length", "100 is taken as metres", "for 100 mm give 0.1"}},
      {"track_file recording.raw --camera camera.yml --marker-length 0.0005",
       {"--marker-length", "0.0005 is taken as metres", "from 0.001"}},
      {"track_file recording.raw --camera camera.yml --marker-length 7:100",
       {"--marker-length 7:100", "for 100 mm give 0.1"}},
      {"track_file recording.raw --camera camera.yml --marker-length x:0.1", {"--marker-length x:0.1", "\"x\""}},
      {track + " --marker-length 0.2", {"--marker-length 0.2", "twice", "ID:METRES"}},
      {track + " --marker-length 7:0.1 --marker-length 7:0.2", {"--marker-length 7:0.2", "marker 7", "twice"}},
      {track + " --marker-length 50:0.1", {"50 markers", "id 50"}},
      {"track_file recording.raw --camera camera.yml --marker-length 7:0.1 --ids 3,7",
       {"marker 3", "--marker-length 3:METRES"}},
      {track + " --markers missing.yml", {"marker lengths missing.yml", "No such file"}},
      {track + " --markers s.yml",
       {"s.yml", "marker 7", "for 100 mm give 0.1"},
       "s.yml",
       "markers: [{ id: 7, length: 100 }]\n"},
      {track + " --marker-length 7:0.1 --markers s.yml",
       {"marker", "7", "s.yml"},
       "s.yml",
       "markers: [{ id: 7, length: 0.1 }]\n"},
      {simulate + " --marker-length 35", {"--marker-length", "for 35 mm give 0.035"}},
      {track + " --output recording.raw", {"--output recording.raw", "the recording recording.raw"}},
      {track + " --output ./camera.yml", {"--output ./camera.yml", "--camera camera.yml"}},
      {track + " --truth truth.csv --output truth.csv", {"--output truth.csv", "--truth truth.csv"}},
      {track + " --output o.png --overlay ./o.png", {"--overlay ./o.png", "--output o.png"}},
      {track + " --output o.mp4 --video o.mp4", {"--video o.mp4", "--output o.mp4"}},
      {track + " --output stdout.txt", {"--output stdout.txt", "the standard output"}},
      {track + " --board b.yml --output b.yml", {"--output b.yml", "--board b.yml"}, "b.yml", kBoard},
      {alone + " --wireframe w.yml --output w.yml", {"--output w.yml", "--wireframe w.yml"}, "w.yml", kBody},
      {track_this("p.csv.part") + " --output p.csv",
       {"--output p.csv", "the recording p.csv.part"},
       "p.csv.part",
       text_events(100, 100)},
      {"simulate new.yml --duration 0.02", {"--calibration new.yml", "the recording new.yml"}},
      {simulate + " --truth ./new.raw", {"--truth ./new.raw", "the recording new.raw"}},
      {"simulate b.raw --board b.yml --duration 0.02", {"--calibration b.yml", "--board b.yml"}, "b.yml", kBoard},
      {"evaluate truth.csv --truth truth.csv --errors truth.csv", {"--errors truth.csv", "poses truth.csv"}},
      {"evaluate truth.csv --truth truth.csv --errors b.raw", {"--errors b.raw: must end in .csv"}, "b.raw", whole},
      {"calibration camera.yml b.raw", {"the output b.raw: must end in .yml, .yaml, .xml or .json"}, "b.raw", whole},
      {"calibrate b.raw --board truth.csv --output c", {"--output c: must end in .yml, .yaml, .xml or .json"}},
      {"make_board recording.raw --ids 7,8 --output b.raw" + kOptions,
       {"--output b.raw: must end in .yml or .yaml"},
       "b.raw",
       whole},
      {simulate + " --calibration b.raw", {"--calibration b.raw: must end in .yml, .yaml, .xml"}, "b.raw", whole},
      {track_this("cut.raw"), {"cut.raw", "header"}, "cut.raw", whole.substr(0, 40)},
      {track_this("none.raw"), {"none.raw", "no events"}, "none.raw", with_body(body(""))},
      {track_this("garbled.raw"), {"garbled.raw", "% format"}, "garbled.raw", random_bytes(20000)},
      {track_this("garbled.raw"), {"garbled.raw", "garbled"}, "garbled.raw", with_body(body(random_bytes(200000)))},
      {track_this("gz.raw"), {"gz.raw", "gzip", "gunzip <'gz.raw'"}, "gz.raw", "\x1f\x8b\x08" + random_bytes(500)},
      {track_this("evt4.raw"), {"evt4.raw", "EVT4"}, "evt4.raw", replaced(whole.substr(0, 400), "EVT3", "EVT4")},
      {track_this("off.csv"), {"off.csv", "100 of 100", "640 x 480", "camera.yml"}, "off.csv", text_events(100, 0)},
      {track_this("off.csv"), {"off.csv", "50 of 100", "640 x 480", "camera.yml"}, "off.csv", text_events(100, 50)},
      {track_this("bad.csv"), {"bad.csv", "line 101", "p is 'x'"}, "bad.csv", text_events(100, 100) + "1,2,x,3\n"},
      {track_this("tie.csv"),
       {"tie.csv", "unit of its times", "--time-unit s|ms|us|ns"},
       "tie.csv",
       text_events(100, 100, 300)},
      {track_this("tie.csv"), {"tie.csv", "'txyp' or 'xytp'", "--columns t,x,y,p"}, "tie.csv", "1,2,3,1\n4,5,6,0\n"},
      {track_this("wide.csv"), {"wide.csv", "line 1", "70000,480"}, "wide.csv", "%geometry:70000,480\n1,2,1,3\n"},
      {track_this("far.csv"), {"far.csv", "line 2", "x is '65541'"}, "far.csv", "1,2,1,3\n65541,2,1,4\n"},
      {track_this("s.csv") + " --time-unit us",
       {"s.csv", "not us", "faster than any camera's", "--time-unit s|ms|us|ns"},
       "s.csv",
       seconds},
      {track + " --topic /events", {"recording.raw", "Prophesee RAW", "--topic is for ROS recordings"}},
      {track + " --columns t,x,y,p", {"recording.raw", "Prophesee RAW", "--columns is for text"}},
      {track + " --time-unit us", {"recording.raw", "Prophesee RAW", "--time-unit is for text and HDF5"}},
      {"info recording.raw --time-unit us", {"recording.raw", "--time-unit is for text and HDF5"}},
      {track_this("a.csv") + " --topic /events",
       {"a.csv", "is text", "--topic is for"},
       "a.csv",
       text_events(100, 100)},
      {track_this("a.csv") + " --time-unit days", {"--time-unit", "days"}, "a.csv", text_events(100, 100)},
      {track_this("a.csv") + " --columns x,y,t", {"columns is 'x,y,t'"}, "a.csv", text_events(100, 100)},
      {track + " --ids 50", {"marker id 50", "DICT_4X4_50", "0 to 49"}},
      {track + " --ids=-1", {"-1", "0 to 49"}},
      {track + " --ids seven", {"--ids", "seven"}},
      {track + " --events-per-update 0", {"--events-per-update", "0 "}},
      {track + " --events-per-update -5", {"--events-per-update", "-5"}},
      {track + " --filter-window-us 0", {"--filter-window-us", "0 "}},
      {track + " --filter-window-us -2000", {"--filter-window-us", "-2000"}},
      {track + " --events-per-update often", {"--events-per-update", "often", "auto"}},
      {track + " --filter-window-us 1.5", {"--filter-window-us", "1.5", "auto"}},
      {track + " --update magic", {"--update", "magic"}},
      {track + " --latency-us -1", {"--latency-us", "-1"}},
      {track + " --latency-sigma-us 0", {"--latency-sigma-us", "0 "}},
      {track + " --latency-us 100 --update paper", {"--latency-us", "--update kalman"}},
      {with_camera + "c.yml", {"c.yml", "several cameras, cam0, cam1", "--camera-name cam0"}, "c.yml", kTwoCameras},
      {with_camera + "c.yml --camera-name cam2", {"c.yml", "no camera cam2"}, "c.yml", kTwoCameras},
      {with_camera + "c.txt", {"c.txt", "no sensor size", "--size"}, "c.txt", "500 500 320 240 0 0 0 0 0\n"},
      {track + " --size 320,480", {"camera.yml", "640 x 480", "320 x 480"}},
      {track + " --truth missing.csv", {"missing.csv", "No such file"}},
      {track + " --truth t.csv", {"t.csv", "line 2"}, "t.csv", std::string(kPoseHeader) + "\n1,7,tracking\n"},
      {track + " --output missing/o.csv", {"missing/o.csv", "No such file"}},
      {track + " --output .", {".", "directory"}},
      {track + " --overlay missing/o.png", {"missing/o.png", "No such file"}},
      {track + " --overlay o.xyz", {"o.xyz", ".png"}},
      {track + " --overlay o", {"o: ", ".png"}},
      {track + " --video missing/v.mp4", {"missing/v.mp4", kScreen ? "No such file" : "videoio"}},
      {track + " --video v.xyz", {"v.xyz", kScreen ? ".mp4" : "videoio"}},
      {track + " --video v", {"v: ", kScreen ? ".mp4" : "videoio"}},
      {track + " --video v.mp4 --video-fps 0", {"--video-fps", "0 "}},
      {track + " --video v.mp4 --video-fps nan", {"--video-fps", "nan"}},
      {track + " --video v.mp4 --truth missing.csv", {"missing.csv", "No such file"}},
      {"track_file none.raw --video v.mp4" + kOptions,
       {"none.raw", kScreen ? "no events" : "videoio"},
       "none.raw",
       with_body(body(""))},
      {track + " --video-fps 30", {"--video-fps", "--video"}},
      {alone + " --marker-length 7:0.1 --relative 7,9", {"--relative: 9", "not tracked"}},
      {alone + " --board b.yml --relative 100,1", {"--relative: 1", "board 100"}, "b.yml", kBoard},
      {track + " --show", {"--show", "window"}},
      {"track_file recording.raw --marker-length 0.10", {"--camera", "required"}},
      {"track_file recording.raw --camera camera.yml", {"--marker-length", "required"}},
      {track + " --board missing.yml", {"board missing.yml", "No such file"}},
      {track + " --board b.yml",
       {"board b.yml", "markers[0] length", "wide"},
       "b.yml",
       replaced(kBoard, "0.05", "wide")},
      {track + " --board b.yml", {"board b.yml", "marker 1", "twice"}, "b.yml", replaced(kBoard, "id: 2", "id: 1")},
      {track + " --board b.yml --board b.yml", {"board 100", "twice"}, "b.yml", kBoard},
      {"track_file recording.raw --camera camera.yml --board b.yml --ids 7",
       {"--ids", "--marker-length"},
       "b.yml",
       kBoard},
      {alone + " --wireframe missing.yml", {"wireframe missing.yml", "No such file"}},
      {alone + " --wireframe w.yml", {"w.yml", "start", "--start"}, "w.yml", kBody},
      {alone + " --wireframe w.yml --start 0,0,1,1,0,0", {"--start", "7"}, "w.yml", kBody},
      {alone + " --wireframe w.yml --start 0,0,near,1,0,0,0", {"--start", "near"}, "w.yml", kBody},
      {alone + " --wireframe w.yml --start 0,0,nan,1,0,0,0", {"--start", "nan"}, "w.yml", kBody},
      {alone + " --wireframe w.yml --start 0,0,1,0,0,0,0", {"--start", "quaternion", "0.0"}, "w.yml", kBody},
      {alone + " --wireframe w.yml --start 0,0,-1,1,0,0,0", {"--start", "vertex 0", "z = -1 m"}, "w.yml", kBody},
      {alone + " --start 0,0,1,1,0,0,0", {"--start", "--wireframe"}},
      {track + " --wireframe w.yml", {"--wireframe", "--marker-length"}, "w.yml", kBody},
      {alone + " --wireframe w.yml",
       {"wireframe w.yml", "edges[1] to", "9"},
       "w.yml",
       replaced(kBody, "to: 2", "to: 9")},
      {simulate + " --board b.yml", {"board b.yml", "translation"}, "b.yml", replaced(kBoard, "translation", "place")},
      {simulate + " --board b.yml --ids 3", {"--board", "--ids"}, "b.yml", kBoard},
      {track + " --relative 7", {"--relative", "2"}},
      {track + " --relative 7,7", {"--relative", "7 is there twice"}},
      {track + " --relative 7,8 --frame board", {"--relative", "--frame board"}},
      {track + " --frame world", {"--frame", "world"}},
      {track + " --format xml", {"--format", "xml"}},
      {track + " --rate 0", {"--rate", "0 "}},
      {track + " --format tum --output missing/p.txt", {"missing/p.txt", "No such file"}},
      {simulate + " --turn 10", {"--turn", "3"}},
      {"calibrate recording.raw --board b.yml", {"--output", "required"}, "b.yml", kBoard},
      {"calibrate recording.raw --board b.yml --output b.yml", {"--output b.yml", "--board"}, "b.yml", kBoard},
      {"calibrate recording.raw --board b.yml --output c.yml",
       {"b.yml", "not flat", "2 faces"},
       "b.yml",
       replaced(kBoard, "rotation: [0, 0, 0], translation: [0.04", "rotation: [0, 1, 0], translation: [0.04")},
      {"make_board recording.raw --ids 7,8" + kOptions, {"--output", "required"}},
      {"make_board recording.raw --ids 7 --output b.yml" + kOptions, {"two markers or more"}},
      {"make_board recording.raw --ids 7,8 --output b.yml --origin 9" + kOptions, {"--origin", "9"}},
      {"make_board recording.raw --ids 7,100 --output b.yml" + kOptions, {"--board-id", "100"}},
      {"make_board recording.raw --ids 7,8 --output camera.yml" + kOptions, {"--output camera.yml", "--camera"}},
      {"make_board recording.raw --ids 7,8 --output b.yml" + kOptions,
       {"recording.raw", "at only 0 places", "never tracked: 8: on the body"}},
      {"convert recording.raw recording.raw", {"the output recording.raw", "the recording recording.raw"}},
      {"convert recording.raw a.xyz", {"a.xyz", ".raw, .csv, .txt, .h5 and .hdf5", "--format"}},
      {"convert recording.raw a.raw --format evt4", {"--format", "evt4"}},
      {"convert recording.raw missing/a.raw", {"missing/a.raw", "No such file"}},
      {"convert missing.raw a.raw", {"missing.raw", "No such file"}},
      {"convert recording.raw a.raw --from 2 --to 1", {"--to", "1 s", "--from, 2 s"}},
      {"convert recording.raw a.raw --from 9", {"recording.raw", "--from", "0.60 s"}},
      {"convert recording.raw a.raw --from nan", {"--from", "nan"}},
      {"convert recording.raw a.raw --to -1", {"--to", "-1"}},
      {"convert recording.raw a.raw --region 600,0,100,100", {"--region", "100 x 100 px at 600,0", "640 x 480"}},
      {"convert recording.raw a.raw --region 600,0,100", {"--region", "4"}},
      {"convert recording.raw a.raw --shift-region", {"--shift-region", "--region"}},
      {"convert recording.raw a.raw --size 320,240", {"recording.raw", "640 x 480", "--size says 320 x 240"}},
      {"convert a.csv a.raw", {"a.csv", "no sensor size", "--size 640,480"}, "a.csv", text_events(100, 100)},
      {"convert a.csv b.raw --size 3000,480 --time-unit us",
       {"b.raw", "EVT3", "width is 3000 px", "1..2048"},
       "a.csv",
       text_events(100, 100)},
      {"convert a.csv b.csv --size 640,480", {"a.csv", "50 of 100", "--size"}, "a.csv", text_events(100, 50)},
      {"convert none.raw a.csv", {"none.raw", "no events"}, "none.raw", with_body(body(""))},
      {"convert garbled.raw a.csv", {"garbled.raw", "garbled"}, "garbled.raw", with_body(body(random_bytes(200000)))},
      {"convert bad.csv a.raw --size 640,480",
       {"bad.csv", "line 101", "p is 'x'"},
       "bad.csv",
       text_events(100, 100) + "1,2,x,3\n"},
      {"convert recording.raw /dev/null --format hdf5", {"/dev/null", kHdf5 ? "not to pipes" : "libhdf5-dev"}},
      {"info missing.raw", {"missing.raw", "No such file"}},
      {"info b.yml --size 640,480", {"b.yml", "no recording", "--camera", "--board"}, "b.yml", kBoard},
      {"info c.txt --size 640,480", {"c.txt", "no recording", "--camera", "--board"}, "c.txt", calibration},
      {track_this("camera.yml"), {"camera.yml", "no recording", "--camera", "--board"}},
      {"info a.csv", {"a.csv", "no sensor size", "--size 640,480"}, "a.csv", text_events(100, 100)},
      {"evaluate missing.csv --truth truth.csv", {"missing.csv", "No such file"}},
      {"evaluate p.csv --truth truth.csv", {"p.csv", "no poses"}, "p.csv", std::string(kPoseHeader) + "\n"},
      {"evaluate p.csv --truth truth.csv", {"p.csv", "marker_id"}, "p.csv", "t_us,tx\n1,2\n"},
      {"evaluate truth.csv --truth t.csv --errors e.csv",
       {"truth.csv", "601", "t.csv"},
       "t.csv",
       replaced(simulated_file("truth.csv"), ",7,tracking", ",9,tracking")},
      {"evaluate truth.csv --truth truth.csv --errors missing/e.csv", {"missing/e.csv", "No such file"}},
      {simulate + " --ids 50", {"50", "0 to 49"}},
      {simulate + " --ids 7,7", {"--ids", "7"}},
      {simulate + " --marker-length 0", {"--marker-length", "0 "}},
      {simulate + " --marker-length 9:0.1", {"--marker-length 9", "--ids"}},
      {simulate + " --board b.yml --marker-length 0.1", {"--marker-length", "--board"}, "b.yml", kBoard},
      {simulate + " --motion spin --sway 0.1", {"--sway", "spin"}},
      {simulate + " --move 0.1", {"--move", "handheld"}},
      {simulate + " --focal nan", {"--focal", "nan"}},
      {simulate + " --distance 0", {"--distance", "0 "}},
      {simulate + " --sway 2", {"--sway", "2.0", "--distance"}},
      {simulate + " --noise -1", {"noise", "-1"}},
      {simulate + " --sensor dvs1", {"dvs1", "dvs128", "imx636"}},
      {simulate + " --lens barrel:0.1", {"--lens", "barrel", "radtan", "fisheye"}},
      {simulate + " --lens radtan:0.1,0.2,0", {"--lens", "4 or 5", "not 3"}},
      {simulate + " --lens fisheye:0.1,0.2,0,x", {"--lens", "k4", "x"}},
      {simulate + " --threshold-on 0", {"contrast_threshold_on is 0"}},
      {simulate + " --light-lag-us -3", {"light_time_constant_us", "-3"}},
      {simulate + " --leak nan", {"leak_hz_per_px", "nan"}},
      {simulate + " --blur 0", {"point_spread_px is 0"}},
      {simulate + " --black 0", {"--black", "0.0"}},
      {simulate + " --white 0.5,0.6", {"--white", "2 values", "1 markers"}},
      {simulate + " --size 100000,100000", {"width is 100000 px"}},
      {simulate + " --truth missing/t.csv --calibration new.yml", {"missing/t.csv", "No such file"}},
      {simulate + " --truth new.csv --calibration missing/c.yml", {"missing/c.yml", "No such file"}},
      {"simulate missing/r.raw --calibration new.yml --truth new.csv", {"missing/r.raw", "No such file"}},
      {"simulate new.raw --duration 0", {"--duration", "0 "}},
      {simulate + " --camera camera.yml --focal 300", {"--focal", "--camera"}},
      {simulate + " --camera camera.yml --lens radtan:0,0,0,0", {"--lens", "--camera"}},
      {simulate + " --camera missing.yml", {"missing.yml", "No such file"}},
      {"simulate b.raw --camera b.yml --calibration ./b.yml",
       {"--calibration ./b.yml", "--camera b.yml"},
       "b.yml",
       kBoard},
  };
  for (const auto& refused : cases) {
    CAPTURE(refused.command);
    const auto& [command, expected, file, content] = refused;
    if (command.starts_with("calibrate ") && kPrograms.at("calibrate").empty()) continue;  // not built without Ceres
    const TemporaryFolder folder;
    link_simulated(folder);
    if (!file.empty()) write_file(folder / file.c_str(), content);
    std::string line = command;
    if (line.starts_with("track_file")) {
      if (!contains(line, "--output")) line += " --output poses.csv";
      if (!contains(line, "--overlay")) line += " --overlay overlay.png";
    }
    const Result result = run(folder, line);
    CAPTURE(result.err);
    CHECK(result.code > 0);
    CHECK(std::ranges::count(result.err, '\n') == 1);
    CHECK(result.err.ends_with('\n'));
    for (const std::string& part : expected) CHECK_MESSAGE(contains(result.err, part), part);
    CHECK(result.out.empty());
    CHECK(folder.files() == (file.empty() ? 5 : 6));  // the three, stdout and stderr, the bad one
    if (!file.empty()) CHECK(read_file(folder / file.c_str()) == content);
  }
}

TEST_CASE("examples: damaged recordings are tracked and what is wrong is reported") {
  const auto tracked = [](const std::string& recording, const std::string& report) {
    const TemporaryFolder folder;
    write_file(folder / "damaged.raw", recording);
    write_file(folder / "camera.yml", simulated_file("camera.yml"));
    const Result result = run(folder, "track_file damaged.raw" + kOptions + " --output poses.csv");
    CAPTURE(result.out);
    CHECK_MESSAGE(result.code == 0, result.err);
    CHECK(result.err.empty());
    CHECK(contains(result.out, report));
    return read_table(read_file(folder / "poses.csv"));
  };
  const auto truth = read_table(simulated_file("truth.csv"));

  const auto cut = tracked(with_body([](const std::string& b) { return b.substr(0, b.size() * 3 / 4 | 1); }),
                           "1 bytes at the end that are no whole event");
  const MeanError error = mean_tracking_error(cut, truth);
  CHECK(error.poses > 100);
  CHECK(error.mm < 6);
  CHECK(cut.back().t_us < 0.59e6);

  // The second half stands before the whole.
  const auto back = tracked(
      with_body([](const std::string& b) { return b.substr(b.size() / 2 & ~std::size_t{1}) + b; }), "1 steps back");
  const auto step = std::ranges::adjacent_find(back, [](const Row& a, const Row& b) { return b.t_us < a.t_us; });
  REQUIRE(step != back.end());
  CHECK(mean_tracking_error({step + 1, back.end()}, truth).poses > 500);

  const auto garbled =
      tracked(with_body([](std::string b) { return b.replace(b.size() * 3 / 4, 100, random_bytes(100)); }),
              " unknown words, skipped");
  CHECK(mean_tracking_error(garbled, truth).poses > 100);
}

TEST_CASE("examples: a few wrong times do not stretch what was recorded") {
  const TemporaryFolder folder;
  link_simulated(folder);
  // A second of events, with others among them: how many, behind which event, at what time [us].
  for (const auto& [count, behind, t] : {std::tuple(50, 10000, 500000000),
                                         {1, 10000, 500000000},
                                         {50, 10000, -3000000},
                                         {1, -1, -3000000},
                                         {1, -1, 500000000},
                                         {3, 19999, 500000000}}) {
    std::string text, stray;
    for (int i = 0; i < count; ++i) stray += "50,50,1," + std::to_string(t + i) + "\n";
    if (behind < 0) text = stray;
    for (int i = 0; i < 20000; ++i) {
      text += std::to_string(100 + i % 300) + "," + std::to_string(i % 40) + ",1," + std::to_string(50 * i) + "\n";
      if (i == behind) text += stray;
    }
    write_file(folder / "a.csv", text);
    CAPTURE(count);
    CAPTURE(behind);
    CAPTURE(t);
    const Result tracked = run(folder, "track_file a.csv --time-unit us" + kOptions);
    CHECK_MESSAGE(tracked.code == 2, tracked.err);  // no marker
    CHECK_MESSAGE(contains(tracked.out, " s for 1.00 s of recording"), tracked.out);
    CHECK_MESSAGE(contains(tracked.out, "recording  " + std::to_string(count) + " events of stray times"), tracked.out);
    const Result info = run(folder, "info a.csv --time-unit us --size 640,480");
    CHECK_MESSAGE(info.code == 0, info.err);
    CHECK_MESSAGE(contains(info.out, "time       0.000000 s to 0.999950 s: 1.00 s\nrate       20"), info.out);
    CHECK_MESSAGE(contains(info.out, "recording  " + std::to_string(count) + " events "), info.out);
    CHECK_MESSAGE(contains(info.out, " 0.000 s  "), info.out);  // the left end of the plot
    CHECK_MESSAGE(contains(info.out, "gaps       longest 0.050 ms, after 0.000000 s"), info.out);
  }
}

TEST_CASE("examples: text without geometry takes the camera's size, few events off it are counted") {
  const TemporaryFolder folder;
  write_file(folder / "camera.yml", simulated_file("camera.yml"));
  write_file(folder / "a.csv", text_events(1000, 1000));
  const Result good = run(folder, "track_file a.csv" + kOptions + " --output poses.csv");
  CHECK_MESSAGE(good.code == 2, good.err);  // no marker
  CHECK(contains(good.out, "1000 read"));
  CHECK_FALSE(contains(good.out, "off the sensor"));
  CHECK(read_table(read_file(folder / "poses.csv")).empty());

  write_file(folder / "a.csv", text_events(1000, 998));
  const Result few = run(folder, "track_file a.csv" + kOptions);
  CHECK_MESSAGE(few.code == 2, few.err);
  CHECK(contains(few.out, "998 read"));
  CHECK(contains(few.out, "2 events off the sensor"));
}

TEST_CASE("examples: the columns and the unit of time of text can be given") {
  const TemporaryFolder folder;
  write_file(folder / "camera.yml", simulated_file("camera.yml"));
  write_file(folder / "a.csv", text_events(1000, 1000));
  std::string turned;  // t, x, y, p
  for (const std::string& line : split(text_events(1000, 1000), '\n'))
    if (const auto cut = line.rfind(','); cut != std::string::npos)
      turned += line.substr(cut + 1) + "," + line.substr(0, cut) + "\n";
  write_file(folder / "turned.csv", turned);
  for (const auto& text : {std::pair("a.csv", "0.01"),
                           {"a.csv --time-unit us", "0.01"},
                           {"a.csv --time-unit ms", "9.99"},
                           {"a.csv --time-unit s --columns x,y,p,t", "9990.00"},
                           {"turned.csv --columns t,x,y,p", "0.01"}}) {
    CAPTURE(text.first);
    const auto& [options, seconds] = text;
    const Result result = run(folder, std::string("track_file ") + options + kOptions);
    CHECK_MESSAGE(result.code == 2, result.err);  // no marker was found
    CHECK(contains(result.out, "1000 read"));
    CHECK(contains(result.out, std::string("for ") + seconds + " s of recording"));
  }
  if (kPrograms.at("replay").empty()) return;  // built without the component live
  const Result bad = run(folder, "replay a.csv --columns t,x,y,p --time-unit us" + kOptions);
  CHECK(contains(bad.err, "a.csv: line 2: p is '10'"));
}

TEST_CASE("examples: a progress bar on a terminal, none if told to be quiet") {
  // A pseudo terminal takes stderr; what it is sent is read on the fly, for its buffer is small.
  const auto on_terminal = [](const std::string& recording, const std::string& options = "") {
    const int terminal = ::posix_openpt(O_RDWR | O_NOCTTY);
    REQUIRE(terminal >= 0);
    REQUIRE(::grantpt(terminal) == 0);
    REQUIRE(::unlockpt(terminal) == 0);
    const std::string name = ::ptsname(terminal);
    const int held = ::open(name.c_str(), O_RDWR | O_NOCTTY);  // or reading ends with the program
    auto result = std::async(std::launch::async, [&] {
      return run(simulated(), "track_file " + recording + kOptions + options, name, "cat recording.raw | ").code;
    });
    std::string shown;
    const auto read_shown = [&](int wait_ms) {
      pollfd ready{terminal, POLLIN, 0};
      char buffer[256];
      while (::poll(&ready, 1, wait_ms) > 0) {
        const auto bytes = ::read(terminal, buffer, sizeof buffer);
        if (bytes <= 0) return;
        shown.append(buffer, static_cast<std::size_t>(bytes));
      }
    };
    while (result.wait_for(std::chrono::seconds(0)) != std::future_status::ready) read_shown(20);
    read_shown(0);
    ::close(held);
    ::close(terminal);
    CHECK(result.get() == 0);
    return shown;
  };
  const std::string bar = on_terminal("recording.raw");
  CHECK(contains(bar, "\r[####################                    ]  50 %"));
  CHECK(contains(bar, "100 %"));
  CHECK(bar.ends_with("\r\033[K"));  // wiped
  CHECK(on_terminal("recording.raw", " --quiet").empty());
  const std::string megabytes = on_terminal("/dev/stdin");  // of a size that is not known
  CHECK_MESSAGE(megabytes.starts_with("\r0 MB\r1 MB"), megabytes);
  CHECK(megabytes.ends_with("\r\033[K"));
}
