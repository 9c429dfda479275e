#pragma once
// Fuzzed: the decoders of Prophesee's encodings, and whole RAW recordings.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "evmarker/io/ecf.hpp"
#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "evmarker/io/raw_reader.hpp"
#include "fuzz/input.hpp"
#include "fuzz/mutation.hpp"
#include "fuzz/plain_decoder.hpp"
#include "fuzz/target.hpp"
#include "io/ecf_chunks.hpp"

namespace evmarker::fuzz {

namespace detail {

struct Decoded {
  std::vector<Event> events;
  std::vector<TriggerEvent> triggers;
  io::RecordingStatistics statistics;
  bool operator==(const Decoded&) const = default;
};

inline std::span<const std::byte> as_bytes(std::string_view text) { return std::as_bytes(std::span(text)); }

/// In pieces of `piece` words, each decoded with all that follows it known.
template <typename Decoder>
Decoded decode(Decoder decoder, std::span<const std::byte> bytes, std::size_t piece) {
  Decoded decoded;
  const std::size_t words = bytes.size() / Decoder::kWordBytes;
  std::vector<Event> buffer(std::min(piece, words) * Decoder::kMaxEventsPerWord);
  bytes = bytes.first(words * Decoder::kWordBytes);
  while (!bytes.empty()) {
    const auto part = bytes.first(std::min(piece * Decoder::kWordBytes, bytes.size()));
    bytes = bytes.subspan(part.size());
    const std::size_t count = decoder.decode(part, std::span(buffer), decoded.triggers, bytes);
    decoded.events.insert(decoded.events.end(), buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(count));
  }
  decoded.statistics = decoder.statistics();
  return decoded;
}

inline void check_counts(const Decoded& decoded, SensorSize size) {
  const auto& [events, triggers, statistics] = decoded;
  arrived += events.size();
  require_that(statistics.events == events.size(), "every event is counted");
  require_that(statistics.triggers == triggers.size(), "every trigger event is counted");
  std::uint64_t steps_back = 0;
  for (std::size_t i = 0; i < events.size(); ++i) {
    require_that(size.contains(events[i].x, events[i].y), "every event is on the sensor");
    require_that(events[i].p == 0 || events[i].p == 1, "polarities are 0 and 1");
    if (i > 0) steps_back += events[i].t < events[i - 1].t;
  }
  // The first event may come before time 0, which no event before it has.
  require_that(statistics.time_steps_back - steps_back <= 1, "every step back in time is counted");
}

inline void check_against_plain(const Decoded& decoded, PlainDecoder& plain) {
  const auto equal = [&](const auto& a, const auto& b, const auto& same) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), same);
  };
  const bool times = decoded.statistics.garbled_times == 0;
  require_that(equal(decoded.events, plain.events,
                     [&](const Event& a, const Event& b) {
                       return a.x == b.x && a.y == b.y && a.p == b.p && (!times || a.t == b.t);
                     }),
               "the events are those of a plain decoder");
  require_that(equal(decoded.triggers, plain.triggers,
                     [&](const TriggerEvent& a, const TriggerEvent& b) {
                       return a.id == b.id && a.rising == b.rising && (!times || a.t == b.t);
                     }),
               "the trigger events are those of a plain decoder");
  require_that(decoded.statistics.off_sensor + decoded.statistics.dropped_before_time == plain.not_delivered,
               "whatever is not delivered is counted");
}

/// What was decoded, encoded and decoded again.
template <typename Encoder, typename Decoder>
void check_encoder(const Decoded& decoded, Encoder encoder, const Decoder& decoder) {
  std::vector<std::byte> bytes;
  std::size_t encoded = 0;
  try {
    for (; encoded < decoded.events.size(); ++encoded)
      encoder.encode(std::span(decoded.events).subspan(encoded, 1), bytes);
  } catch (const std::invalid_argument&) {  // a time that the encoding cannot express
  }
  const auto again = decode(decoder, bytes, bytes.size() + 1);
  require_that(std::ranges::equal(std::span(decoded.events).first(encoded), again.events),
               "encoded events decode to the same");
}

struct DecoderInput {
  SensorSize size;
  std::size_t piece;
  std::string_view words;
};

inline constexpr std::size_t kDecoderHeader = 5;

inline DecoderInput decoder_input(std::string_view input) {
  Numbers numbers(input);
  const auto side = [&] { return 1 + static_cast<int>(numbers.bits(2) % 2048); };
  const SensorSize size{side(), side()};
  const std::size_t piece = 1 + numbers.byte();
  return {size, piece, numbers.rest()};
}

template <typename Decoder>
void fuzz_decoder(io::RawFormat format, std::string_view input) {
  const auto [size, piece, words] = decoder_input(input);
  const Decoder decoder(size);
  const Decoded whole = decode(decoder, as_bytes(words), words.size() + 1);
  check_counts(whole, size);
  require_that(decode(decoder, as_bytes(words), piece) == whole, "pieces decode to the same as the whole");
  PlainDecoder plain(format, size);
  plain.decode(words);
  check_against_plain(whole, plain);
  if constexpr (std::is_same_v<Decoder, io::Evt2Decoder>) check_encoder(whole, io::Evt2Encoder(), decoder);
  if constexpr (std::is_same_v<Decoder, io::Evt3Decoder>) check_encoder(whole, io::Evt3Encoder(size.width), decoder);
}

