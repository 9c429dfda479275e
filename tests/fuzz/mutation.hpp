#pragma once
// Structured mutation: changes of an input that keep most of its words whole.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

#include "evmarker/simulation/random.hpp"

namespace evmarker::fuzz {

inline std::size_t below(Random& random, std::size_t count) noexcept { return random.bits() % count; }

/// What inputs of a kind are made of.
struct Grammar {
  std::size_t header_bytes = 0;                   ///< before the first word
  std::size_t word_bytes = 1;                     ///< words begin at multiples of this
  std::function<std::string(Random&)> make_word;  ///< a word, or several, that make sense somewhere
};

/// Changes an input in a few places: words are inserted, replaced, erased, repeated or exchanged, bits flipped, and the
/// end is cut off. It does not become longer than `most_bytes`.
class Mutator {
 public:
  Mutator(const Grammar& grammar, std::size_t most_bytes) : grammar_(grammar), most_bytes_(most_bytes) {}

  void mutate(std::string& input, Random& random) const {
    for (std::size_t changes = 1 + below(random, 4); changes > 0; --changes) change(input, random);
    input.resize(std::min(input.size(), most_bytes_));
  }

 private:
  void change(std::string& input, Random& random) const {
    const std::size_t at = place(input, random);
    switch (below(random, 8)) {
      case 0: input.insert(at, grammar_.make_word(random)); break;
      case 1: {
        const std::string word = grammar_.make_word(random);
        input.replace(at, word.size(), word);
        break;
      }
      case 2: input.erase(at, length(random)); break;
      case 3: {
        const std::size_t from = place(input, random);
        input.insert(at, input.substr(from, length(random)));
        break;
      }
      case 4: {
        const std::string part = input.substr(at, length(random));
        input.erase(at, part.size());
        input.insert(place(input, random), part);
        break;
      }
      case 5:
        if (!input.empty()) input[below(random, input.size())] ^= static_cast<char>(1U << below(random, 8));
        break;
      case 6:
        if (!input.empty()) input[below(random, input.size())] = static_cast<char>(random.bits());
        break;
      default:
        if (below(random, 8) == 0) input.resize(below(random, input.size() + 1));
    }
  }

  // The begin of a word or the end.
  std::size_t place(const std::string& input, Random& random) const noexcept {
    if (input.size() < grammar_.header_bytes) return input.size();
    const std::size_t words = (input.size() - grammar_.header_bytes) / grammar_.word_bytes;
    return grammar_.header_bytes + grammar_.word_bytes * below(random, words + 1);
  }
  // Of some words, mostly few.
  std::size_t length(Random& random) const noexcept {
    return grammar_.word_bytes * (1 + below(random, std::size_t{1} << below(random, 6)));
  }

  const Grammar& grammar_;
  std::size_t most_bytes_;
};

}  // namespace evmarker::fuzz
