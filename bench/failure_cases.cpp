// Writes the paper's backtracking figure: for each failure case the result of verification and the true error of the
// pose.
#include "failure_cases.hpp"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <stdexcept>

using namespace evmarker;

namespace {

std::ofstream open(const std::filesystem::path& path) {
  std::ofstream file(path);
  if (!file) throw std::runtime_error("cannot write " + path.string());
  return file;
}

void write(const std::filesystem::path& path, const std::vector<bench::FailureSample>& samples) {
  std::ofstream file = open(path);
  file << "t_s,state,backtrack_px,backtrack_rad,translation_mm,rotation_deg,speed_px_per_s\n";
  for (const bench::FailureSample& s : samples)
    file << static_cast<double>(s.t) * 1e-6 << ',' << to_string(s.state) << ',' << s.backtrack_px << ','
         << s.backtrack_rad << ',' << s.error.translation_mm << ',' << s.error.rotation_deg << ',' << s.speed_px_per_s
         << '\n';
}

double seconds(const std::optional<Timestamp>& t, double otherwise) {
  return t ? static_cast<double>(*t) * 1e-6 : otherwise;
}

void print_summary(const bench::FailureCase& failure, const bench::FailureSignal& signal) {
  double px = 0, rad = 0;
  Spread error_mm;
  std::vector<double> errors;
  for (const auto& v : signal.verifications)
    if (v.state == TrackingState::tracking) {
      px = std::max(px, v.backtrack_px);
      rad = std::max(rad, v.backtrack_rad);
    }
  for (const auto& pose : signal.poses)
    if (pose.state == TrackingState::tracking) errors.push_back(pose.error.translation_mm);
  error_mm = Spread::of(errors);
  std::printf("(%s) %-26s tracking from %.3f s, ", failure.name.c_str(), failure.title.c_str(),
              seconds(signal.judged, failure.duration_s));
  if (signal.lost)
    std::printf("lost at %.3f s by %s; ", seconds(signal.lost, 0),
                signal.lost_by_backtracking ? "backtracking" : "too few matches");
  else
    std::printf("never lost; ");
  std::printf("while tracking: backtracking up to %.2f px, %.3f rad, pose off by %.1f mm in the mean, %.1f at most\n",
              px, rad, error_mm.mean, error_mm.max);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Simulates the failure cases of the paper's backtracking figure and writes their signals as CSV");
  std::filesystem::path directory;
  std::uint64_t seed = 1;
  app.add_option("output_directory", directory, "for <case>_poses.csv, <case>_verifications.csv and cases.csv")
      ->required();
  app.add_option("--seed", seed, "of the simulated sensor");
  CLI11_PARSE(app, argc, argv);
  try {
    std::filesystem::create_directories(directory);
    std::ofstream cases = open(directory / "cases.csv");
    cases << "case,title,converged_s,lost_s,end_s\n";
    for (const bench::FailureCase& failure : bench::failure_cases()) {
      const auto signal = bench::run(failure, bench::failure_events(failure, seed));
      write(directory / (failure.name + "_poses.csv"), signal.poses);
      write(directory / (failure.name + "_verifications.csv"), signal.verifications);
      cases << failure.name << ",\"" << failure.title << "\"," << seconds(signal.judged, failure.duration_s) << ','
            << seconds(signal.lost, failure.duration_s) << ',' << failure.duration_s << '\n';
      print_summary(failure, signal);
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "failure_cases: %s\n", error.what());
    return 1;
  }
  return 0;
}
