#include <algorithm>
#include <cctype>
#include <string_view>
#include <system_error>

#include "s3lam/base/error.h"
#include "s3lam/io/image_file.h"
#include "sequence_formats.h"

namespace s3lam::internal {
namespace fs = std::filesystem;
namespace {

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

/// The run of digits at `begin`, and the same without leading zeros.
std::pair<std::string_view, std::string_view> DigitsAt(std::string_view text, size_t begin) {
  size_t end = begin;
  while (end < text.size() && IsDigit(text[end])) ++end;
  const std::string_view digits = text.substr(begin, end - begin);
  return {digits, digits.substr(std::min(digits.find_first_not_of('0'), digits.size()))};
}

bool IsHidden(const fs::path& path) { return path.filename().string().starts_with('.'); }

}  // namespace

bool NaturalLess(const std::string& a, const std::string& b) {
  size_t i = 0;
  size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (IsDigit(a[i]) && IsDigit(b[j])) {
      const auto [digits_a, value_a] = DigitsAt(a, i);
      const auto [digits_b, value_b] = DigitsAt(b, j);
      if (value_a.size() != value_b.size()) return value_a.size() < value_b.size();
      if (value_a != value_b) return value_a < value_b;
      i += digits_a.size();
      j += digits_b.size();
      continue;
    }
    if (a[i] != b[j]) {
      if (a[i] == '/' || b[j] == '/') return a[i] == '/';
      return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
    }
    ++i;
    ++j;
  }
  if (i < a.size() || j < b.size()) return j < b.size();
  return a < b;  // Equal but for leading zeros.
}

std::vector<std::string> ListImages(const fs::path& directory, bool recursive) {
  std::vector<std::string> names;
  std::error_code error;
  fs::recursive_directory_iterator it(directory, error);
  while (!error && it != fs::recursive_directory_iterator()) {
    const fs::path path = it->path();
    std::error_code of_entry;  // What cannot be asked, such as a link to nothing, is no image.
    if (it->is_directory(of_entry) && (IsHidden(path) || !recursive)) {
      it.disable_recursion_pending();
    }
    if (!IsHidden(path) && HasImageExtension(path) && it->is_regular_file(of_entry)) {
      names.push_back(path.lexically_relative(directory).generic_string());
    }
    it.increment(error);
  }
  if (error) ThrowInputError("{}: cannot list: {}", directory.string(), error.message());
  std::sort(names.begin(), names.end(), NaturalLess);
  return names;
}

ImageSequence OpenFolder(const fs::path& path, double period_s) {
  ImageSequence sequence;
  sequence.format = SequenceFormat::kFolder;
  sequence.image_root = path;
  for (const std::string& name : ListImages(path, /*recursive=*/true)) {
    const auto number = static_cast<double>(sequence.frames.size());
    sequence.frames.push_back({number * period_s, name, path / name});
  }
  if (sequence.frames.empty()) ThrowInputError("{}: no images in this folder", path.string());
  return sequence;
}

}  // namespace s3lam::internal
