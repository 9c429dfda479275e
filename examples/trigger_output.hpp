#pragma once
// The camera's external trigger events as CSV.
#include <cstdint>
#include <evmarker/events/trigger_event.hpp>
#include <evmarker/io/output_file.hpp>
#include <optional>
#include <string>
#include <vector>

class TriggerOutput {
 public:
  /// @param path empty: trigger events are not written
  /// @throws evmarker::io::RecordingError where the file cannot be created
  explicit TriggerOutput(const std::string& path) : path_(path) {
    if (path.empty()) return;
    file_.emplace(path);
    file_->buffer() = "t_us,id,rising\n";
  }

  void write(const evmarker::TriggerEvent& trigger) {
    if (!file_) return;
    file_->buffer() +=
        std::to_string(trigger.t) + ',' + std::to_string(trigger.id) + ',' + (trigger.rising ? "1\n" : "0\n");
    file_->flush_if_large();
    ++written_;
  }

  /// Completes the file.
  void close() {
    if (file_) file_->close();
  }

  /// What is in the file, such as "12 triggers in triggers.csv".
  std::vector<std::string> kept() const {
    if (!file_) return {};
    return {std::to_string(written_) + " triggers in " + path_};
  }

 private:
  std::string path_;
  std::optional<evmarker::io::BufferedOutput<std::string>> file_;
  std::uint64_t written_ = 0;
};
