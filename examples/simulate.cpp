// Simulates an event camera in front of markers: a RAW recording, its calibration and its truth.
#include <algorithm>
#include <cstdio>
#include <evmarker/io/pose_writer.hpp>
#include <evmarker/io/raw_writer.hpp>
#include <evmarker/opencv/aruco_shim.hpp>
#include <evmarker/opencv/board.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <evmarker/simulation/sensor_preset.hpp>
#include <evmarker/simulation/simulator.hpp>
#include <evmarker/simulation/trajectory.hpp>
#include <filesystem>
#include <map>
#include <numbers>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "board_faces.hpp"
#include "camera_option.hpp"
#include "console.hpp"
#include "distinct_files.hpp"
#include "interruption.hpp"
#include "lens_option.hpp"
#include "marker_lengths.hpp"

using namespace evmarker;

namespace {

struct Options {
  std::string recording, calibration, truth, board, dictionary, motion = "handheld";
  CameraOption camera;
  SensorSize size{640, 480};
  std::vector<int> ids{7};
  std::vector<double> black{0.08}, white{0.85}, turn_deg;
  MarkerLengths lengths;
  double focal_px = 533, distance_m = 0.6, sway_m = 0.08, frequency_hz = 1.3, move_s = 0.5, rest_s = 0.5;
  Distortion lens;
  SimulatorSettings sensor{.duration_s = 3};
  bool quiet = false;

  void use(const SensorPreset& preset) {
    const double duration_s = sensor.duration_s;
    sensor = preset.settings;
    sensor.duration_s = duration_s;
    size = preset.size;
    focal_px = preset.focal_px;
  }

  void add_to(CLI::App& app) {
    app.add_option("recording", recording, "EVT3 RAW file to write")->required();
    CLI::Option* given = camera.add_to(app, "camera to simulate, in place of --focal and --lens: calibration");
    app.add_option("--calibration", calibration,
                   "calibration to write; default: beside the recording, ending in .yml, but with --camera none");
    app.add_option("--truth", truth, "true poses to write, a pose table with marker ids");
    app.add_option("--dictionary", dictionary, "OpenCV's name of the dictionary")
        ->default_str("that of --board, or " + std::string(opencv::kDefaultDictionary));
    CLI::Option* side_by_side =
        app.add_option("--ids", ids, "the markers, side by side, as 3,7")->delimiter(',')->capture_default_str();
    CLI::Option* as_one =
        app.add_option("--board", board, "in their place a board of markers that move as one, a YAML file")
            ->excludes(side_by_side);
    lengths.add_to(app, "side of the black square [m], 0.1 where none is given");
    for (const char* of_single : {"--marker-length", "--markers"}) app.get_option(of_single)->excludes(as_one);
    app.add_option("--black", black, "share of the light that the ink sends back, one for all markers or one each")
        ->delimiter(',')
        ->capture_default_str();
    app.add_option("--white", white, "share of the light that the paper sends back, one for all markers or one each")
        ->delimiter(',')
        ->capture_default_str();
    add_sensor_to(app);
    app.add_option_function<std::string>(
           "--lens", [this](const std::string& text) { lens = parse_lens(text); },
           "distortion, radtan:k1,k2,p1,p2[,k3] or fisheye:k1,k2,k3,k4, as in OpenCV; default: none")
        ->excludes(given);
    app.get_option("--focal")->excludes(given);
    app.add_option("--distance", distance_m, "of the markers from the camera [m]")
        ->check(console::positive_number())
        ->capture_default_str();
    app.add_option("--motion", motion, "how the markers move")
        ->check(CLI::IsMember({"handheld", "spin", "linear", "stop-and-go"}))
        ->capture_default_str();
    app.add_option("--sway", sway_m, "how far they move to each side [m]")
        ->check(CLI::NonNegativeNumber)
        ->capture_default_str();
    app.add_option(
           "--turn", turn_deg,
           "how far they turn to each side in a hand, about the camera's x, y and z axes, as 120,120,20 to show "
           "all sides of a body [deg]")
        ->delimiter(',')
        ->expected(3)
        ->check(CLI::Range(0.0, 1e4))
        ->default_str("14.3,14.3,20.1");
    app.add_option("--frequency", frequency_hz, "of the motion [Hz]")->capture_default_str();
    app.add_option("--move", move_s, "of stop-and-go, each time for so long [s]")
        ->check(console::positive_number())
        ->capture_default_str();
    app.add_option("--rest", rest_s, "of stop-and-go, in between for so long [s]")
        ->check(CLI::Range(0.0, 1e6))
        ->capture_default_str();
    app.add_option("--duration", sensor.duration_s, "[s]")->check(console::positive_number())->capture_default_str();
    app.add_option("--seed", sensor.seed, "of sensor and motion")->capture_default_str();
    app.add_flag("--quiet", quiet, "no progress bar");
    app.footer(console::exit_codes());
    app.callback([this, &app] { require_of_motion(app); });
  }

