#pragma once
// SQLite files that are only read. Empty without the component `sqlite3`.
#ifdef EVMARKER_HAS_SQLITE3
#include <sqlite3.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>

#include "evmarker/io/decompression.hpp"

namespace evmarker::io {

/// A file as libsqlite3 reads it: nothing in it, nor beside it, is changed, and no view or trigger in it is run. Every
/// function throws std::runtime_error with what libsqlite3 says.
class SqliteDatabase {
 public:
  explicit SqliteDatabase(const std::filesystem::path& path) {
    for (const char* const journal : {"-wal", "-journal"}) {
      std::error_code none;
      const auto bytes = std::filesystem::file_size(path.string() + journal, none);
      if (!none && bytes > 0)
        throw std::runtime_error("was not closed, a part of it is in " + path.string() + journal +
                                 ": close it: sqlite3 " + path.string() + " 'PRAGMA journal_mode=DELETE'");
    }
    sqlite3* database = nullptr;
    const int result =
        sqlite3_open_v2(as_uri(path).c_str(), &database, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, nullptr);
    database_.reset(database);
    require(result == SQLITE_OK);
    sqlite3_limit(database, SQLITE_LIMIT_LENGTH, static_cast<int>(Decompressor::kMaxBytes));
    sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
    sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
    sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
    sqlite3_db_config(database, SQLITE_DBCONFIG_WRITABLE_SCHEMA, 1, nullptr);  // else it reads nothing of a cut file
    query("PRAGMA cache_size=-2000").next();                                   // [KiB], and not what the file says
  }

  /// The rows of a query, one after the other, while the database lives.
  class Rows {
   public:
    /// The next row; false behind the last one.
    bool next() {
      if (!statement_) return false;
      const int result = sqlite3_step(statement_.get());
      if (result == SQLITE_ROW) return true;
      if (result != SQLITE_DONE) throw std::runtime_error(sqlite3_errmsg(sqlite3_db_handle(statement_.get())));
      statement_.reset();  // another step would begin anew
      return false;
    }
    std::int64_t number(int column) const { return sqlite3_column_int64(statement_.get(), column); }
    /// Valid until the next row.
    std::span<const std::byte> bytes(int column) const {
      const auto* const begin = static_cast<const std::byte*>(sqlite3_column_blob(statement_.get(), column));
      return {begin, begin == nullptr ? 0 : static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column))};
    }
    std::string_view text(int column) const {
      const auto characters = bytes(column);
      return {reinterpret_cast<const char*>(characters.data()), characters.size()};
    }

   private:
    friend class SqliteDatabase;
    struct Finalize {
      void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
    };
    std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  };

  Rows query(const std::string& sql) const {
    Rows rows;
    sqlite3_stmt* statement = nullptr;
    const int result = sqlite3_prepare_v2(database_.get(), sql.c_str(), -1, &statement, nullptr);
    rows.statement_.reset(statement);
    require(result == SQLITE_OK);
    return rows;
  }

 private:
  struct Close {
    void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
  };

  // As a file that nothing changes: libsqlite3 then writes no locks beside it.
  static std::string as_uri(const std::filesystem::path& path) {
    std::string uri = "file:";
    for (const char c : path.string()) {
      if (c == '%')
        uri += "%25";
      else if (c == '?')
        uri += "%3f";
      else if (c == '#')
        uri += "%23";
      else
        uri += c;
    }
    return uri + "?immutable=1";
  }

  void require(bool holds) const {
    if (!holds) throw std::runtime_error(sqlite3_errmsg(database_.get()));
  }

  std::unique_ptr<sqlite3, Close> database_;
};

}  // namespace evmarker::io
#endif
