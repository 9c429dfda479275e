// Calibrates a camera's focal length, principal point and lens from a recording of a flat board of markers.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <evmarker/base/jackknife.hpp>
#include <evmarker/evmarker.hpp>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/opencv/board.hpp>
#include <evmarker/opencv/calibration.hpp>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "board_corners.hpp"
#include "board_faces.hpp"
#include "calibration_picture.hpp"
#include "camera_fit.hpp"
#include "console.hpp"
#include "distinct_files.hpp"
#include "image_difference.hpp"
#include "interruption.hpp"
#include "reader_options.hpp"
#include "recording_checks.hpp"

using namespace evmarker;

namespace {

constexpr int kUndetermined = 2;  // exit code

struct Options {
  std::string recording, board, dictionary, output, model = "radtan", picture, truth;
  std::vector<int> size;
  ReaderOptions reader;
  double largest_error_px = 1;
  bool free_pitch = false, quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("recording", recording, "of the moving board: Prophesee RAW or DAT, AEDAT, ROS, HDF5 or text")
        ->required();
    app.add_option("--board", board, "the flat board, a YAML file")->required();
    app.add_option("--output", output, "calibration to write, as .yml, .xml or .json")->required();
    app.add_option("--dictionary", dictionary, "OpenCV's name of the ArUco or AprilTag dictionary")
        ->default_str("that of --board, or " + std::string(opencv::kDefaultDictionary));
    app.add_option("--model", model, "of the lens: radtan (k1, k2, p1, p2) or fisheye (k1, k2, k3, k4)")
        ->check(CLI::IsMember({"radtan", "fisheye"}))
        ->capture_default_str();
    app.add_option("--size", size, "of the sensor, as 346,260 [px], where the recording does not tell")
        ->delimiter(',')
        ->expected(2)
        ->check(CLI::Range(1, evmarker::SensorSize::kMaxSide));
    app.add_option("--picture", picture, "picture of where the board was seen, and of what is left of the errors");
    app.add_option("--largest-error", largest_error_px,
                   "refuse a calibration that may be off by more anywhere in the image, at 2 sigma [px]")
        ->check(console::positive_number())
        ->capture_default_str();
    app.add_flag("--free-pitch", free_pitch, "estimate the distances between the markers, too: of a print that shrank");
    app.add_option("--truth", truth, "a calibration to compare with");
    reader.add_to(app);
    app.add_flag("--quiet", quiet, "no progress bar");
    app.footer(console::exit_codes("2 the recording does not determine the camera, "));
  }

  LensModel lens() const { return model == "fisheye" ? LensModel::fisheye : LensModel::radtan; }
};

// Reads the recording as often as it is needed.
class Recording {
 public:
  Recording(const Options& options, const opencv::BoardFile& file) : options_(options), dictionary_(file.dictionary) {
    if (file.boards.size() != 1)
      throw std::invalid_argument("--board " + options.board + ": has " + std::to_string(file.boards.size()) +
                                  " boards, not one");
    const std::vector<BoardFace> faces = split_into_faces(file.boards[0]);
    if (faces.size() != 1)
      throw std::invalid_argument("--board " + options.board + ": is not flat, but has " +
                                  std::to_string(faces.size()) + " faces");
    board_ = faces[0].markers;
    border_cells_ = file.border_cells;
    size_ = open().sensor_size();
  }

  SensorSize size() const { return size_; }
  MarkerId id() const { return board_.id; }

  /// The views of the board, with what is known of the camera.
  /// @param enough views after which the rest of the recording is not read
  std::vector<BoardCorners> views(const PinholeCamera& camera, const char* what,
                                  std::size_t enough = std::numeric_limits<std::size_t>::max()) const {
    if (!options_.quiet) std::fprintf(stderr, "%s\n", what);
    io::EventReader recording = open();
    MarkerFollower follower(camera, board_, dictionary_, border_cells_);
    std::vector<BoardCorners> views;
    console::ProgressBar progress(options_.quiet);
    for (auto batch = recording.next_batch(); !batch.empty() && views.size() < enough; batch = recording.next_batch()) {
      if (interruption::requested) interruption::end(0, {});
      follower.push(batch, views);
      progress.update(recording.bytes_read(), recording.bytes_total());
    }
    recording_checks::require_sane(recording, options_.recording, "the recording", true);
    return views;
  }

 private:
  io::EventReader open() const {
    std::optional<SensorSize> size;
    if (!options_.size.empty()) size = {options_.size[0], options_.size[1]};
    return recording_checks::open(options_.recording, size, options_.reader);
  }