template <typename Word>
std::string bytes_of(Word word) {
  std::string bytes;
  for (std::size_t i = 0; i < sizeof(Word); ++i) bytes += static_cast<char>(std::uint64_t{word} >> (8 * i) & 0xFF);
  return bytes;
}

// A time word's payload: mostly one of a few neighbours, else anything.
inline std::uint32_t time_high(Random& random, std::uint32_t range) {
  const auto any = static_cast<std::uint32_t>(random.bits());
  switch (below(random, 4)) {
    case 0: return any % range;
    case 1: return range - 1 - any % 3;
    default: return any % 5;
  }
}

inline std::uint32_t evt2_word(Random& random) {
  constexpr std::array<std::uint32_t, 8> types{0, 1, 1, 8, 8, 10, 14, 15};
  const std::uint32_t type = types[below(random, types.size())];
  if (type == 8) return type << 28U | time_high(random, 1U << 28U);
  const std::uint32_t low = static_cast<std::uint32_t>(below(random, 64)) << 22U;
  const auto near = [&] {
    const std::uint64_t most = below(random, 2) == 0 ? 64 : 2048;
    return static_cast<std::uint32_t>(below(random, most));
  };
  const std::uint32_t x = near(), y = near();
  return type << 28U | low | x << 11U | y;
}

inline std::string make_evt2(Random& random) { return bytes_of(evt2_word(random)); }
inline std::string make_evt21(Random& random) {
  const std::uint64_t upper = evt2_word(random), mask = random.bits() & random.bits() & 0xFFFFFFFF;
  return bytes_of(upper << 32U | mask);
}
inline std::string make_evt3(Random& random) {
  constexpr std::array<std::uint32_t, 16> types{0, 2, 2, 2, 3, 4, 4, 5, 6, 6, 7, 8, 8, 10, 14, 15};
  const std::uint32_t type = types[below(random, types.size())];
  const auto any = static_cast<std::uint32_t>(random.bits() & 0xFFF);
  const std::uint32_t near = (any & 0x800) | (any & (random.bits() % 2 == 0 ? 0x3F : 0x7FF));
  const std::uint32_t payload = type == 8 ? time_high(random, 4096) : type == 0 || type == 2 || type == 3 ? near : any;
  return bytes_of(static_cast<std::uint16_t>(type << 12U | payload));
}

/// A few inputs of up to 32 words, on a sensor of 64 x 48 px.
template <typename Make>
std::vector<std::string> decoder_seeds(const Make& make, const std::string& time_word) {
  std::vector<std::string> seeds;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Random random(seed);
    std::string input = bytes_of(std::uint16_t{63}) + bytes_of(std::uint16_t{47}) + static_cast<char>(seed);
    input += seed == 7 ? "" : time_word;  // all but one begin with a time
    for (std::size_t words = std::size_t{4} << (seed % 4); words > 0; --words) input += make(random);
    seeds.push_back(input);
  }
  return seeds;
}

inline std::vector<std::string> raw_seeds() {
  std::vector<std::string> seeds;
  const std::string time2 = bytes_of(0x80000001U), time3 = bytes_of(std::uint16_t{0x8001});
  const std::string time21 = bytes_of(std::uint64_t{0x80000001U} << 32U);
  const auto add = [&](io::RawFormat format, const auto& make, const std::string& time) {
    for (const std::string& seed : decoder_seeds(make, time))
      seeds.push_back(io::make_raw_header(format, {64, 48}) + seed.substr(kDecoderHeader));
  };
  add(io::RawFormat::evt2, make_evt2, time2);
  add(io::RawFormat::evt21, make_evt21, time21);
  add(io::RawFormat::evt3, make_evt3, time3);
  seeds.push_back("% evt 2.1\n% geometry 64x48\n% end\n" + time21 + time21);
  seeds.push_back("% system_ID 49\n% Date 2024-01-01 00:00:00\n" + time3 + time3);
  return seeds;
}

inline std::string make_raw_part(Random& random) {
  static const std::vector<std::string> lines{"% evt 3.0\n",
                                              "% evt 2.1\n",
                                              "% format EVT2;height=48;width=64\n",
                                              "% format EVT21;endianness=legacy\n",
                                              "% geometry 64x48\n",
                                              "% geometry 99999999999x-1\n",
                                              "% geometry 2048x2049\n",
                                              "% system_ID 31\n",
                                              "% integrator_name Prophesee\n",
                                              "% end\n",
                                              "% ",
                                              "\r\n"};
  switch (below(random, 4)) {
    case 0: return lines[below(random, lines.size())];
    case 1: return make_evt2(random);
    case 2: return make_evt21(random);
    default: return make_evt3(random);
  }
}

