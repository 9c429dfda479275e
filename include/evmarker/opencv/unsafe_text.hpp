#pragma once
// What a file of settings must not hold, as OpenCV's parsers crash on it or never return.
//
// They are made for what programs write, not for damaged files. All of this was found by fuzzing (tests/fuzz).
#include <algorithm>
#include <cstddef>
#include <string>
#include <string_view>

namespace evmarker::opencv::detail {

// A bound of how deep a text is nested. Brackets or tags go deeper where they open; in YAML, so may each blank of an
// indentation, each dash of a list and each key on the way to a value.
inline std::size_t nesting_bound(std::string_view text, bool xml) {
  std::size_t open = 0, in_line = 0, bound = 0;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i], next = i + 1 < text.size() ? text[i + 1] : '\n';
    const bool opens = xml ? c == '<' && next != '/' && next != '?' && next != '!' : c == '[' || c == '{';
    const bool closes = xml ? (c == '<' && next == '/') || (c == '/' && next == '>') : c == ']' || c == '}';
    if (opens) ++open;
    if (closes && open > 0) --open;
    if (c == ',' || c == '\n') in_line = 0;
    if (!xml && (c == ' ' || c == '\t' || c == '-' || c == ':')) ++in_line;
    bound = std::max(bound, open + in_line);
  }
  return bound;
}

// True if a YAML file is one document whose first line, behind directives and comments, names a field, and no other
// line is indented less. From what follows a root in brackets, a document, or such a line, the parser may never return.
inline bool is_one_map(std::string_view yaml) {
  constexpr std::size_t kNone = std::string_view::npos;
  constexpr std::string_view kBlank = " \t\r";
  std::size_t indentation = kNone;  // of the first field; none before it
  bool begun = false;               // there was `---`
  while (!yaml.empty()) {
    const std::string_view line = yaml.substr(0, yaml.find('\n'));
    yaml.remove_prefix(std::min(line.size() + 1, yaml.size()));
    const std::size_t at = line.find_first_not_of(kBlank);
    if (at == kNone || line[at] == '#') continue;
    if (line.starts_with("...")) return false;
    if (indentation != kNone) {
      if (at < indentation || line.starts_with("---")) return false;
    } else if (line[at] == '%') {
      continue;
    } else if (!begun && line.starts_with("---") && line.find_first_not_of(kBlank, 3) == kNone) {
      begun = true;
    } else if (line[at] == '[' || line[at] == '{' || line[at] == '-') {
      return false;
    } else {
      indentation = at;
    }
  }
  return indentation != kNone;
}

// Why OpenCV must not parse a text, which begins with a character that is not blank; empty if it may.
inline std::string find_unsafe(std::string_view text) {
  const bool xml = text.front() == '<', json = text.front() == '{';
  // At a byte 0 some parsers end, and others read on behind the end.
  if (text.find('\0') != std::string_view::npos) return "is neither YAML, XML nor JSON: it has a byte 0";
  // The parsers call themselves for each level, and 30 000 of them overflow the stack.
  constexpr std::size_t kMostLevels = 1000;
  if (nesting_bound(text, xml) > kMostLevels)
    return "is nested more than " + std::to_string(kMostLevels) + " levels deep: not a file of settings";
  // The parser of XML reads on behind the end of what is cut off.
  if (xml && !text.substr(0, text.find_last_not_of(" \t\r\n") + 1).ends_with("</opencv_storage>"))
    return "is cut off: it does not end with </opencv_storage>";
  // The parsers may never return from data in base 64 that are none.
  for (const std::string_view mark : {"!!binary", "\"binary\"", "$base64$"})
    if (text.find(mark) != std::string_view::npos)
      return "has binary data (" + std::string(mark) + "), which is not read";
  if (!xml && !json && !is_one_map(text)) return "is neither YAML, XML nor JSON with named fields";
  return {};
}

}  // namespace evmarker::opencv::detail