  const Options& options_;
  Board board_;
  std::string dictionary_;
  int border_cells_ = 1;
  SensorSize size_{};
};

[[noreturn]] void refuse(const std::string& reason) { throw console::Exit(kUndetermined, reason); }

/// @param seen instants with four markers or more
/// @param fitting those at which four or more lie as the board's file says
void require_views(std::size_t seen, std::size_t fitting, std::size_t fewest, const Options& options) {
  if (fitting >= fewest) return;
  if (seen < fewest)
    refuse("the board was hardly seen: at " + std::to_string(seen) +
           " instants with four markers or more; move it so that it is large in the image; is it in --dictionary?");
  refuse("markers were seen at " + std::to_string(seen) + " instants, but only at " + std::to_string(fitting) +
         " of them do four or more lie as " + options.board + " says: is the board another one or bent" +
         (options.free_pitch ? "?" : ", or of another size, as --free-pitch estimates?"));
}

// From nothing: the edges of single markers are found with nearly any focal length.
CameraFit find_start(const Recording& recording, const CameraFitter& fitter, const Options& options) {
  constexpr std::size_t kEnough = 200, kFewest = 10, kForStart = 30;
  constexpr double kLens_px = 0.03;  // share of the width by which a lens may bend the board
  constexpr double kGood_px = 1;
  const SensorSize size = recording.size();
  std::optional<CameraFit> best;
  std::size_t most_seen = 0, most_fitting = 0;
  for (const double share : {1.0, 0.6, 1.7}) {
    const double f = share * size.width;
    const PinholeCamera guess(size, f, f, 0.5 * (size.width - 1), 0.5 * (size.height - 1));
    auto views = recording.views(guess, "finding the markers", kEnough);
    most_seen = std::max(most_seen, with_enough_markers(views));
    drop_outliers(views, guess, 1, kLens_px * size.width);
    most_fitting = std::max(most_fitting, views.size());
    if (views.size() < kFewest) continue;
    const CameraFit fit = fitter.start(spread(views, kForStart), f);
    if (!best || fit.rms_px < best->rms_px) best = fit;
    if (best->rms_px < kGood_px) break;
  }
  require_views(most_seen, most_fitting, kFewest, options);
  return *best;
}

// Standard deviations, by the jackknife; and as if half of what the corners' errors do to the camera was still missed.
struct Deviations {
  Intrinsics of{};
  ImageDifference in_image;
};

Deviations deviations_of(const std::vector<BoardCorners>& views, const CameraFit& fit, const CameraFitter& fitter) {
  Deviations sigma;
  const PinholeCamera camera = fitter.camera(fit.intrinsics);
  const auto add = [&](double weight, const Intrinsics& other) {
    const ImageDifference difference = image_difference(camera, fitter.camera(other));
    for (std::size_t i = 0; i < other.size(); ++i) sigma.of[i] += weight * std::pow(other[i] - fit.intrinsics[i], 2);
    for (std::size_t i = 0; i < difference.px.size(); ++i)
      sigma.in_image.px[i] += weight * std::pow(difference.px[i], 2);
  };
  leave_out_tenths(views, [&](const std::vector<BoardCorners>& others) {
    add(kJackknifeWeight, fitter.refit(others, fit.intrinsics).intrinsics);
  });
  constexpr double kMissed = 0.5;
  add(kMissed * kMissed, fitter.refit(views, fit.intrinsics, /*estimate_errors=*/false).intrinsics);
  for (double& s : sigma.of) s = std::sqrt(s);
  for (double& s : sigma.in_image.px) s = std::sqrt(s);
  return sigma;
}

// Wrong distances between the markers would be taken for the lens: says so where the views show that they are others.
void check_pitch(const std::vector<BoardCorners>& views, const CameraFit& fit, const Options& options,
                 SensorSize size) {
  constexpr double kSigmas = 4, kLeast = 0.003;
  const CameraFitter fitter(options.lens(), size, /*free_pitch=*/true);
  const double pitch = fitter.refit(views, fit.intrinsics).intrinsics[kPitch];
  double variance = 0;
  leave_out_tenths(views, [&](const std::vector<BoardCorners>& others) {
    variance += kJackknifeWeight * std::pow(fitter.refit(others, fit.intrinsics).intrinsics[kPitch] - pitch, 2);
  });
  if (std::abs(pitch - 1) > std::max(kLeast, kSigmas * std::sqrt(variance)))
    std::printf("the markers seem to be at %.4f +- %.4f times the distances that %s says: measure, or --free-pitch\n",
                pitch, std::sqrt(variance), options.board.c_str());
}

