// Converts a recording, or a part of it, to another format: RAW, CSV, HDF5.
#include <algorithm>
#include <cinttypes>
#include <cstdint>
#include <cstdio>
#include <evmarker/io/event_reader.hpp>
#include <evmarker/io/event_writer.hpp>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>

#include "console.hpp"
#include "distinct_files.hpp"
#include "excerpt.hpp"
#include "input_options.hpp"
#include "interruption.hpp"
#include "recording_checks.hpp"
#include "recording_faults.hpp"

using namespace evmarker;

namespace {

const std::map<std::string, io::WrittenFormat> kFormats{{"evt2", io::WrittenFormat::evt2},
                                                        {"evt3", io::WrittenFormat::evt3},
                                                        {"csv", io::WrittenFormat::csv},
                                                        {"hdf5", io::WrittenFormat::hdf5}};
const std::map<std::string, io::Hdf5Compression> kCompressions{
    {"none", io::Hdf5Compression::none}, {"gzip", io::Hdf5Compression::gzip}, {"zstd", io::Hdf5Compression::zstd}};

struct Options {
  std::string recording, output, format_name, compression = "gzip";
  InputOptions input;
  ExcerptOptions excerpt;
  bool quiet = false;

  void add_to(CLI::App& app) {
    app.add_option("recording", recording, "Prophesee RAW or DAT, AEDAT, HDF5, ROS or text (x, y, p and t in columns)")
        ->required();
    app.add_option("output", output, "recording to write: .raw (EVT3), .csv, .txt, .h5 or .hdf5")->required();
    app.add_option("--format", format_name, "evt2, evt3, csv or hdf5; default: by the output's name")
        ->check(CLI::IsMember(kFormats));
    app.add_option("--compression", compression, "of HDF5: none, gzip, or zstd where libhdf5 has its plugin")
        ->check(CLI::IsMember(kCompressions))
        ->capture_default_str();
    excerpt.add_to(app);
    input.add_to(app);
    app.add_flag("--quiet", quiet, "no progress bar");
    app.footer(console::exit_codes());
  }

  /// @throws std::invalid_argument where neither --format nor the output's name says it
  io::WrittenFormat format() const {
    if (!format_name.empty()) return kFormats.at(format_name);
    if (const auto by_name = io::format_by_extension(output)) return *by_name;
    throw std::invalid_argument(output + ": its name ends in none of .raw, .csv, .txt, .h5 and .hdf5: give --format");
  }
};

class Conversion {
 public:
  explicit Conversion(const Options& options)
      : options_(options),
        format_(options.format()),
        recording_(options.input.open(options.recording)),
        excerpt_(options.excerpt, recording_.sensor_size()),
        writer_(create()) {}

  /// @throws std::runtime_error where the recording cannot be read or holds no such events; nothing is written then
  /// @throws console::Exit where the program was interrupted; the file is complete
  void operator()() {
    convert_all();
    const bool interrupted = interruption::requested;
    if (!interrupted) require_events();
    writer_->close();
    print(interrupted);
    if (interrupted) interruption::end(written_s(), {written()});
  }

 private:
  std::unique_ptr<io::RecordingWriter> create() const {
    try {
      return io::create_recording(options_.output, excerpt_.sensor_size(), format_,
                                  kCompressions.at(options_.compression));
    } catch (const std::invalid_argument& error) {
      throw std::invalid_argument(options_.output + ": " + io::to_string(format_) + ": " + error.what());
    }
  }

  void convert_all() {
    console::ProgressBar progress(options_.quiet);
    for (bool more = true; more && !interruption::requested;) {
      const std::span<const Event> batch = recording_.next_batch();
      const std::span<const TriggerEvent> triggers = recording_.triggers();  // of an empty batch: behind the last event
      require_sane(false);
      if (!first_ && !(batch.empty() && triggers.empty())) {
        first_ = first_time(batch, triggers);
        excerpt_.begin_at(*first_);
      }
      if (!batch.empty()) last_ = batch.back().t;
      more = !batch.empty() && !excerpt_.is_over(batch);
      add(excerpt_.pick(batch), triggers);
      progress.update(recording_.bytes_read(), recording_.bytes_total());
    }
  }

