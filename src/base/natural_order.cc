#include "s3lam/base/natural_order.h"

#include <algorithm>
#include <string_view>
#include <utility>

namespace s3lam {
namespace {

bool IsDigit(char c) { return c >= '0' && c <= '9'; }

/// The run of digits at `begin`, and the same without leading zeros.
std::pair<std::string_view, std::string_view> DigitsAt(std::string_view text, size_t begin) {
  size_t end = begin;
  while (end < text.size() && IsDigit(text[end])) ++end;
  const std::string_view digits = text.substr(begin, end - begin);
  return {digits, digits.substr(std::min(digits.find_first_not_of('0'), digits.size()))};
}

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

}  // namespace s3lam
