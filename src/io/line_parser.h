#pragma once

#include <charconv>
#include <cmath>
#include <istream>
#include <optional>
#include <string>
#include <string_view>

#include "s3lam/base/error.h"

namespace s3lam::internal {

/// Takes one line of a text file apart. Every error names source, line and field.
class LineParser {
 public:
  LineParser(std::string_view line, const std::string& source, size_t line_number)
      : rest_(line), source_(source), line_number_(line_number) {
    SkipSpace();
  }

  [[nodiscard]] bool AtEnd() const { return rest_.empty(); }

  /// The next run of characters other than white space.
  std::string_view Word(std::string_view field) {
    if (AtEnd()) Fail("{} is missing", field);
    const std::string_view word = rest_.substr(0, rest_.find_first_of(kSpace));
    rest_.remove_prefix(word.size());
    SkipSpace();
    return word;
  }

  /// All but the last `count` words, as it stands; the next word if there are no more than those.
  std::string_view AllBut(size_t count, std::string_view field) {
    size_t end = rest_.find_last_not_of(kSpace) + 1;
    while (count-- > 0 && end > 0) {
      const std::string_view before = rest_.substr(0, rest_.find_last_of(kSpace, end - 1) + 1);
      end = before.find_last_not_of(kSpace) + 1;
    }
    if (end == 0) return Word(field);
    const std::string_view words = rest_.substr(0, end);
    rest_.remove_prefix(end);
    SkipSpace();
    return words;
  }

  /// What is left of the line, without white space at its ends.
  std::string_view Rest() {
    const std::string_view rest = rest_.substr(0, rest_.find_last_not_of(kSpace) + 1);
    rest_ = {};
    return rest;
  }

  /// A finite number.
  double Real(std::string_view field) {
    const std::string_view word = Word(field);
    double value = 0.0;
    if (!Convert(word, value)) Fail("{} is not a number: '{}'", field, word);
    if (!std::isfinite(value)) Fail("{} is not finite: '{}'", field, word);
    return value;
  }

  template <typename Int>
  Int Integer(std::string_view field) {
    const std::string_view word = Word(field);
    Int value = 0;
    if (!Convert(word, value)) Fail("{} is not a valid integer: '{}'", field, word);
    return value;
  }

  void ExpectEnd() {
    if (!AtEnd()) Fail("unexpected text after the last field: '{}'", Rest());
  }

  template <typename... Args>
  [[noreturn]] void Fail(fmt::format_string<Args...> format, Args&&... args) const {
    ThrowInputError("{}: line {}: {}", source_, line_number_,
                    fmt::format(format, std::forward<Args>(args)...));
  }

 private:
  static constexpr std::string_view kSpace = " \t\r\f\v";

  void SkipSpace() {
    const size_t start = rest_.find_first_not_of(kSpace);
    rest_.remove_prefix(start == std::string_view::npos ? rest_.size() : start);
  }

  template <typename Number>
  static bool Convert(std::string_view word, Number& value) {
    if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);
    const char* end = word.data() + word.size();
    const auto [stop, error] = std::from_chars(word.data(), end, value);
    return error == std::errc() && stop == end;
  }

  std::string_view rest_;
  const std::string& source_;
  size_t line_number_;
};

/// Reads a text file line by line and counts.
class LineReader {
 public:
  LineReader(std::istream& stream, const std::string& source) : stream_(stream), source_(source) {
    stream_.exceptions(std::ios::badbit);  // Else the end of memory looks like one of the disk.
  }

  /// The next line as it stands; false at the end of the file.
  bool NextRaw() {
    try {
      if (!std::getline(stream_, line_)) return false;
    } catch (const std::ios::failure&) {
      ThrowInputError("{}: cannot read", source_);
    }
    ++line_number_;
    ends_in_newline_ = !stream_.eof();
    return true;
  }

  /// The next line that is neither blank nor a comment; `on_comment` gets the comments passed.
  template <typename OnComment>
  bool NextData(OnComment&& on_comment) {
    while (NextRaw()) {
      const size_t start = line_.find_first_not_of(" \t\r\f\v");
      if (start == std::string::npos) continue;
      if (line_[start] != '#') return true;
      on_comment(std::string_view(line_).substr(start));
    }
    return false;
  }
  bool NextData() {
    return NextData([](std::string_view) {});
  }

  [[nodiscard]] const std::string& line() const { return line_; }
  [[nodiscard]] size_t line_number() const { return line_number_; }
  /// Whether the last line read ended in a newline.
  [[nodiscard]] bool ends_in_newline() const { return ends_in_newline_; }
  [[nodiscard]] LineParser Parser() const { return {line_, source_, line_number_}; }

 private:
  std::istream& stream_;
  const std::string& source_;
  std::string line_;
  size_t line_number_ = 0;
  bool ends_in_newline_ = true;
};

/// The number of entries that a comment "# Number of images: 5, ..." promises. A text file cut at a
/// line's end looks whole otherwise; files written by hand need not have the comment.
class PromisedCount {
 public:
  void operator()(std::string_view comment) {
    constexpr std::string_view kPhrase = "Number of ";
    const size_t phrase = comment.find(kPhrase);
    if (phrase == std::string_view::npos) return;
    const size_t colon = comment.find(':', phrase);
    if (colon == std::string_view::npos) return;
    const size_t digits = comment.find_first_not_of(' ', colon + 1);
    if (digits == std::string_view::npos) return;
    size_t value = 0;
    const char* end = comment.data() + comment.size();
    if (std::from_chars(comment.data() + digits, end, value).ec == std::errc()) count_ = value;
  }

  /// Throws InputError if fewer entries came than promised, or the last one is cut.
  void Check(size_t count, const LineReader& reader, std::string_view what,
             const std::string& source) const {
    if (!count_) return;
    if (count < *count_ || !reader.ends_in_newline()) {
      ThrowInputError("{}: promises {} {} and ends after {}: cut short", source, *count_, what,
                      count);
    }
  }

 private:
  std::optional<size_t> count_;
};

}  // namespace s3lam::internal
