#pragma once
// The results of the accuracy comparison as text, Markdown and CSV.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "evmarker/evaluation/accuracy.hpp"
#include "evmarker/events/event.hpp"
#include "scenarios.hpp"
#include "verdict.hpp"

namespace evmarker::bench {

/// One way from a recording to poses. Its title has no comma: gnuplot would cut it there.
struct Method {
  std::string name, title;
  bool needs_events;
  std::function<Run(const Situation&, const std::vector<Event>&)> run;
};

/// The verdicts of every scenario (rows) and method (columns), over all seeds and for each.
struct Results {
  std::vector<Scenario> scenarios;
  std::vector<Method> methods;
  std::vector<std::uint64_t> seeds;
  bool timed = false;
  std::vector<std::vector<Verdict>> all;                // [scenario][method]
  std::vector<std::vector<std::vector<Verdict>>> each;  // [scenario][method][seed]
};

namespace detail {

inline std::string text(const char* format, double value) {
  if (!std::isfinite(value)) return "never";
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, format, value);
  return buffer;
}

inline std::string spread(const Spread& s, const char* format) {
  return text(format, s.mean) + " / " + text(format, s.median) + " / " + text(format, s.p95);
}

inline const std::vector<std::string> kHeader{"scenario",
                                              "method",
                                              "t [mm] mean / median / 95 %",
                                              "r [deg] mean / median / 95 %",
                                              "cover",
                                              "first [ms]",
                                              "poses/s",
                                              "wild",
                                              "wild [ms]",
                                              "lost",
                                              "lost late [ms]",
                                              "back [ms]",
                                              "strangers",
                                              "NEES/dof",
                                              "ns/event",
                                              "detection"};

inline std::vector<std::string> row(const Results& results, std::size_t s, std::size_t m) {
  const Verdict& v = results.all[s][m];
  const Method& method = results.methods[m];
  const bool tracker = v.events() > 0;
  const std::string found = v.found() == v.markers()
                                ? text("%.0f", v.first_ms()) + ", " + text("%.0f", v.latest_first_ms())
                                : std::to_string(v.found()) + " of " + std::to_string(v.markers()) + " found";
  return {results.scenarios[s].name,
          method.title,
          v.tracking() > 0 ? spread(v.translation_mm(), "%.2f") : "-",
          v.tracking() > 0 ? spread(v.rotation_deg(), "%.2f") : "-",
          text("%.1f %%", 100 * v.coverage()),
          found,
          text("%.0f", v.poses_per_s()),
          std::to_string(v.wild()),
          text("%.0f", v.longest_wild_ms()),
          tracker ? std::to_string(v.lost()) : "-",
          v.absences() > 0 ? text("%.0f", v.lost_late_ms()) : "-",
          v.absences() > 0 ? text("%.0f", v.back_late_ms()) : "-",
          std::to_string(v.strangers()),
          v.has_nees() ? text("%.2f", v.nees().mean) : "-",
          tracker && results.timed ? text("%.0f", v.ns_per_event()) : "-",
          tracker && results.timed ? text("%.0f %%", 100 * v.detection_share()) : "-"};
}

inline std::string goal(const Scenario& scenario) {
  return text("%g mm, ", scenario.translation_goal_mm) + text("%g deg, ", scenario.rotation_goal_deg) +
         text("%g %%", 100 * scenario.coverage_goal);
}

inline constexpr const char* kNotes =
    "Errors over all poses called `tracking`, all seeds together. cover: share of the 10 ms slots from the first pose "
    "on, all of the marker in sight, that hold such a pose. first: mean and latest time of the first pose. wild: poses "
    "off by more than 50 mm or 20 deg, and the longest stretch of them. lost late: longest that a marker out of sight "
    "was still tracked; back: longest from all in sight again to the next pose. strangers: poses of ids that are not "
    "in "
    "the scene. NEES/dof: mean squared error in units of the pose's own covariance, 1 where it is right. ns/event: "
    "processor time without detection; detection: its share of real time (one thread: --jobs 1). "
    "Grey images are linear, 8 bit, with exposure blur and 1.5 (60 Hz) or 4 (1 kHz) levels of noise, as if there were "
    "always light "
    "enough, in `dim` too; a pose counts for "
    "the middle of its exposure, and processing time is not counted against it. AprilTag 3 does not read DICT_4X4_50: "
    "its images show tags of family 36h11, same size and motion. Of the 1 kHz images only every so-many-th is made, "
    "spread evenly over the recording: errors are those of the 1 kHz camera, coverage and first pose are a lower and "
    "an upper bound.";

}  // namespace detail

/// One table, then what the scenarios and columns mean.
inline std::string markdown(const Results& results) {
  std::string out = "|";
  for (const std::string& column : detail::kHeader) out += " " + column + " |";
  out += "\n|" + std::string("---|---|");
  for (std::size_t i = 2; i < detail::kHeader.size(); ++i) out += "---:|";
  out += "\n";
  for (std::size_t s = 0; s < results.scenarios.size(); ++s)
    for (std::size_t m = 0; m < results.methods.size(); ++m) {
      out += "|";
      for (const std::string& cell : detail::row(results, s, m)) out += " " + cell + " |";
      out += "\n";
    }
  out += "\n";
  for (const Scenario& scenario : results.scenarios)
    out += "- " + scenario.name + ": " + scenario.title + "; goal " + detail::goal(scenario) + "\n";
  return out + "\n" + detail::kNotes + "\n";
}

