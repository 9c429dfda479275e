#pragma once
// What the io tests share: temporary folders, bytes of hand-made words, decoding and reading to the end, errors.
#include <doctest/doctest.h>
#include <fcntl.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "evmarker/events/event.hpp"
#include "evmarker/events/trigger_event.hpp"
#include "evmarker/io/evt_words.hpp"
#include "evmarker/io/recording_error.hpp"
#include "evmarker/io/recording_statistics.hpp"

namespace evmarker::io::test {

/// A new folder, removed with everything in it.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "evmarker_io_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw std::runtime_error("no temporary folder " + name);
    path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;

  std::filesystem::path operator/(const char* name) const { return path_ / name; }
  std::size_t files() const {
    return static_cast<std::size_t>(
        std::distance(std::filesystem::directory_iterator(path_), std::filesystem::directory_iterator()));
  }

 private:
  std::filesystem::path path_;
};

inline std::filesystem::path write_file(const std::filesystem::path& path, std::string_view content) {
  std::ofstream(path, std::ios::binary) << content;
  return path;
}

inline std::string read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

/// A recording of ../shared/data; empty, with a word about it, where it is missing.
inline std::filesystem::path real_recording(const char* name) {
  const auto path = std::filesystem::path(EVMARKER_SHARED_DATA) / name;
  if (std::filesystem::exists(path)) return path;
  MESSAGE("skipped: no " << path.string());
  return {};
}

/// A FIFO to which a text is written as fast as it is read; it stays open, and its reader waits, until `end`.
class Fifo {
 public:
  Fifo(const std::filesystem::path& path, std::string text) {
    ::mkfifo(path.c_str(), 0600);
    file_ = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
    writer_ = std::thread([this, text = std::move(text)] {
      for (std::size_t done = 0; done < text.size() && !abandoned_;) {
        const auto count = ::write(file_, text.data() + done, text.size() - done);
        if (count > 0) done += static_cast<std::size_t>(count);
        if (count < 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
      }
    });
  }
  ~Fifo() {
    abandoned_ = true;
    end();
  }
  Fifo(const Fifo&) = delete;
  Fifo& operator=(const Fifo&) = delete;

  /// Waits until all is read, and closes it.
  void end() {
    if (writer_.joinable()) writer_.join();
    for (int unread = 1; unread > 0 && !abandoned_; std::this_thread::sleep_for(std::chrono::milliseconds(1)))
      ::ioctl(file_, FIONREAD, &unread);
    if (file_ >= 0) ::close(std::exchange(file_, -1));
  }

 private:
  int file_ = -1;
  std::atomic<bool> abandoned_ = false;
  std::thread writer_;
};

/// Little-endian bytes of words.
template <typename Word>
std::string to_bytes(const std::vector<Word>& words) {
  std::string bytes;
  for (const Word word : words)
    for (std::size_t i = 0; i < sizeof(Word); ++i) bytes += static_cast<char>((word >> (8 * i)) & 0xFF);
  return bytes;
}

inline std::span<const std::byte> as_span(const std::string& bytes) { return std::as_bytes(std::span(bytes)); }

struct Decoded {
  std::vector<Event> events;
  std::vector<TriggerEvent> triggers;
  RecordingStatistics statistics;
};

/// What `decoder` yields from all of `bytes`.
template <typename Decoder>
Decoded decode_with(Decoder decoder, std::span<const std::byte> bytes) {
  Decoded decoded;
  decode_append(decoder, bytes, decoded.events, decoded.triggers);
  decoded.statistics = decoder.statistics();
  return decoded;
}

template <typename Writer>
void write_and_close(Writer writer, std::span<const Event> events) {
  writer.write(events);
  writer.close();
}

/// All events of a source, in order, and its triggers.
template <typename Source>
std::vector<Event> drain(Source& source, std::vector<TriggerEvent>* triggers = nullptr) {
  std::vector<Event> events;
  while (true) {
    const std::span<const Event> batch = source.next_batch();
    if (triggers != nullptr) triggers->insert(triggers->end(), source.triggers().begin(), source.triggers().end());
    if (batch.empty()) return events;
    events.insert(events.end(), batch.begin(), batch.end());
  }
}

/// Message of the error that `call` throws; empty where it throws none.
template <typename Error = RecordingError, typename Call>
std::string error_of(Call&& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return {};
}

inline bool contains(const std::string& text, std::string_view part) { return text.find(part) != std::string::npos; }

/// True if the error of opening a file of this content contains `part`.
template <typename Reader>
bool refuses(const std::filesystem::path& path, std::string_view content, std::string_view part) {
  return contains(error_of([&] { Reader(write_file(path, content)); }), part);
}

/// Single events and clusters along a row, as edges cause them, with pauses.
/// @param steps_back true for times that sometimes go back
inline std::vector<Event> random_events(SensorSize size, std::size_t count, unsigned seed, bool steps_back = false) {
  std::mt19937 random(seed);
  const auto below = [&](int limit) { return static_cast<int>(random() % static_cast<unsigned>(limit)); };
  std::vector<Event> events;
  Timestamp t = below(100000);
  while (events.size() < count) {
    t += below(20) == 0 ? below(9000) : below(30);
    if (steps_back && below(50) == 0) t -= std::min<Timestamp>(t, below(20000));
    const auto y = static_cast<std::uint16_t>(below(size.height));
    const auto p = static_cast<std::int16_t>(below(2));
    int x = below(size.width);
    for (int length = below(2) == 0 ? 1 : below(40); length > 0 && x < size.width; --length, x += 1 + below(3))
      events.push_back({static_cast<std::uint16_t>(x), y, p, t});
  }
  return events;
}

}  // namespace evmarker::io::test
