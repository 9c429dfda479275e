// Every target of the fuzzer in a seeded loop, and over its corpus: without coverage, but in every test run.
#include <doctest/doctest.h>

#include <cstdint>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "fuzz/targets.hpp"
#include "sanitized.hpp"

using namespace evmarker::fuzz;

namespace {

std::string read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// What the target finds with the input; empty for nothing.
std::string finding(const Target& target, const std::string& input) {
  try {
    target.run(input);
    return {};
  } catch (const std::exception& error) {
    return error.what();
  }
}

void run_target(const char* name) {
  for (const Target& target : all_targets()) {
    if (target.name != std::string(name)) continue;
    const auto seeds = target.seeds();
    REQUIRE(!seeds.empty());
    const std::filesystem::path corpus = std::filesystem::path(EVMARKER_CORPUS) / target.name;
    for (std::size_t i = 0; i < seeds.size(); ++i)
      CHECK_MESSAGE(read_file(corpus / ("seed_" + std::to_string(i))) == seeds[i],
                    "the corpus is not that of `fuzz --write-corpus tests/fuzz/corpus`");
    for (const auto& entry : std::filesystem::directory_iterator(corpus)) {
      CAPTURE(entry.path().filename().string());
      CHECK(finding(target, read_file(entry.path())) == "");
    }
    const std::uint64_t runs = kSanitized ? target.test_runs / 10 : target.test_runs;
    const std::uint64_t before = arrived;
    for (std::uint64_t run = 0; run < runs; ++run) {
      CAPTURE(run);
      REQUIRE(finding(target, make_input(target, seeds, 1, run)) == "");
    }
    const double per_run = static_cast<double>(arrived - before) / static_cast<double>(runs);
    MESSAGE(std::string(name) << ": " << per_run << " events, poses and files a run");
    CHECK(per_run > target.least_arrivals);
  }
}

}  // namespace

TEST_CASE("fuzzed: EVT2") { run_target("evt2"); }
TEST_CASE("fuzzed: EVT2.1") { run_target("evt21"); }
TEST_CASE("fuzzed: EVT3") { run_target("evt3"); }
TEST_CASE("fuzzed: chunks of ECF") { run_target("ecf"); }
TEST_CASE("fuzzed: RAW recordings") { run_target("raw"); }
TEST_CASE("fuzzed: DAT recordings") { run_target("dat"); }
TEST_CASE("fuzzed: AEDAT 2 recordings") { run_target("aedat2"); }
TEST_CASE("fuzzed: AEDAT 3.1 recordings") { run_target("aedat3"); }
TEST_CASE("fuzzed: AEDAT 4 recordings") { run_target("aedat4"); }
TEST_CASE("fuzzed: HDF5 recordings") {
#ifdef EVMARKER_HAS_HDF5
  run_target("hdf5");
#else
  MESSAGE("skipped: this build has no libhdf5");
#endif
}
TEST_CASE("fuzzed: MCAP recordings") { run_target("mcap"); }
TEST_CASE("fuzzed: rosbags") { run_target("rosbag"); }
TEST_CASE("fuzzed: rosbags of ROS 2 in SQLite") {
#ifdef EVMARKER_HAS_SQLITE3
  run_target("rosbag2");
#else
  MESSAGE("skipped: this build has no libsqlite3");
#endif
}
TEST_CASE("fuzzed: text recordings") { run_target("event_text"); }
TEST_CASE("fuzzed: pose files") { run_target("pose_text"); }
TEST_CASE("fuzzed: calibrations, boards, wireframes") { run_target("settings"); }
TEST_CASE("fuzzed: trackers of markers") { run_target("tracking"); }
TEST_CASE("fuzzed: trackers of bodies") { run_target("wireframe_tracking"); }
TEST_CASE("fuzzed: pipelines") { run_target("pipeline"); }
