#pragma once
// YAML as other programs write it, in the form that OpenCV's parser reads.
//
// That parser refuses lists that are indented no more than their key (as PyYAML writes them), lists and maps in
// brackets that end with a comma, lines in brackets that are indented less than their key, and words that begin with a
// digit.
#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace evmarker::opencv::detail {

// Takes lines of YAML off the front of a text.
class YamlLines {
 public:
  explicit YamlLines(std::string_view text) : text_(text) {}

  bool empty() const { return at_ >= text_.size(); }

  // The next line without its comment. Lines that belong to one list or map in brackets are joined, without the comma
  // behind its last element.
  std::string next() {
    line_.clear();
    depth_ = 0;
    quote_ = 0;
    for (; !empty(); ++at_) {
      const char c = text_[at_];
      if (c == '\n' && depth_ == 0) break;
      if (quote_ != 0)
        add_quoted(c);
      else if (c == '#' && follows_blank())
        at_ = std::min(text_.find('\n', at_), text_.size()) - 1;
      else
        add(c);
    }
    ++at_;  // the line feed
    line_.erase(line_.find_last_not_of(kBlank) + 1);
    return std::move(line_);
  }

 private:
  static constexpr std::string_view kBlank = " \t\r\n";
  static bool is_blank(char c) { return kBlank.find(c) != std::string_view::npos; }
  bool follows_blank() const { return line_.empty() || is_blank(line_.back()); }

  // True if a value may begin here: a bracket or a quotation mark inside a word is a letter of it.
  bool begins_value() const {
    const std::size_t last = line_.find_last_not_of(kBlank);
    if (last == std::string::npos) return true;
    const std::string_view before = depth_ > 0 ? ":,[{" : ":-";
    return before.find(line_[last]) != std::string_view::npos && (depth_ > 0 || follows_blank());
  }

  void add_quoted(char c) {
    line_ += c == '\n' ? ' ' : c;
    const char next = at_ + 1 < text_.size() ? text_[at_ + 1] : '\n';
    if ((c == '\\' && quote_ == '"') || (c == '\'' && quote_ == '\'' && next == '\'')) {
      line_ += next;  // which is meant as it is
      ++at_;
    } else if (c == quote_) {
      quote_ = 0;
    }
  }

  // The word that begins here if it begins as a number, but is none, as 4X4_50; empty otherwise.
  std::string_view numbered_word() const {
    std::string_view word = text_.substr(at_, text_.find_first_of(depth_ > 0 ? ",]}\n" : "\n", at_) - at_);
    word = word.substr(0, word.find(" #"));
    word = word.substr(0, word.find_last_not_of(kBlank) + 1);
    const std::string text(word);
    char* end = nullptr;
    std::strtod(text.c_str(), &end);
    return *end == '\0' || word.find_first_of(":\"\\") != word.npos ? std::string_view() : word;
  }

  void add(char c) {
    if (c >= '0' && c <= '9' && begins_value())
      if (const std::string_view word = numbered_word(); !word.empty()) {
        line_.append("\"").append(word).append("\"");
        at_ += word.size() - 1;
        return;
      }
    if ((c == '"' || c == '\'') && begins_value()) quote_ = c;
    if ((c == '[' || c == '{') && (depth_ > 0 || begins_value())) ++depth_;
    if ((c == ']' || c == '}') && depth_ > 0) {
      --depth_;
      const std::size_t last = line_.find_last_not_of(kBlank);
      if (line_[last] == ',') line_.erase(last);
    }
    if (depth_ == 0 || !is_blank(c))
      line_ += c;
    else if (!follows_blank())
      line_ += ' ';
  }

  std::string_view text_;
  std::string line_;
  std::size_t at_ = 0, depth_ = 0;
  char quote_ = 0;  // the quotation mark that is open, or 0
};

// The first document of a text of YAML: all before the next line that begins with --- or ...
inline std::string first_document(const std::string& yaml) {
  bool begun = false;  // there was a line that is neither blank, a directive nor a comment
  for (std::size_t at = 0; at < yaml.size();) {
    const std::string_view line = std::string_view(yaml).substr(at, yaml.find('\n', at) - at);
    const bool is_mark = line.starts_with("---") || line.starts_with("...");
    if (is_mark && begun) return yaml.substr(0, at);
    const std::size_t word = line.find_first_not_of(" \t\r");
    begun = begun || (!is_mark && word != line.npos && line[word] != '%' && line[word] != '#');
    at += line.size() + 1;
  }
  return yaml;
}

// A text of nothing but numbers, separated by blanks or commas, as a list in brackets; empty if it is none.
inline std::string listed_numbers(const std::string& text) {
  std::string list;
  for (std::size_t at = 0; (at = text.find_first_not_of(" \t\r\n,", at)) != text.npos;) {
    const std::string word = text.substr(at, text.find_first_of(" \t\r\n,", at) - at);
    char* end = nullptr;
    std::strtod(word.c_str(), &end);
    if (*end != '\0') return {};
    list += (list.empty() ? "[" : ", ") + word;
    at += word.size();
  }
  return list.empty() ? list : list + "]\n";
}

// The same YAML for OpenCV's parser; it stays wrong where it is wrong.
inline std::string plain_yaml(std::string_view yaml) {
  constexpr std::size_t kNone = std::string::npos;
  std::string plain;
  std::vector<std::size_t> lists;  // the columns, in the file, of those that are indented no more than their key
  std::size_t key = kNone;         // the column of the key that the line before ended with
  for (YamlLines lines(yaml); !lines.empty();) {
    const std::string line = lines.next();
    const std::size_t at = line.find_first_not_of(" \t");
    if (at == kNone) continue;
    const bool is_item = line[at] == '-' && (at + 1 == line.size() || line[at + 1] == ' ');
    while (!lists.empty() && (at < lists.back() || (at == lists.back() && !is_item))) lists.pop_back();
    if (is_item && at == key) lists.push_back(at);
    plain.append(2 * lists.size(), ' ').append(line).append("\n");
    key = line.back() == ':' ? line.find_first_not_of(" \t-") : kNone;
  }
  return plain;
}

}  // namespace evmarker::opencv::detail
