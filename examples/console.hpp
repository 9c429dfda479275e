#pragma once
// What the examples share on the terminal: a progress bar, and one clear line for an error.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cinttypes>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <evmarker/base/require.hpp>
#include <exception>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace console {

/// A progress bar on stderr; shows nothing where stderr is no terminal, or in quiet mode.
class ProgressBar {
 public:
  explicit ProgressBar(bool quiet) : shown_(!quiet && isatty(STDERR_FILENO) != 0) {}
  ProgressBar(const ProgressBar&) = delete;
  ~ProgressBar() {
    if (shown_) std::fputs("\r\033[K", stderr);
  }

  /// @param total 0 where it is not known, as of a pipe: then the megabytes until now are shown
  void update(std::uint64_t done, std::uint64_t total) {
    const std::uint64_t step = total == 0 ? done / kMegabyte : percent(done, total);
    if (!shown_ || step == step_) return;
    step_ = step;
    if (total == 0)
      std::fprintf(stderr, "\r%" PRIu64 " MB", step);
    else
      std::fprintf(stderr, "\r[%-40s] %3" PRIu64 " %%", std::string(step * 40 / 100, '#').c_str(), step);
    std::fflush(stderr);
  }

 private:
  static constexpr std::uint64_t kMegabyte = 1000000;

  static std::uint64_t percent(std::uint64_t done, std::uint64_t total) {  // a file may grow while it is read
    return static_cast<std::uint64_t>(100 * std::min(1.0, static_cast<double>(done) / static_cast<double>(total)));
  }

  bool shown_;
  std::uint64_t step_ = std::numeric_limits<std::uint64_t>::max();
};

/// A line on stderr while a program works; where a progress bar is shown, in its place.
inline void say(const std::string& line) {
  std::fprintf(stderr, "%s%s\n", isatty(STDERR_FILENO) != 0 ? "\r\033[K" : "", line.c_str());
}

/// Accepts an option's value only if it is a finite number above zero.
inline CLI::Validator positive_number() {
  return {[](std::string& text) {
            double value = 0;
            const bool good = CLI::detail::lexical_cast(text, value) && std::isfinite(value) && value > 0;
            return good ? std::string() : text + " is not a positive number";
          },
          "POSITIVE"};
}

/// Accepts an option's value only if it is a finite number, 0 or above.
inline CLI::Validator non_negative_number() {
  return {[](std::string& text) {
            double value = 0;
            const bool good = CLI::detail::lexical_cast(text, value) && std::isfinite(value) && value >= 0;
            return good ? std::string() : text + " is not a number from 0 on";
          },
          "NONNEGATIVE"};
}

/// What is wrong with a marker's length in metres, as where it is in millimetres; empty if nothing is.
/// @param text the length as the user has written it
inline std::string marker_length_fault(double length, const std::string& text) {
  if (length >= 0.001 && length <= 10) return {};
  const std::string meant = text + " is taken as metres, which must be from 0.001 to 10";
  return length < 1 ? meant : meant + "; for " + text + " mm give " + evmarker::number_text(length / 1000);
}

/// Accepts a marker's length in metres: not in millimetres. What is more likely in centimetres is asked about, though
/// there are markers of a metre and more, which are seen from far.
inline CLI::Validator marker_length() {
  return {[](std::string& text) {
            if (const std::string fault = positive_number()(text); !fault.empty()) return fault;
            double length = 0;
            CLI::detail::lexical_cast(text, length);
            std::string fault = marker_length_fault(length, text);
            if (fault.empty() && length >= 1)
              say("a marker's length of " + text + " is taken as metres: for " + text + " cm give " +
                  evmarker::number_text(length / 100));
            return fault;
          },
          "0.001..10"};
}

/// Accepts `auto`, as 0, or a whole number from 1 to `most`.
inline CLI::Validator automatic_or_up_to(int most) {
  return {[most](std::string& text) {
            if (text == "auto") {
              text = "0";
              return std::string();
            }
            int value = 0;
            const bool good = CLI::detail::lexical_cast(text, value) && value >= 1 && value <= most;
            return good ? std::string() : text + " is neither auto nor a number from 1 to " + std::to_string(most);
          },
          "auto or 1.." + std::to_string(most)};
}

/// How the default of such an option is shown.
inline std::string automatic_or(int value) { return value == 0 ? "auto" : std::to_string(value); }

/// Ends a program that has done what it could, with a line on stderr and an exit code of its own.
class Exit : public std::runtime_error {
 public:
  Exit(int code, const std::string& reason) : std::runtime_error(reason), code_(code) {}
  int code() const noexcept { return code_; }

 private:
  int code_;
};

/// The end of a program's `--help`.
/// @param own exit codes that only this program has, as "2 nothing found, "
inline std::string exit_codes(const std::string& own = "") {
  return "Exit codes: 0 done, 1 error, " + own +
         "130 or 143 interrupted by Ctrl-C or SIGTERM, where all until then is kept";
}

inline int fail(const CLI::App& app, std::string reason, int code = 1) {
  std::replace(reason.begin(), reason.end(), '\n', ' ');  // OpenCV's reasons may have several lines
  std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), reason.c_str());
  return code;
}

/// What a program's `main` does: reads its options, then runs its body with them. Whatever goes wrong becomes one line
/// on stderr and exit code 1, or the code of an `Exit`.
/// @param name of the program, unless it has been called by another, as by that under which it is installed
/// @tparam Options has `add_to(CLI::App&)`
template <typename Options, typename Body>
int run(const char* name, const char* description, int argc, char** argv, const Body& body) {
  const std::string called = argc > 0 ? std::filesystem::path(argv[0]).filename().string() : "";
  CLI::App app(description, called.empty() ? name : called);
  Options options;
  options.add_to(app);
  try {
    app.parse(argc, argv);
    body(std::as_const(options));
    return 0;
  } catch (const CLI::ParseError& error) {
    return error.get_exit_code() == 0 ? app.exit(error) : fail(app, std::string(error.what()) + " (see --help)");
  } catch (const Exit& exit) {
    return fail(app, exit.what(), exit.code());
  } catch (const std::exception& error) {
    return fail(app, error.what());
  }
}

}  // namespace console
