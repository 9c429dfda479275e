// Compares with OpenEB, where it is installed: its decoders, and track_camera with track_file.
#include <doctest/doctest.h>

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "evmarker/io/event_reader.hpp"
#include "examples/openeb_source.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io::test;

namespace {

struct Recorded {
  std::vector<Event> events;
  std::vector<TriggerEvent> triggers;
};

constexpr SensorSize kSensor{640, 480};

/// Events of which many come together, as those of a row that flashes, and triggers between them.
Recorded make_recorded(Timestamp t) {
  Recorded recorded;
  std::mt19937 random(7);
  const auto draw = [&](std::uint32_t count) { return static_cast<std::uint32_t>(random() % count); };
  for (int k = 0; k < 50000; ++k) {
    t += draw(50);
    const std::uint32_t x = draw(kSensor.width / 32) * 32, y = draw(kSensor.height), p = draw(2);
    const std::uint32_t columns = k % 10 == 0 ? static_cast<std::uint32_t>(random()) : 1U << draw(32);
    for (std::uint32_t i = 0; i < 32; ++i)
      if ((columns >> i & 1U) != 0)
        recorded.events.push_back(
            {static_cast<std::uint16_t>(x + i), static_cast<std::uint16_t>(y), static_cast<std::int16_t>(p), t});
    if (k % 100 == 0) recorded.triggers.push_back({static_cast<int>(draw(3)), draw(2) == 1, t});
  }
  return recorded;
}

/// Writes words: `time` is called before what is at a later time, and `vector` with bit i for column x + i, x a
/// multiple of 32.
template <typename Time, typename Trigger, typename Vector>
void write_words(const Recorded& recorded, const Time& time, const Trigger& trigger, const Vector& vector) {
  auto next = recorded.triggers.begin();
  for (std::size_t i = 0; i < recorded.events.size();) {
    const Event first = recorded.events[i];
    for (; next != recorded.triggers.end() && next->t < first.t; ++next) time(next->t), trigger(*next);
    std::uint32_t columns = 0;
    for (; i < recorded.events.size(); ++i) {
      const Event& event = recorded.events[i];
      if (event.t != first.t || event.y != first.y || event.p != first.p || event.x / 32 != first.x / 32) break;
      columns |= 1U << event.x % 32U;
    }
    time(first.t);
    vector(first, std::uint32_t{first.x} / 32 * 32, columns);
  }
  for (; next != recorded.triggers.end(); ++next) time(next->t), trigger(*next);
}

std::string evt2(const Recorded& recorded) {
  std::vector<std::uint32_t> words;
  Timestamp now = recorded.events.front().t, high = now / 64 - 1;
  const auto stamp = [&] { return static_cast<std::uint32_t>(now % 64) << 22U; };
  write_words(
      recorded,
      [&](Timestamp t) {
        for (now = t; high < t / 64;) words.push_back(8U << 28U | static_cast<std::uint32_t>(++high % (1 << 28)));
      },
      [&](const TriggerEvent& e) {
        words.push_back(10U << 28U | stamp() | static_cast<std::uint32_t>(e.id) << 8U | (e.rising ? 1U : 0U));
      },
      [&](const Event& e, std::uint32_t x, std::uint32_t columns) {
        for (std::uint32_t i = 0; i < 32; ++i)
          if ((columns >> i & 1U) != 0)
            words.push_back(static_cast<std::uint32_t>(e.p) << 28U | stamp() | (x + i) << 11U | e.y);
      });
  return to_bytes(words);
}

std::string evt21(const Recorded& recorded, bool legacy) {
  std::vector<std::uint64_t> words;
  Timestamp now = recorded.events.front().t, high = now / 64 - 1;
  const auto stamp = [&] { return static_cast<std::uint64_t>(now % 64) << 54U; };
  write_words(
      recorded,
      [&](Timestamp t) {
        for (now = t; high < t / 64;)
          words.push_back(std::uint64_t{8} << 60U | static_cast<std::uint64_t>(++high % (1 << 28)) << 32U);
      },
      [&](const TriggerEvent& e) {
        words.push_back(std::uint64_t{10} << 60U | stamp() | static_cast<std::uint64_t>(e.id) << 40U |
                        std::uint64_t{e.rising} << 32U);
      },
      [&](const Event& e, std::uint32_t x, std::uint32_t columns) {
        words.push_back(static_cast<std::uint64_t>(e.p) << 60U | stamp() | std::uint64_t{x} << 43U |
                        std::uint64_t{e.y} << 32U | columns);
      });
  if (legacy)
    for (std::uint64_t& word : words) word = word >> 32U | word << 32U;
  return to_bytes(words);
}

std::string evt3(const Recorded& recorded) {
  std::vector<std::uint16_t> words;
  const auto add = [&](unsigned type, std::uint32_t payload) {
    words.push_back(static_cast<std::uint16_t>(type << 12U | payload));
  };
  Timestamp now = -1, high = recorded.events.front().t / 4096 - 1;
  write_words(
      recorded,
      [&](Timestamp t) {
        while (high < t / 4096) add(8, static_cast<std::uint32_t>(++high % 4096));
        if (t != now) add(6, static_cast<std::uint32_t>(t % 4096));
        now = t;
      },
      [&](const TriggerEvent& e) { add(10, static_cast<std::uint32_t>(e.id) << 8U | (e.rising ? 1U : 0U)); },
      [&](const Event& e, std::uint32_t x, std::uint32_t columns) {
        const auto polarity = static_cast<std::uint32_t>(e.p) << 11U;
        add(0, e.y);
        if ((columns & (columns - 1)) == 0) return add(2, polarity | e.x);
        add(3, polarity | x);
        add(4, columns & 0xFFFU);
        add(4, columns >> 12U & 0xFFFU);
        add(5, columns >> 24U);
      });
  return to_bytes(words);
}

std::string header(const std::string& format) {
  return "% format " + format +
         ";height=480;width=640\n% geometry 640x480\n% integrator_name Prophesee\n% plugin_integrator_name Prophesee\n"
         "% plugin_name hal_plugin_prophesee\n% end\n";
}

Recorded by_openeb(const std::filesystem::path& path) {
  Recorded recorded;
  OpenEbSource source(path.string(), false);
  source.start(
      [&](std::span<const OpenEbSource::Event> events) {
        for (const auto& e : events) recorded.events.push_back({e.x, e.y, e.p, e.t});
      },
      [&](const TriggerEvent& trigger) { recorded.triggers.push_back(trigger); });
  while (source.running()) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  source.stop();
  CHECK(source.error().empty());
  return recorded;
}

Recorded by_evmarker(const std::filesystem::path& path) {
  io::EventReader reader(path);
  Recorded recorded;
  recorded.events = drain(reader, &recorded.triggers);
  return recorded;
}

}  // namespace

