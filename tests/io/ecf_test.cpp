#include "evmarker/io/ecf.hpp"

#include <doctest/doctest.h>

#include "evmarker/simulation/random.hpp"
#include "io/ecf_chunks.hpp"
#include "io/recording_bytes.hpp"
#include "io/test_support.hpp"

using namespace evmarker;
using namespace evmarker::io;
using namespace evmarker::io::test;

namespace {

std::vector<Event> decoded(const std::string& chunk) {
  std::vector<Event> events;
  decode_ecf(std::as_bytes(std::span(chunk)), events);
  return events;
}

}  // namespace

TEST_CASE("decode_ecf: the chunks of Prophesee's encoder, in all three packings") {
  std::vector<Event> events, expected;
  for (std::size_t chunk = 0; chunk < kEcfChunks; ++chunk) {
    const std::string bytes = ecf_chunk(chunk);
    CHECK((bytes[0] & 3) == static_cast<int>(chunk));
    decode_ecf(std::as_bytes(std::span(bytes)), events);
    const auto of_chunk = ecf_events(chunk);
    expected.insert(expected.end(), of_chunk.begin(), of_chunk.end());
    CHECK(events == expected);
  }
}

TEST_CASE("decode_ecf: cut off anywhere, it is refused and adds nothing") {
  for (std::size_t chunk = 0; chunk < kEcfChunks; ++chunk) {
    const std::string whole = ecf_chunk(chunk);
    for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
      const std::string cut = whole.substr(0, bytes);
      std::vector<Event> events(2);
      CHECK_THROWS_WITH_AS(decode_ecf(std::as_bytes(std::span(cut)), events), doctest::Contains("garbled: a field of"),
                           std::runtime_error);
      CHECK(events == std::vector<Event>(2));
    }
  }
}

TEST_CASE("decode_ecf: what no encoder writes is one clear line") {
  const std::string t0(8, '\0');
  CHECK_THROWS_WITH(decoded(little(65536U << 2U, 4) + t0),
                    "garbled: a chunk of 65536 events, of which it can hold 65535");
  CHECK_THROWS_WITH(decoded(little(4U << 2U, 4) + t0 + "\x15"), "garbled: a run of 5 events, where 4 are left");
  CHECK_THROWS_WITH(decoded(little(1U << 2U, 4) + t0 + std::string(17, '\xF1')),
                    "garbled: a step of time of more than 64 bits");
  CHECK(decoded(little(0, 4) + t0).empty());
}

TEST_CASE("decode_ecf: garbled bytes give the stated number of events or an error") {
  Random random(1, 0);
  std::size_t whole = 0, refused = 0;
  for (int run = 0; run < 20000; ++run) {
    std::string chunk = ecf_chunk(random.bits() % kEcfChunks);
    for (int k = 0; k < 2; ++k) chunk[random.bits() % chunk.size()] = static_cast<char>(random.bits());
    std::vector<Event> events;
    try {
      decode_ecf(std::as_bytes(std::span(chunk)), events);
      ++whole;
      CHECK(events.size() == load_word<std::uint32_t>(std::as_bytes(std::span(chunk)).data()) >> 2U);
    } catch (const std::runtime_error& error) {
      ++refused;
      CHECK(events.empty());
      CHECK(std::string(error.what()).starts_with("garbled: "));
    }
  }
  CHECK(whole > 1000);
  CHECK(refused > 1000);
}