  // An option that the motion does not know would change nothing, without a word.
  void require_of_motion(const CLI::App& app) const {
    const std::map<std::string, std::vector<std::string>> motions{{"--sway", {"handheld", "linear", "stop-and-go"}},
                                                                  {"--turn", {"handheld", "stop-and-go"}},
                                                                  {"--frequency", {"handheld", "spin", "stop-and-go"}},
                                                                  {"--move", {"stop-and-go"}},
                                                                  {"--rest", {"stop-and-go"}}};
    for (const auto& [option, of] : motions)
      if (app.count(option) > 0 && std::ranges::count(of, motion) == 0)
        throw CLI::ValidationError(option, "changes nothing with --motion " + motion);
  }

  /// The calibration to write; empty for none.
  std::string calibration_to_write() const {
    if (!calibration.empty() || !camera.path.empty()) return calibration;
    return std::filesystem::path(recording).replace_extension(".yml").string();
  }

  PinholeCamera make_camera() const {
    if (!camera.path.empty()) return camera.load();
    const SensorSize of = camera.size.empty() ? size : SensorSize{camera.size[0], camera.size[1]};
    return {of, focal_px, focal_px, 0.5 * (of.width - 1), 0.5 * (of.height - 1), lens};
  }

  // Options are carried out in the order in which they are added: those after --sensor change single numbers of it.
  void add_sensor_to(CLI::App& app) {
    std::string names;
    for (const SensorPreset& preset : kSensorPresets) names += (names.empty() ? "" : ", ") + std::string(preset.name);
    app.add_option_function<std::string>(
           "--sensor", [this](const std::string& name) { use(sensor_preset(name)); },
           "size, focal length, thresholds, lags and noise of a kind of camera: " + names)
        ->default_str("default");
    app.add_option("--size", camera.size, "sensor, as 640,480 [px]; with --camera where that does not state it")
        ->delimiter(',')
        ->expected(2)
        ->allow_extra_args(false)  // which would be the recording
        ->default_str("640,480");
    app.add_option("--focal", focal_px, "focal length [px]: lens in mm / pixel pitch in mm")
        ->check(console::positive_number())
        ->capture_default_str();
    const auto add = [&](const char* name, double& value, const char* help) {
      app.add_option(name, value, help)->capture_default_str();
    };
    add("--threshold-on", sensor.contrast_threshold_on, "step of log intensity that makes an ON event");
    add("--threshold-off", sensor.contrast_threshold_off, "and an OFF event");
    add("--mismatch", sensor.threshold_mismatch, "of the thresholds from pixel to pixel, standard deviation");
    add("--refractory-us", sensor.refractory_us, "a pixel is dead for so long after its event [us]");
    add("--lag-us", sensor.pixel_time_constant_us, "time constant of the pixels, whatever their light [us]");
    add("--light-lag-us", sensor.light_time_constant_us,
        "time constant of a pixel that sees perfect white, inversely proportional to its light [us]");
    add("--jitter-us", sensor.latency_jitter_us, "mean time that an event waits to leave its pixel [us]");
    add("--noise", sensor.noise_hz_per_px, "events without a cause [Hz per pixel]");
    add("--leak", sensor.leak_hz_per_px, "ON events of leaking pixels [Hz per pixel]");
    add("--leak-spread", sensor.leak_spread, "of the leak from pixel to pixel, standard deviation of its logarithm");
    add("--blur", sensor.point_spread_px, "sigma of lens and pixel area together, more when out of focus [px]");
  }
};

void require_in_front(const Options& o) {
  if (o.motion != "linear" && o.motion != "spin" && o.sway_m >= o.distance_m)
    throw std::invalid_argument("--sway: " + std::to_string(o.sway_m) + " m carries the markers behind the camera, " +
                                std::to_string(o.distance_m) + " m away (--distance)");
}

// What is tracked as one: a marker or a board.
struct Target {
  MarkerId id;
  Trajectory motion;
};

// Of what is `x` metres beside the middle.
Trajectory make_motion(const Options& o, std::size_t place, double x) {
  const Eigen::Isometry3d centre = facing_pose({x, 0, o.distance_m});
  trajectory::Handheld hand{.T_centre = centre,
                            .amplitude_m = {o.sway_m, 0.8 * o.sway_m, o.sway_m},
                            .frequency_hz = o.frequency_hz,
                            .seed = o.sensor.seed + place};
  if (!o.turn_deg.empty())
    hand.amplitude_rad = std::numbers::pi / 180 * Eigen::Vector3d(o.turn_deg[0], o.turn_deg[1], o.turn_deg[2]);
  const Trajectory sway = trajectory::handheld(hand);
  if (o.motion == "spin") return trajectory::spin(centre, {0, 0, 1}, 2 * std::numbers::pi * o.frequency_hz);
  if (o.motion == "linear") {
    const double speed = 2 * o.sway_m / o.sensor.duration_s;
    return trajectory::linear(facing_pose({x - o.sway_m, 0, o.distance_m}), {speed, 0, 0});
  }
  return o.motion == "stop-and-go" ? trajectory::stop_and_go(sway, o.move_s, o.rest_s) : sway;
}

// The albedo of each marker from a list of one for all or one for each.
void paint(const Options& o, std::vector<SimulatedMarker>& markers) {
  const auto pick = [&](const char* option, const std::vector<double>& values, std::size_t marker) {
    if (values.size() != 1 && values.size() != markers.size())
      throw std::invalid_argument(std::string(option) + ": " + std::to_string(values.size()) + " values for " +
                                  std::to_string(markers.size()) + " markers");
    const double value = values.size() == 1 ? values.front() : values[marker];
    if (value > 0 && value <= 1) return value;
    throw std::invalid_argument(std::string(option) + ": " + std::to_string(value) + " is no share above 0, up to 1");
  };
  for (std::size_t i = 0; i < markers.size(); ++i) {
    markers[i].black = pick("--black", o.black, i);
    markers[i].white = pick("--white", o.white, i);
  }
}

std::vector<SimulatedMarker> make_markers(const Options& o, std::vector<Target>& targets) {
  const std::string name(o.dictionary.empty() ? opencv::kDefaultDictionary : o.dictionary);
  const cv::aruco::Dictionary dictionary = opencv::make_dictionary(name);
  MarkerLengths lengths = o.lengths;
  for (const int id : lengths.ids())
    if (std::ranges::count(o.ids, id) == 0)
      throw std::invalid_argument("--marker-length " + std::to_string(id) + ": the marker is not in --ids");
  lengths.set_default(0.1);
  lengths.load();
  double longest = 0;
  for (const MarkerId id : o.ids) longest = std::max(longest, lengths.of(id));
  std::vector<SimulatedMarker> scene;
  for (std::size_t i = 0; i < o.ids.size(); ++i) {
    if (std::ranges::count(o.ids, o.ids[i]) > 1)
      throw std::invalid_argument("--ids: " + std::to_string(o.ids[i]) + " is there twice");
    const double from_middle = static_cast<double>(i) - 0.5 * (static_cast<double>(o.ids.size()) - 1);
    targets.push_back({o.ids[i], make_motion(o, i, 1.6 * longest * from_middle)});
    scene.push_back({.id = o.ids[i],
                     .length = lengths.of(o.ids[i]),
                     .bits = opencv::marker_bits(dictionary, o.ids[i], name),
                     .T_camera_marker = targets.back().motion});
  }
  return scene;
}

std::vector<SimulatedMarker> make_board(const Options& o, std::vector<Target>& targets) {
  const Board board = opencv::load_board(o.board, o.dictionary);
  // A flat board sways about its middle, with its markers toward the camera, wherever its file has the axes.
  const std::vector<BoardFace> faces = split_into_faces(board);
  const Eigen::Isometry3d T_face_board =
      faces.size() == 1 ? faces[0].T_board_face.inverse() : Eigen::Isometry3d::Identity();
  targets.push_back(
      {board.id, [motion = make_motion(o, 0, 0), T_face_board](double t) { return motion(t) * T_face_board; }});
  return simulated_markers(board, targets.back().motion);
}

// Every millisecond until `end`.
void write_truth(io::PoseCsvWriter& truth, const std::vector<Target>& targets, Timestamp end) {
  for (Timestamp t = 0; t <= end; t += 1000)
    for (const auto& [id, motion] : targets)
      truth.write({.id = id,
                   .t = t,
                   .T_camera_marker = motion(1e-6 * static_cast<double>(t)),
                   .quality = {.state = TrackingState::tracking}});
  truth.close();
}

void simulate(const Options& o) {
  require_in_front(o);
  const std::string calibration = o.calibration_to_write();
  require_distinct({{"--camera", o.camera.path}, {"--board", o.board}, {"--markers", o.lengths.file()}},
                   {{"the recording", o.recording}, {"--calibration", calibration}, {"--truth", o.truth}});
  require_ending({"--calibration", calibration}, kCalibrationEndings);
  interruption::watch();
  const PinholeCamera camera = o.make_camera();
  std::vector<Target> targets;
  std::vector<SimulatedMarker> scene = o.board.empty() ? make_markers(o, targets) : make_board(o, targets);
  paint(o, scene);
  io::RawWriter recording(o.recording, camera.sensor_size());
  std::optional<io::PoseCsvWriter> truth;
  if (!o.truth.empty()) truth.emplace(o.truth);
  Simulator simulator(camera, scene, o.sensor);
  if (!calibration.empty()) opencv::save_calibration(calibration, camera);
  const auto duration = static_cast<Timestamp>(o.sensor.duration_s * 1e6);
  {
    console::ProgressBar progress(o.quiet);
    for (auto batch = simulator.next_batch(); !batch.empty(); batch = simulator.next_batch()) {
      recording.write(batch);
      progress.update(static_cast<std::uint64_t>(simulator.now()), static_cast<std::uint64_t>(duration));
      if (interruption::requested) break;
    }
  }
  const bool interrupted = interruption::requested;
  if (truth) write_truth(*truth, targets, interrupted ? simulator.now() : duration);
  recording.close();
  std::printf("%s: %llu events, up to %.0f px/s, markers of about %.0f px\n", o.recording.c_str(),
              static_cast<unsigned long long>(recording.events_written()), simulator.peak_speed_px_per_s(),
              camera.focal_length() * scene.front().length / o.distance_m);
  if (!interrupted) return;
  std::vector<std::string> kept{std::to_string(recording.events_written()) + " events in " + o.recording};
  if (truth) kept.push_back(std::to_string(truth->poses_written()) + " poses in " + o.truth);
  interruption::end(1e-6 * static_cast<double>(simulator.now()), kept);
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("simulate", "Simulates an event camera in front of markers.", argc, argv, simulate);
}
