#pragma once
// Events written in a camera's format and read back, in memory.
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "evmarker/io/evt2.hpp"
#include "evmarker/io/evt3.hpp"
#include "evmarker/io/evt_words.hpp"

namespace evmarker::bench {

enum class Encoding { none, evt2, evt21, evt3 };

/// EVT2.1 words of one event each: an EVT2 word above a mask of its columns.
class Evt21Encoder {
 public:
  void encode(std::span<const Event> events, std::vector<std::byte>& bytes) {
    words_.clear();
    evt2_.encode(events, words_);
    constexpr std::uint32_t kFirstColumn = 1;
    for (std::size_t at = 0; at < words_.size(); at += io::Evt2Decoder::kWordBytes) {
      io::append_word<std::uint32_t>(bytes, kFirstColumn);
      io::append_word<std::uint32_t>(bytes, io::load_word<std::uint32_t>(&words_[at]));
    }
  }

 private:
  io::Evt2Encoder evt2_;
  std::vector<std::byte> words_;
};

/// Passes events on as a decoder gives them, piece by piece.
class EncodingLoop {
 public:
  EncodingLoop(Encoding encoding, SensorSize size) {
    switch (encoding) {
      case Encoding::none: break;
      case Encoding::evt2: codec_.emplace<Evt2>(io::Evt2Encoder(), io::Evt2Decoder(size)); break;
      case Encoding::evt21: codec_.emplace<Evt21>(Evt21Encoder(), io::Evt21Decoder(size)); break;
      case Encoding::evt3: codec_.emplace<Evt3>(io::Evt3Encoder(size.width), io::Evt3Decoder(size)); break;
    }
  }

  /// The events after they were encoded and decoded; valid until the next call, and as long as `events`.
  /// @throws std::invalid_argument naming a time that the encoding cannot express
  std::span<const Event> pass(std::span<const Event> events) {
    return std::visit([&](auto& codec) { return pass(events, codec); }, codec_);
  }

 private:
  template <typename Encoder, typename Decoder>
  struct Codec {
    Encoder encoder;
    Decoder decoder;
    Codec(Encoder e, Decoder d) : encoder(std::move(e)), decoder(std::move(d)) {}
  };
  using Evt2 = Codec<io::Evt2Encoder, io::Evt2Decoder>;
  using Evt21 = Codec<Evt21Encoder, io::Evt21Decoder>;
  using Evt3 = Codec<io::Evt3Encoder, io::Evt3Decoder>;

  template <typename C>
  std::span<const Event> pass(std::span<const Event> events, C& codec) {
    if constexpr (std::is_same_v<C, std::monostate>) {
      return events;
    } else {
      bytes_.clear();
      decoded_.clear();
      triggers_.clear();
      codec.encoder.encode(events, bytes_);
      io::decode_append(codec.decoder, bytes_, decoded_, triggers_);
      return decoded_;
    }
  }

  std::variant<std::monostate, Evt2, Evt21, Evt3> codec_;
  std::vector<std::byte> bytes_;
  std::vector<Event> decoded_;
  std::vector<TriggerEvent> triggers_;
};

}  // namespace evmarker::bench
