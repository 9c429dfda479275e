// Compares a table of poses with the truth: errors, coverage, losses; every pose's error as CSV for plots.
#include <cinttypes>
#include <cstdio>
#include <evmarker/evaluation/accuracy.hpp>
#include <evmarker/io/output_file.hpp>
#include <evmarker/io/pose_reader.hpp>
#include <stdexcept>
#include <string>

#include "console.hpp"
#include "distinct_files.hpp"
#include "truth_comparison.hpp"

using namespace evmarker;

namespace {

struct Options {
  std::string poses, truth, errors;

  void add_to(CLI::App& app) {
    app.add_option("poses", poses, "poses.csv of track_file")->required();
    app.add_option("--truth", truth, "true poses: TUM, or a pose table with marker ids")->required();
    app.add_option("--errors", errors, "every pose's error as CSV");
  }
};

void print(const TruthComparison& comparison) {
  std::puts("marker  tracking poses  mean mm   deg   median mm   deg    95 % mm   deg   covered  lost");
  for (const auto& [id, meter] : comparison.markers()) {
    std::printf("%6d  %14zu", id, meter.tracking());
    if (meter.compared() > 0) {
      const Spread mm = meter.translation_mm(), deg = meter.rotation_deg();
      std::printf("  %7.2f  %5.2f  %9.2f  %5.2f  %8.2f  %5.2f", mm.mean, deg.mean, mm.median, deg.median, mm.p95,
                  deg.p95);
    } else {
      std::printf("  %7s  %5s  %9s  %5s  %8s  %5s", "-", "-", "-", "-", "-", "-");
    }
    if (meter.slots(comparison.last_t()) > 0)
      std::printf("  %6.1f %%", 100 * meter.coverage(comparison.last_t()));
    else
      std::printf("  %6s  ", "-");
    std::printf("  %4zu\n", meter.lost());
  }
}

void evaluate(const Options& options) {
  require_distinct({{"poses", options.poses}, {"--truth", options.truth}}, {{"--errors", options.errors}});
  require_ending({"--errors", options.errors}, {".csv"});
  const auto poses = io::read_pose_csv(options.poses);
  if (poses.empty()) throw std::runtime_error(options.poses + ": no poses in it");
  TruthComparison comparison(options.truth);
  std::string errors = "t_s,marker_id,state,translation_mm,rotation_deg,backtrack_px,backtrack_rad\n";
  for (const PoseEstimate& pose : poses) {
    const auto true_pose = comparison.add(pose);
    if (!true_pose) continue;
    const PoseError error = pose_error(pose.T_camera_marker, *true_pose);
    char line[160];
    std::snprintf(line, sizeof line, "%.6f,%d,%s,%.4f,%.4f,%.4f,%.5f\n", static_cast<double>(pose.t) * 1e-6, pose.id,
                  to_string(pose.quality.state), error.translation_mm, error.rotation_deg, pose.quality.backtrack_px,
                  pose.quality.backtrack_rad);
    errors += line;
  }
  comparison.require_comparable(options.poses);
  if (const std::string doubt = comparison.doubt(); !doubt.empty()) console::say(doubt);
  if (!options.errors.empty()) {
    io::OutputFile file(options.errors);
    file.write(errors);
    file.close();
  }
  print(comparison);
  if (const auto without = comparison.poses() - comparison.compared(); without > 0)
    std::printf("%" PRIu64 " of %zu poses have no true one\n", without, poses.size());
  if (!options.errors.empty()) std::printf("written to %s\n", options.errors.c_str());
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("evaluate", "Compares poses that track_file wrote with the truth.", argc, argv,
                               evaluate);
}
