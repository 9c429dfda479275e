// Compares a table of poses with the truth: errors, coverage, losses; every pose's error as CSV for plots.
#include <algorithm>
#include <cstdio>
#include <evmarker/evaluation/accuracy.hpp>
#include <evmarker/io/output_file.hpp>
#include <evmarker/io/pose_reader.hpp>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>

#include "console.hpp"
#include "distinct_files.hpp"

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

void print(const std::map<MarkerId, AccuracyMeter>& meters, Timestamp end) {
  std::puts("marker  tracking poses  mean mm   deg   median mm   deg    95 % mm   deg   covered  lost");
  for (const auto& [id, meter] : meters) {
    const Spread mm = meter.translation_mm(), deg = meter.rotation_deg();
    std::printf("%6d  %14zu  %7.2f  %5.2f  %9.2f  %5.2f  %8.2f  %5.2f  %6.1f %%  %4zu\n", id, meter.tracking(), mm.mean,
                deg.mean, mm.median, deg.median, mm.p95, deg.p95, 100 * meter.coverage(end), meter.lost());
  }
}

void evaluate(const Options& options) {
  require_distinct({{"poses", options.poses}, {"--truth", options.truth}}, {{"--errors", options.errors}});
  require_ending({"--errors", options.errors}, {".csv"});
  const auto poses = io::read_pose_csv(options.poses);
  if (poses.empty()) throw std::runtime_error(options.poses + ": no poses in it");
  const auto truth = io::GroundTruth::read(options.truth);
  std::map<MarkerId, AccuracyMeter> meters;
  std::string errors = "t_s,marker_id,state,translation_mm,rotation_deg,backtrack_px,backtrack_rad\n";
  Timestamp end = 0;
  std::size_t without_truth = 0;
  for (const PoseEstimate& pose : poses) {
    end = std::max(end, pose.t);
    const auto true_pose = truth.at(pose.id, pose.t);
    if (!true_pose) {
      ++without_truth;
      continue;
    }
    meters[pose.id].add(pose, *true_pose);
    const PoseError error = pose_error(pose.T_camera_marker, *true_pose);
    char line[160];
    std::snprintf(line, sizeof line, "%.6f,%d,%s,%.4f,%.4f,%.4f,%.5f\n", static_cast<double>(pose.t) * 1e-6, pose.id,
                  to_string(pose.quality.state), error.translation_mm, error.rotation_deg, pose.quality.backtrack_px,
                  pose.quality.backtrack_rad);
    errors += line;
  }
  if (meters.empty())
    throw std::runtime_error(options.poses + ": none of its " + std::to_string(poses.size()) +
                             " poses has a true one of the same marker and time in " + options.truth);
  if (!options.errors.empty()) {
    io::OutputFile file(options.errors);
    file.write(errors);
    file.close();
  }
  print(meters, end);
  if (without_truth > 0) std::printf("%zu of %zu poses have no true one\n", without_truth, poses.size());
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("evaluate", "Compares poses that track_file wrote with the truth.", argc, argv,
                               evaluate);
}
