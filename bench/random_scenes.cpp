// Tracks a marker in scenes that are drawn at random: in which of them does the tracker say what is wrong?
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cinttypes>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <stdexcept>
#include <string>

#include "../examples/console.hpp"
#include "random_scene.hpp"
#include "tracker_methods.hpp"
#include "verdict.hpp"

using namespace evmarker;

namespace {

struct Options {
  std::uint64_t first = 1;
  std::size_t scenes = 40;
  bool quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("--first", first, "seed of the first scene")->capture_default_str();
    app.add_option("--scenes", scenes, "how many scenes")->check(CLI::PositiveNumber)->capture_default_str();
    app.add_flag("--quiet", quiet, "no progress bar");
  }
};

// How many poses are called `tracking` and are off by more than 20 deg or a tenth of the distance: over the distances
// that are drawn here, no length would do.
std::size_t wrong_poses(const bench::Situation& situation, const bench::Run& run) {
  return static_cast<std::size_t>(std::ranges::count_if(run.markers.front(), [&](const bench::JudgedPose& pose) {
    const double most_mm = 100 * situation.truth(0, pose.t).translation().norm();
    return pose.tracking() && !(pose.error.translation_mm <= most_mm && pose.error.rotation_deg <= 20);
  }));
}

void print(std::uint64_t seed, const bench::Situation& situation, const bench::Verdict& verdict, std::size_t wrong) {
  const SensorSize size = situation.camera.sensor_size();
  const double z = situation.truth(0, 0).translation().z();
  std::printf("%4" PRIu64
              " %4d x %3d %5.0f px %-20s %6.0f mm at %6.2f m %4.0f px | %7.2f / %6.2f %6.2f %5.1f %% %5zu %3zu\n",
              seed, size.width, size.height, situation.camera.focal_length(), situation.dictionary.c_str(),
              1e3 * situation.marker_length(), z, situation.camera.focal_length() * situation.marker_length() / z,
              verdict.translation_mm().mean, verdict.rotation_deg().mean, verdict.nees().mean, 100 * verdict.coverage(),
              wrong, verdict.lost());
  std::fflush(stdout);  // a scene takes seconds
}

// Throws where a pose was wrong while the tracker said `tracking`.
void run(const Options& options) {
  std::puts("seed sensor  lens  dictionary  marker's side, distance, side in the image at first |");
  std::puts(
      "  mean error [mm / deg], NEES, share of the time tracked, wrong poses (20 deg, or a tenth of the distance), "
      "losses");
  console::ProgressBar progress(options.quiet);
  std::size_t wrong_scenes = 0;
  for (std::size_t i = 0; i < options.scenes; ++i) {
    const std::uint64_t seed = options.first + i;
    const bench::Situation situation = bench::random_scene(seed);
    bench::Verdict verdict;
    const bench::Run result = bench::kalman(situation, bench::simulate(situation));
    verdict.add(situation, result);
    const std::size_t wrong = wrong_poses(situation, result);
    print(seed, situation, verdict, wrong);
    wrong_scenes += wrong > 0;
    progress.update(i + 1, options.scenes);
  }
  if (wrong_scenes > 0)
    throw std::runtime_error("wrong poses are called tracking in " + std::to_string(wrong_scenes) + " of " +
                             std::to_string(options.scenes) + " scenes");
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("random_scenes",
                               "Tracks one marker in scenes whose sensor, lens, marker, motion and light are random.",
                               argc, argv, run);
}
