// Fuzzes one target: `fuzz evt3 --runs 100000000` without a library's help, by seeded structured mutation; compiled
// with -fsanitize=fuzzer, guided by coverage, with that library's options and the target in the variable EVMARKER_FUZZ.
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "fuzz/targets.hpp"

using namespace evmarker::fuzz;

namespace {

Target target_named(std::string_view name) {
  const auto targets = all_targets();
  for (const Target& target : targets)
    if (target.name == name) return target;
  std::cerr << "fuzz: no target '" << name << "', but:";
  for (const Target& target : targets) std::cerr << ' ' << target.name;
  std::cerr << '\n';
  std::exit(1);
}

}  // namespace

#ifdef EVMARKER_LIBFUZZER

namespace {

const Target& target() {
  const char* const name = std::getenv("EVMARKER_FUZZ");
  static const Target target = target_named(name == nullptr ? "" : name);
  return target;
}

}  // namespace

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t most);

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  target().run({reinterpret_cast<const char*>(data), size});
  return 0;
}

// Half of the inputs are mutated by their grammar, half by the library.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t most, unsigned seed) {
  static const std::vector<std::string> seeds = target().seeds();
  evmarker::Random random(seed);
  if (random.bits() % 2 == 0) return LLVMFuzzerMutate(data, size, most);
  std::string input(reinterpret_cast<const char*>(data), size);
  if (size == 0) input = seeds[below(random, seeds.size())];
  Mutator(target().grammar, std::min(most, target().most_bytes)).mutate(input, random);
  std::copy(input.begin(), input.end(), data);
  return input.size();
}

#else

namespace {

void write_file(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

std::string read_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

// The targets' seeds as files.
void write_corpus(const std::filesystem::path& folder) {
  for (const Target& target : all_targets()) {
    std::filesystem::create_directories(folder / target.name);
    const auto seeds = target.seeds();
    for (std::size_t i = 0; i < seeds.size(); ++i)
      write_file(folder / target.name / ("seed_" + std::to_string(i)), seeds[i]);
  }
}

// An input that takes longer than this is a finding, too.
constexpr unsigned kHang_s = 10;
std::string current_input;

// Keeps the input that hangs or crashes.
void watch_for_signals() {
  for (const int watched : {SIGALRM, SIGSEGV, SIGABRT, SIGFPE})
    std::signal(watched, [](int caught) {
      const int file = ::open("fuzz_input", O_WRONLY | O_CREAT | O_TRUNC, 0644);
      const auto written = ::write(file, current_input.data(), current_input.size());
      const std::string_view message = caught == SIGALRM ? "fuzz: hangs: fuzz_input\n" : "fuzz: crashes: fuzz_input\n";
      _exit(::write(2, message.data(), message.size()) + written < 0 ? 2 : 1);
    });
}

int fuzz(const Target& target, std::uint64_t runs, std::uint64_t seed) {
  const auto seeds = target.seeds();
  watch_for_signals();
  const auto begin = std::chrono::steady_clock::now();
  double longest_s = 0;
  for (std::uint64_t run = 0; run < runs; ++run) {
    const std::string& input = current_input = make_input(target, seeds, seed, run);
    if (run % 64 == 0) ::alarm(kHang_s);
    const std::clock_t before = std::clock();
    try {
      target.run(input);
    } catch (const std::exception& error) {
      const std::string path = "fuzz_" + std::string(target.name) + "_" + std::to_string(run);
      write_file(path, input);
      std::cerr << target.name << ": seed " << seed << ", run " << run << ": " << error.what() << ": " << path << '\n';
      return 1;
    }
    longest_s = std::max(longest_s, static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC);
    if ((run + 1) % std::max<std::uint64_t>(runs / 10, 1) != 0) continue;
    const double s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    std::printf("%s: %llu inputs, %.0f a second, the slowest took %.3f s, no finding\n", target.name,
                static_cast<unsigned long long>(run + 1), static_cast<double>(run + 1) / s, longest_s);
    std::fflush(stdout);
  }
  return 0;
}

}  // namespace

int main(int count, char** arguments) {
  const std::vector<std::string> words(arguments + 1, arguments + count);
  if (words.size() == 3 && words[1] == "--runs") return fuzz(target_named(words[0]), std::stoull(words[2]), 1);
  if (words.size() == 5 && words[1] == "--runs" && words[3] == "--seed")
    return fuzz(target_named(words[0]), std::stoull(words[2]), std::stoull(words[4]));
  if (words.size() == 2 && words[0] == "--write-corpus") {
    write_corpus(words[1]);
    return 0;
  }
  if (words.size() == 2) {
    target_named(words[0]).run(read_file(words[1]));
    std::cout << words[1] << ": no finding\n";
    return 0;
  }
  std::cerr << "usage: fuzz TARGET --runs NUMBER [--seed NUMBER]\n       fuzz TARGET FILE\n       fuzz --write-corpus "
               "FOLDER\n";
  return 1;
}

#endif