/// A block of aligned columns per scenario.
inline std::string plain(const Results& results) {
  std::string out;
  for (std::size_t s = 0; s < results.scenarios.size(); ++s) {
    const Scenario& scenario = results.scenarios[s];
    out += scenario.name + ": " + scenario.title + "; goal " + detail::goal(scenario) + "\n";
    std::vector<std::vector<std::string>> rows{detail::kHeader};
    for (std::size_t m = 0; m < results.methods.size(); ++m) rows.push_back(detail::row(results, s, m));
    for (const auto& cells : rows) {
      for (std::size_t column = 1; column < cells.size(); ++column) {
        std::size_t width = 0;
        for (const auto& other : rows) width = std::max(width, other[column].size());
        const std::string space(width - cells[column].size(), ' ');
        out += "  " + (column == 1 ? cells[column] + space : space + cells[column]);
      }
      out += "\n";
    }
    out += "\n";
  }
  return out + detail::kNotes + "\n";
}

namespace detail {

inline std::ofstream open(const std::filesystem::path& path) {
  std::ofstream file(path);
  if (!file) throw std::runtime_error("cannot write " + path.string());
  return file;
}

inline void write_csv_row(std::ofstream& file, const std::string& scenario, const std::string& method,
                          const std::string& seed, const Verdict& v, bool timed) {
  const Spread t = v.translation_mm(), r = v.rotation_deg(), n = v.nees();
  const bool timing = timed && v.events() > 0;
  file << scenario << ',' << method << ',' << seed << ',' << v.tracking() << ',' << t.mean << ',' << t.median << ','
       << t.p95 << ',' << t.max << ',' << r.mean << ',' << r.median << ',' << r.p95 << ',' << r.max << ','
       << v.coverage() << ',' << v.markers() << ',' << v.found() << ',' << v.first_ms() << ',' << v.latest_first_ms()
       << ',' << v.poses_per_s() << ',' << v.wild() << ',' << v.longest_wild_ms() << ',' << v.lost() << ','
       << v.absences() << ',' << v.lost_late_ms() << ',' << v.back_late_ms() << ',' << v.strangers() << ',';
  if (v.has_nees())
    file << n.mean << ',' << n.median;
  else
    file << ',';
  file << ',';
  if (timing)
    file << v.ns_per_event() << ',' << v.detection_share();
  else
    file << ',';
  file << '\n';
}

}  // namespace detail

/// accuracy.csv, accuracy.md, accuracy_bars.csv (for the plot) and incidents.csv (when a tracker found, lost, went
/// wild).
inline void write_files(const Results& results, const std::filesystem::path& directory) {
  std::filesystem::create_directories(directory);
  std::ofstream csv = detail::open(directory / "accuracy.csv"), incidents = detail::open(directory / "incidents.csv");
  csv << "scenario,method,seed,poses,t_mean_mm,t_median_mm,t_p95_mm,t_max_mm,r_mean_deg,r_median_deg,r_p95_deg,r_max_"
         "deg,coverage,markers,found,first_mean_ms,first_latest_ms,poses_per_s,wild,longest_wild_ms,lost,absences,lost_"
         "late_ms,back_late_ms,strangers,nees_mean,nees_median,ns_per_event,looks_share\n";
  incidents << "scenario,method,seed,marker,t_us,what,value\n";
  std::ofstream bars = detail::open(directory / "accuracy_bars.csv");  // a row per scenario, two columns per method
  bars << "scenario";
  for (const Method& method : results.methods) bars << ",\"" << method.title << "\",";
  bars << '\n';
  for (std::size_t s = 0; s < results.scenarios.size(); ++s) {
    const std::string& scenario = results.scenarios[s].name;
    bars << scenario;
    for (std::size_t m = 0; m < results.methods.size(); ++m) {
      const std::string& method = results.methods[m].name;
      detail::write_csv_row(csv, scenario, method, "all", results.all[s][m], results.timed);
      for (std::size_t k = 0; k < results.seeds.size(); ++k) {
        const std::string seed = std::to_string(results.seeds[k]);
        detail::write_csv_row(csv, scenario, method, seed, results.each[s][m][k], results.timed);
        for (const bench::Incident& incident : results.each[s][m][k].incidents())
          incidents << scenario << ',' << method << ',' << seed << ',' << incident.marker << ',' << incident.t << ','
                    << incident.what << ',' << incident.value << '\n';
      }
      const Verdict& v = results.all[s][m];
      if (v.tracking() > 0)
        bars << ',' << v.translation_mm().mean << ',' << v.rotation_deg().mean;
      else
        bars << ",nan,nan";
    }
    bars << '\n';
  }
  detail::open(directory / "accuracy.md") << markdown(results);
}

}  // namespace evmarker::bench