  static Timestamp first_time(std::span<const Event> events, std::span<const TriggerEvent> triggers) {
    if (triggers.empty()) return events.front().t;
    return events.empty() ? triggers.front().t : std::min(events.front().t, triggers.front().t);
  }

  // Each trigger behind the events until its time.
  void add(std::span<const Event> events, std::span<const TriggerEvent> triggers) {
    for (const TriggerEvent& recorded : triggers) {
      const auto trigger = excerpt_.pick(recorded);
      if (!trigger) continue;
      const auto later = std::ranges::find_if(events, [&](const Event& event) { return event.t > trigger->t; });
      const auto until = static_cast<std::size_t>(later - events.begin());
      write(events.first(until));
      events = events.subspan(until);
      write(*trigger);
    }
    write(events);
  }

  void write(std::span<const Event> events) {
    while (!events.empty()) {
      const auto writable = events.first(writer_->count_writable(events));
      writer_->write(writable);
      for (const Event& event : writable) {
        begin_ = std::min(begin_, event.t);
        end_ = std::max(end_, event.t);
      }
      events = events.subspan(writable.size());
      if (events.empty()) return;
      if (events_lost_++ == 0) first_lost_ = events.front().t;
      events = events.subspan(1);
    }
  }

  void write(const TriggerEvent& trigger) {
    const bool can_write = writer_->can_write(trigger);
    if (can_write) writer_->write_trigger(trigger);
    ++(can_write ? triggers_written_ : triggers_lost_);
  }

  void require_sane(bool at_end) const {
    recording_checks::require_sane(recording_, options_.recording,
                                   options_.input.size.empty() ? "the recording" : "--size", at_end);
  }

  void require_events() const {
    require_sane(true);
    if (writer_->events_written() > 0) return;
    if (events_lost_ > 0)
      throw std::runtime_error(options_.output + ": " + io::to_string(format_) + " can hold none of the times, t is " +
                               std::to_string(first_lost_) + " us: --shift-time makes them begin at 0");
    char read[32];
    std::snprintf(read, sizeof read, "%.2f s", seconds(*first_, last_));
    throw std::runtime_error(options_.recording + ": --from, --to and --region leave none of the events in its " +
                             read);
  }

  static double seconds(Timestamp from, Timestamp to) {
    return to < from ? 0 : 1e-6 * static_cast<double>(elapsed_us(from, to));
  }
  double written_s() const { return seconds(begin_, end_); }
  std::string written() const {
    return std::to_string(writer_->events_written()) + " events" +
           (triggers_written_ > 0 ? " and " + std::to_string(triggers_written_) + " triggers" : "") + " in " +
           options_.output;
  }

  // On stderr where the output may be the standard output itself.
  void print(bool interrupted) const {
    std::FILE* const to = std::filesystem::is_regular_file(options_.output) ? stdout : stderr;
    io::RecordingStatistics statistics = recording_.statistics();
    if (interrupted) statistics.truncated_bytes = 0;  // it is not the recording that ends there
    recording_faults::print(statistics, to);
    const std::string format = io::to_string(format_);
    recording_faults::print(events_lost_, ("events are lost, whose times " + format + " cannot hold").c_str(), to);
    recording_faults::print(triggers_lost_, ("triggers are lost, which " + format + " cannot hold").c_str(), to);
    if (!interrupted) std::fprintf(to, "%s: %s, %.2f s\n", io::to_string(format_), written().c_str(), written_s());
  }

  const Options& options_;
  io::WrittenFormat format_;
  io::EventReader recording_;
  Excerpt excerpt_;
  std::unique_ptr<io::RecordingWriter> writer_;
  std::optional<Timestamp> first_;  // of the recording
  Timestamp last_ = 0;              // until now
  Timestamp begin_ = std::numeric_limits<Timestamp>::max(), end_ = std::numeric_limits<Timestamp>::min();  // written
  std::uint64_t triggers_written_ = 0, events_lost_ = 0, triggers_lost_ = 0;
  Timestamp first_lost_ = 0;
};

void convert(const Options& options) {
  options.excerpt.validate();
  require_distinct({{"the recording", options.recording}}, {{"the output", options.output}});
  interruption::watch();
  Conversion conversion(options);
  conversion();
}

}  // namespace

int main(int argc, char** argv) {
  return console::run<Options>("convert", "Converts a recording, or a part of it, to another format.", argc, argv,
                               convert);
}
