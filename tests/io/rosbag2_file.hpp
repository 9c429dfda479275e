#pragma once
// Recordings of rosbag2 in SQLite, written by libsqlite3. Empty without the component `sqlite3`.
#ifdef EVMARKER_HAS_SQLITE3
#include <sqlite3.h>

#include <filesystem>
#include <span>
#include <stdexcept>
#include <string>

#include "evmarker/events/event.hpp"
#include "io/ros_bytes.hpp"

namespace evmarker::io::test {

/// A new file with the tables of rosbag2.
class Rosbag2File {
 public:
  explicit Rosbag2File(const std::filesystem::path& path) {
    std::filesystem::remove(path);
    if (sqlite3_open(path.c_str(), &database_) != SQLITE_OK) throw std::runtime_error("no file " + path.string());
    execute("PRAGMA page_size=1024; PRAGMA journal_mode=OFF; PRAGMA synchronous=OFF");
    execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)");
    execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)");
    execute("BEGIN");
  }
  ~Rosbag2File() {
    execute("COMMIT");
    sqlite3_close(database_);
  }
  Rosbag2File(const Rosbag2File&) = delete;
  Rosbag2File& operator=(const Rosbag2File&) = delete;

  void execute(const std::string& sql) {
    if (sqlite3_exec(database_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
      throw std::runtime_error(sqlite3_errmsg(database_));
  }
  void add_topic(int id, const std::string& name, const std::string& type, const std::string& format = "cdr") {
    execute("INSERT INTO topics VALUES(" + std::to_string(id) + ",'" + name + "','" + type + "','" + format + "')");
  }
  void add_message(int topic, const std::string& data) {
    sqlite3_stmt* statement = nullptr;
    sqlite3_prepare_v2(database_, "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, 5, ?)", -1, &statement,
                       nullptr);
    sqlite3_bind_int(statement, 1, topic);
    sqlite3_bind_blob(statement, 2, data.data(), static_cast<int>(data.size()), SQLITE_STATIC);
    const int result = sqlite3_step(statement);
    sqlite3_finalize(statement);
    if (result != SQLITE_DONE) throw std::runtime_error(sqlite3_errmsg(database_));
  }

 private:
  sqlite3* database_ = nullptr;
};

/// A recording of rosbag2: messages of events, with another topic's around each.
inline void write_rosbag2(const std::filesystem::path& path, std::span<const Event> events, SensorSize size,
                          RosEvents kind) {
  Rosbag2File file(path);
  file.add_topic(1, "/imu", "sensor_msgs/msg/Imu");
  file.add_topic(2, "/events", type_of(kind));
  for (const std::string& message : event_messages(events, size, kind, true)) {
    file.add_message(1, "no events");
    file.add_message(2, message);
    file.add_message(1, "none");
  }
}

}  // namespace evmarker::io::test
#endif
