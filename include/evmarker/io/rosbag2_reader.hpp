#pragma once
// Recordings of rosbag2 in SQLite as a source of events, where the build has libsqlite3: with the component `sqlite3`.
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <system_error>

#include "evmarker/io/collecting_reader.hpp"
#include "evmarker/io/event_messages.hpp"
#include "evmarker/io/event_topics.hpp"
#include "evmarker/io/field_cursor.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_reader.hpp"
#include "evmarker/io/sqlite_database.hpp"

namespace evmarker::io {

struct Rosbag2ReaderOptions : RecordingOptions {
  /// Once it is true, the recording ends.
  const std::atomic<bool>* stop = nullptr;
};

#ifdef EVMARKER_HAS_SQLITE3

/// Reads the events of one topic of a file of rosbag2 (`.db3`), in the order in which they were recorded.
class Rosbag2Reader final : public CollectingReader {
 public:
  /// @throws RecordingError where the file cannot be read, is no recording, or the topic is not there or not the only
  /// one
  explicit Rosbag2Reader(const std::filesystem::path& path, const Rosbag2ReaderOptions& options = {})
      : CollectingReader(path, options),
        path_(path),
        stop_(options.stop),
        topics_(path, options.topic),
        messages_(path, options) {
    std::error_code error;
    const auto status = std::filesystem::status(path, error);
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status))
      throw RecordingError(path, "SQLite recordings are read from files alone, not from pipes");
    bytes_total_ = std::filesystem::file_size(path, error);
    read_part(path_, "SQLite", std::nullopt, [&] {
      database_ = std::make_unique<SqliteDatabase>(path);
      const std::string ids = find_topic();
      auto last = database_->query("SELECT max(rowid) FROM messages");
      last_row_ = last.next() ? last.number(0) : 0;
      rows_ =
          database_->query("SELECT rowid, topic_id, data FROM messages WHERE topic_id IN (" + ids + ") ORDER BY rowid");
    });
    while (!messages_.any() && read_message())
      ;
    collector_.set_sensor_size(messages_.sensor_size());
  }

  /// The share of the file that holds as many of its messages.
  std::uint64_t bytes_read() const override {
    if (row_ >= last_row_) return bytes_total_;
    const double share = static_cast<double>(std::max<std::int64_t>(row_, 0)) / static_cast<double>(last_row_);
    return static_cast<std::uint64_t>(static_cast<double>(bytes_total_) * share);
  }
  std::uint64_t bytes_total() const override { return bytes_total_; }

 private:
  // The ids of the topic that is read.
  std::string find_topic() {
    std::string ids;
    auto rows = database_->query("SELECT id, name, type, serialization_format FROM topics");
    while (rows.next()) {
      const auto id = static_cast<std::uint32_t>(rows.number(0));
      for (const int column : {1, 2}) require_one_line(rows.text(column));
      topics_.add(id, rows.text(1), rows.text(3) == "cdr" ? rows.text(2) : "", true);
      if (topics_.find(id)) ids += (ids.empty() ? "" : ",") + std::to_string(id);
    }
    topics_.require_one();
    topics_.require_chosen();
    return ids;
  }

  bool read_piece() override {
    if (stop_ != nullptr && *stop_) return false;
    if (messages_.done()) return read_message();
    messages_.decode_piece(collector_);
    return true;
  }

  // False behind the last message.
  bool read_message() {
    const bool any = read_part(path_, "SQLite", std::nullopt, [&] {
      if (!rows_.next()) return false;
      if (rows_.number(0) <= row_) throw std::runtime_error("garbled: its messages are not in order");
      return true;
    });
    row_ = any ? rows_.number(0) : last_row_;
    if (any) messages_.begin(rows_.bytes(2), *topics_.find(static_cast<std::uint32_t>(rows_.number(1))));
    return any;
  }

  std::filesystem::path path_;
  const std::atomic<bool>* stop_;
  std::unique_ptr<SqliteDatabase> database_;
  SqliteDatabase::Rows rows_;
  EventTopics topics_;
  EventMessages messages_;
  std::int64_t row_ = std::numeric_limits<std::int64_t>::min(), last_row_ = 0;
  std::uint64_t bytes_total_ = 0;
};

#endif

/// @throws RecordingError as Rosbag2Reader, or where this build leaves it out
inline std::unique_ptr<RecordingReader> open_rosbag2(const std::filesystem::path& path,
                                                     [[maybe_unused]] const Rosbag2ReaderOptions& options) {
#ifdef EVMARKER_HAS_SQLITE3
  return std::make_unique<Rosbag2Reader>(path, options);
#else
  throw RecordingError(path,
                       "SQLite recordings of rosbag2 need libsqlite3, which this build leaves out: install "
                       "libsqlite3-dev and build with evmarker's component sqlite3");
#endif
}

}  // namespace evmarker::io