inline Decoded read_raw(const MemoryFile& file, std::size_t block_bytes, bool shift) {
  io::RawReader reader(io::BlockReader(file.path(), block_bytes), {SensorSize{64, 48}, shift});
  Decoded decoded;
  while (true) {
    const auto batch = reader.next_batch();
    decoded.triggers.insert(decoded.triggers.end(), reader.triggers().begin(), reader.triggers().end());
    if (batch.empty()) break;
    decoded.events.insert(decoded.events.end(), batch.begin(), batch.end());
  }
  require_that(reader.bytes_read() == reader.bytes_total(), "the whole file is read");
  decoded.statistics = reader.statistics();
  if (!shift) check_counts(decoded, reader.sensor_size());
  return decoded;
}

}  // namespace detail

inline void fuzz_raw(std::string_view input) {
  const MemoryFile file(input);
  try {
    const auto header = io::parse_raw_header(input, file.path());
    const auto whole = detail::read_raw(file, io::BlockReader::kBlockBytes, false);
    // Opening files and starting threads take most of the time: each comparison is made for one input in four.
    const std::size_t comparison = std::hash<std::string_view>()(input) % 4;
    if (comparison == 0) {
      const auto blocks = detail::read_raw(file, header.bytes + 1 + input.size() % 61, false);
      // A block does not show what follows it: there, other times may be called garbled.
      const bool certain = whole.statistics.garbled_times + blocks.statistics.garbled_times == 0;
      const bool order_stated = header.format != io::RawFormat::evt21 || header.word_order_stated;
      if (certain && order_stated) require_that(whole == blocks, "blocks of any length give the same events");
    } else if (comparison == 1) {
      const auto shifted = detail::read_raw(file, io::BlockReader::kBlockBytes, true);
      require_that(shifted.statistics == whole.statistics && shifted.events.size() == whole.events.size(),
                   "shifted times change no counts");
    }
  } catch (const io::RecordingError&) {
  }
}

namespace detail {

/// The chunks of Prophesee's encoder.
inline std::vector<std::string> ecf_seeds() {
  std::vector<std::string> seeds;
  for (std::size_t chunk = 0; chunk < io::test::kEcfChunks; ++chunk) seeds.push_back(io::test::ecf_chunk(chunk));
  return seeds;
}

/// A run of any kind, or a long step of time.
inline std::string make_ecf_run(Random& random) {
  const std::string bytes = bytes_of(random.bits());
  switch (below(random, 3)) {
    case 0: return bytes.substr(0, 1);
    case 1: return bytes.substr(0, 2);
    default: return std::string(below(random, 20), static_cast<char>(bytes[0] | '\xF0'));
  }
}

}  // namespace detail

inline void fuzz_ecf(std::string_view input) {
  const auto chunk = detail::as_bytes(input);
  const std::vector<Event> before{{1, 2, 1, 3}};
  std::vector<Event> events = before;
  try {
    io::decode_ecf(chunk, events);
  } catch (const std::runtime_error& error) {
    require_that(events == before, "a chunk that is garbled adds nothing");
    require_that(std::string_view(error.what()).starts_with("garbled: "), "the error says so");
    return;
  }
  const auto header = io::load_word<std::uint32_t>(chunk.data());
  require_that(events.size() == before.size() + (header >> 2U), "the chunk states the number of its events");
  require_that(events[0] == before[0], "what was there stays");
  for (const Event& event : events)
    require_that(event.x < 2053 && event.y < 2048 && (event.p == 0 || event.p == 1), "11 bits each, and polarities");
  arrived += events.size() - 1;
}

inline std::vector<Target> evt_targets() {
  using namespace detail;
  const std::size_t header = kDecoderHeader;
  const auto seeds = [](const auto& make, const std::string& time) {
    return [=] { return decoder_seeds(make, time); };
  };
  return {
      {"ecf", fuzz_ecf, ecf_seeds, {4, 1, make_ecf_run}, 600, 100'000, 50},
      {"evt2",
       [](std::string_view input) { fuzz_decoder<io::Evt2Decoder>(io::RawFormat::evt2, input); },
       seeds(make_evt2, bytes_of(0x80000001U)),
       {header, 4, make_evt2},
       256,
       300'000,
       1},
      {"evt21",
       [](std::string_view input) { fuzz_decoder<io::Evt21Decoder>(io::RawFormat::evt21, input); },
       seeds(make_evt21, bytes_of(std::uint64_t{0x80000001U} << 32U)),
       {header, 8, make_evt21},
       256,
       300'000,
       4},
      {"evt3",
       [](std::string_view input) { fuzz_decoder<io::Evt3Decoder>(io::RawFormat::evt3, input); },
       seeds(make_evt3, bytes_of(std::uint16_t{0x8001})),
       {header, 2, make_evt3},
       256,
       300'000,
       0.3},
      {"raw", fuzz_raw, raw_seeds, {0, 2, make_raw_part}, 512, 100'000, 1.5},
  };
}

}  // namespace evmarker::fuzz