void print(const CameraFit& fit, const Deviations& sigma, const Options& options) {
  const bool fisheye = options.lens() == LensModel::fisheye;
  const std::array<const char*, 8> names = fisheye ? std::array{"fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"}
                                                   : std::array{"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"};
  for (std::size_t i = 0; i < names.size(); ++i)
    std::printf(i < 4 ? "%s  %9.3f +- %.3f px\n" : "%s  %9.5f +- %.5f\n", names[i], fit.intrinsics[i], sigma.of[i]);
  if (options.free_pitch)
    std::printf("distances between the markers: %.5f +- %.5f of those in %s\n", fit.intrinsics[kPitch],
                sigma.of[kPitch], options.board.c_str());
}

// A user who holds the board otherwise gets another calibration.
void require_determined(const CameraFit& fit, const Deviations& sigma, double largest_error_px) {
  constexpr double kFocalLength = 0.02;  // at 2 sigma
  const auto text = [](const char* format, double value, const std::string& where = "") {
    char line[300];
    std::snprintf(line, sizeof line, format, value, where.c_str());
    return std::string(line);
  };
  if (2 * sigma.of[0] > kFocalLength * fit.intrinsics[0])
    refuse(text("the focal length is known to %.1f %% only: tilt the board more, up to 45 degrees, to all sides",
                200 * sigma.of[0] / fit.intrinsics[0]));
  const std::size_t worst = sigma.in_image.worst();
  if (2 * sigma.in_image.px[worst] > largest_error_px)
    refuse(
        text("the image may be off by %.1f px (2 sigma) in its %s: bring the board there, too, for longer, or allow it "
             "with --largest-error",
             2 * sigma.in_image.px[worst], ImageDifference::name_of(worst)));
}

void calibrate(const Options& options) {
  constexpr std::size_t kMostViews = 1000, kFewest = 30;
  constexpr int kMostPasses = 4;
  constexpr double kOutlier_px = 2;
  require_distinct({{"the recording", options.recording}, {"--board", options.board}, {"--truth", options.truth}},
                   {{"--output", options.output}, {"--picture", options.picture}});
  require_ending({"--output", options.output}, kCalibrationEndings);
  interruption::watch();
  std::optional<PinholeCamera> truth;
  if (!options.truth.empty()) truth = opencv::load_calibration(options.truth);
  const Recording recording(options, opencv::load_boards(options.board, options.dictionary));
  const CameraFitter fitter(options.lens(), recording.size(), options.free_pitch);
  CameraFit fit = find_start(recording, fitter, options);
  std::vector<BoardCorners> views;
  Deviations sigma;
  for (int pass = 0; pass < kMostPasses; ++pass) {
    const PinholeCamera camera = fitter.camera(fit.intrinsics);
    views = recording.views(camera, "following the markers");
    const std::size_t seen = with_enough_markers(views);
    drop_outliers(views, camera, fit.intrinsics[kPitch], kOutlier_px);
    require_views(seen, views.size(), kFewest, options);
    measure_velocities(views);
    views = spread(views, kMostViews);
    fit = fitter.refit(views, fit.intrinsics);
    sigma = deviations_of(views, fit, fitter);
    // The markers are followed nearly alike with both.
    if (image_difference(camera, fitter.camera(fit.intrinsics)).mean() < sigma.in_image.mean() + 0.1) break;
  }
  std::size_t markers = 0;
  for (const BoardCorners& view : views) markers += view.markers.size();
  std::printf("board %d: %zu markers in %zu views\n", recording.id(), markers, views.size());
  print(fit, sigma, options);
  if (!options.free_pitch) check_pitch(views, fit, options, recording.size());
  std::printf("corners within %.3f px (rms); the image is known to %.3f px (1 sigma), at its worst to %.3f px\n",
              std::sqrt(2.0) * fit.rms_px, sigma.in_image.mean(), std::ranges::max(sigma.in_image.px));
  if (truth)
    std::printf("off by %.3f px from %s, on average over the image\n",
                image_difference(*truth, fitter.camera(fit.intrinsics)).mean(), options.truth.c_str());
  if (!options.picture.empty() &&
      !cv::imwrite(options.picture, draw_calibration(views, fit, sigma.in_image, options.lens(), recording.size()),
                   {cv::IMWRITE_PNG_COMPRESSION, 9}))
    throw std::runtime_error(options.picture + ": cannot be written");
  require_determined(fit, sigma, options.largest_error_px);
  opencv::save_calibration(options.output, fitter.camera(fit.intrinsics));
  std::printf("written to %s\n", options.output.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("calibrate", "Calibrates an event camera from a recording of a flat board of markers.",
                               argc, argv, calibrate);
}
