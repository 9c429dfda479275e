#pragma once
// A target of the fuzzer, and the inputs that it is given.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "evmarker/simulation/random.hpp"
#include "fuzz/mutation.hpp"

namespace evmarker::fuzz {

/// A function that breaks no promise, whatever its input is.
struct Target {
  const char* name = "";
  std::function<void(std::string_view)> run;        ///< throws BrokenPromise or anything that it should not
  std::function<std::vector<std::string>()> seeds;  ///< inputs that reach deep
  Grammar grammar;
  std::size_t most_bytes = 512;
  std::uint64_t test_runs = 0;  ///< in the seeded test
  double least_arrivals = 0;    ///< events, poses and files that a run of it must at least lead to, in the mean
};

/// The input of a run of a seed: one of the target's seeds, mutated.
inline std::string make_input(const Target& target, const std::vector<std::string>& seeds, std::uint64_t seed,
                              std::uint64_t run) {
  Random random(seed, run);
  std::string input = seeds[below(random, seeds.size())];
  Mutator(target.grammar, target.most_bytes).mutate(input, random);
  return input;
}

}  // namespace evmarker::fuzz
