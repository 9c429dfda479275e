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

using namespace evmarker;

namespace {

void evaluate(const std::string& poses_path, const std::string& truth_path, const std::string& errors_path) {
  const auto poses = io::read_pose_csv(poses_path);
  if (poses.empty()) throw std::runtime_error(poses_path + ": no poses in it");
  const auto truth = io::GroundTruth::read(truth_path);
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
    throw std::runtime_error(poses_path + ": none of its " + std::to_string(poses.size()) +
                             " poses has a true one of the same marker and time in " + truth_path);
  if (!errors_path.empty()) {
    io::OutputFile file(errors_path);
    file.write(errors);
    file.close();
  }

  std::puts("marker  tracking poses  mean mm   deg   median mm   deg    95 % mm   deg   covered  lost");
  for (const auto& [id, meter] : meters) {
    const Spread mm = meter.translation_mm(), deg = meter.rotation_deg();
    std::printf("%6d  %14zu  %7.2f  %5.2f  %9.2f  %5.2f  %8.2f  %5.2f  %6.1f %%  %4zu\n", id, meter.tracking(), mm.mean,
                deg.mean, mm.median, deg.median, mm.p95, deg.p95, 100 * meter.coverage(end), meter.lost());
  }
  if (without_truth > 0) std::printf("%zu of %zu poses have no true one\n", without_truth, poses.size());
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Compares poses that track_file wrote with the truth.", "evaluate");
  std::string poses, truth, errors;
  app.add_option("poses", poses, "poses.csv of track_file")->required();
  app.add_option("--truth", truth, "true poses: TUM, or a pose table with marker ids")->required();
  app.add_option("--errors", errors, "every pose's error as CSV");
  return console::run(app, argc, argv, [&] { evaluate(poses, truth, errors); });
}