TEST_CASE("OpenEB decodes the same events and triggers, also where the words for the time wrap around") {
  const TemporaryFolder folder;
  for (const Timestamp first : {Timestamp{1000}, (Timestamp{1} << 24) - 500000, (Timestamp{1} << 34) - 500000}) {
    const Recorded recorded = make_recorded(first);
    const std::pair<const char*, std::string> files[] = {{"EVT2", evt2(recorded)},
                                                         {"EVT21;endianness=little", evt21(recorded, false)},
                                                         {"EVT21;endianness=legacy", evt21(recorded, true)},
                                                         {"EVT3", evt3(recorded)}};
    for (const auto& [format, words] : files) {
      CAPTURE(first);
      CAPTURE(format);
      const auto path = write_file(folder / "a.raw", header(format) + words);
      std::filesystem::remove(folder / "a.raw.tmp_index");  // OpenEB's, of the file before
      const Recorded ours = by_evmarker(path), theirs = by_openeb(path);
      REQUIRE(ours.events.size() == recorded.events.size());
      CHECK(ours.events == theirs.events);
      // An EVT3 file does not tell how often its time had wrapped around before it begins.
      const Timestamp offset = ours.events[0].t - recorded.events[0].t;
      CHECK(offset % (1 << 24) == 0);
      auto triggers = recorded.triggers;
      for (TriggerEvent& trigger : triggers) trigger.t += offset;
      CHECK(ours.triggers == triggers);
      // OpenEB 5.1.1 forgets the wrap for the triggers of EVT2.
      if (!(std::string(format) == "EVT2" && recorded.events.back().t >> 34 > 0))
        CHECK(ours.triggers == theirs.triggers);
    }
  }
}

TEST_CASE("OpenEB decodes the same events of a real recording") {
  const auto path = real_recording("formats/sparklers_evt2.raw");
  if (path.empty()) return;
  const TemporaryFolder folder;  // OpenEB writes beside the file
  std::filesystem::copy(path, folder / "a.raw");
  const Recorded ours = by_evmarker(path), theirs = by_openeb(folder / "a.raw");
  CHECK(ours.events.size() == 521252);
  CHECK(ours.events == theirs.events);
}

TEST_CASE("track_camera --every-event writes the poses of track_file") {
  const TemporaryFolder folder;
  const auto run = [&](const std::string& command) {
    CAPTURE(command);
    REQUIRE(std::system((command + " >/dev/null").c_str()) == 0);
  };
  const std::string recording = (folder / "a.raw").string(),
                    options = recording + " --camera " + (folder / "a.yml").string() + " --marker-length 0.1 --quiet";
  run(EVMARKER_SIMULATE " " + recording + " --duration 1 --quiet");
  run(EVMARKER_TRACK_FILE " " + options + " --output " + (folder / "file.csv").string());
  run(EVMARKER_TRACK_CAMERA " " + options + " --every-event --no-display --output " + (folder / "camera.csv").string());
  const std::string poses = read_file(folder / "file.csv");
  CHECK(poses.size() > 1000000);
  CHECK(read_file(folder / "camera.csv") == poses);
}
