#pragma once
// What the examples share on the terminal: a progress bar, and one clear line for an error.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <exception>
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

  void update(std::uint64_t done, std::uint64_t total) {
    const int percent =
        total > 0 ? static_cast<int>(100.0 * static_cast<double>(done) / static_cast<double>(total)) : 0;
    if (!shown_ || percent == percent_) return;
    percent_ = percent;
    const std::string bar(static_cast<std::size_t>(percent) * 40 / 100, '#');
    std::fprintf(stderr, "\r[%-40s] %3d %%", bar.c_str(), percent);
    std::fflush(stderr);
  }

 private:
  bool shown_;
  int percent_ = -1;
};

/// Accepts an option's value only if it is a finite number above zero.
inline CLI::Validator positive_number() {
  return {[](std::string& text) {
            double value = 0;
            const bool good = CLI::detail::lexical_cast(text, value) && std::isfinite(value) && value > 0;
            return good ? std::string() : text + " is not a positive number";
          },
          "POSITIVE"};
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

inline int fail(const CLI::App& app, std::string reason) {
  std::replace(reason.begin(), reason.end(), '\n', ' ');  // OpenCV's reasons may have several lines
  std::fprintf(stderr, "%s: %s\n", app.get_name().c_str(), reason.c_str());
  return 1;
}

/// What a program's `main` does: reads its options, then runs its body with them. Whatever goes wrong becomes one line
/// on stderr and exit code 1.
/// @tparam Options has `add_to(CLI::App&)`
template <typename Options, typename Body>
int run(const char* name, const char* description, int argc, char** argv, const Body& body) {
  CLI::App app(description, name);
  Options options;
  options.add_to(app);
  try {
    app.parse(argc, argv);
    body(std::as_const(options));
    return 0;
  } catch (const CLI::ParseError& error) {
    return error.get_exit_code() == 0 ? app.exit(error) : fail(app, std::string(error.what()) + " (see --help)");
  } catch (const std::exception& error) {
    return fail(app, error.what());
  }
}

}  // namespace console
