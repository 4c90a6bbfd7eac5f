#include "npy_array.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <string_view>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

static_assert(std::endian::native == std::endian::little, "arrays are used as they lie");

constexpr std::string_view kMagic("\x93NUMPY", 6);

/// What stands after `'key':` in the header's dictionary, up to `end`.
std::string HeaderValue(const std::string& header, const std::string& key, char end) {
  const size_t at = header.find("'" + key + "':");
  if (at == std::string::npos) return {};
  size_t begin = at + key.size() + 3;
  while (begin < header.size() && header[begin] == ' ') ++begin;
  const size_t stop = header.find(end, begin);
  return stop == std::string::npos ? std::string() : header.substr(begin, stop - begin);
}

/// Parses "(1, 2, 3" or "(1,".
bool ParseShape(std::string text, std::vector<int64_t>& shape) {
  text.erase(std::remove(text.begin(), text.end(), ' '), text.end());
  if (text.empty() || text.front() != '(') return false;
  const char* at = text.data() + 1;
  const char* const end = text.data() + text.size();
  while (at != end) {
    int64_t size = 0;
    const auto [next, error] = std::from_chars(at, end, size);
    if (error != std::errc() || size < 0) return false;
    shape.push_back(size);
    if (next != end && *next != ',') return false;
    at = next == end ? end : next + 1;
  }
  return true;
}

/// "<f4", "|u1" -> "f4", "u1"; empty for big endian and for what is not a number.
std::string ParseType(const std::string& text) {
  if (text.size() != 5 || text.front() != '\'' || text.back() != '\'') return {};
  const bool is_one_byte = text[3] == '1';
  if (text[1] != '<' && !(is_one_byte && text[1] == '|')) return {};
  if (std::string_view("fiub").find(text[2]) == std::string_view::npos) return {};
  return std::string_view("1248").find(text[3]) == std::string_view::npos ? std::string()
                                                                          : text.substr(2, 2);
}

}  // namespace

NpyArray ParseNpy(std::string bytes, const std::string& source) {
  const auto byte = [&bytes](size_t i) {
    return static_cast<size_t>(static_cast<uint8_t>(bytes[i]));
  };
  if (!bytes.starts_with(kMagic) || bytes.size() < 12 || byte(6) < 1 || byte(6) > 3) {
    ThrowInputError("{}: not a .npy file", source);
  }
  const size_t length_bytes = byte(6) == 1 ? 2 : 4;
  size_t length = 0;
  for (size_t i = 0; i < length_bytes; ++i) length |= byte(8 + i) << (8 * i);
  const size_t begin = 8 + length_bytes;
  if (length > bytes.size() - begin) ThrowInputError("{}: .npy header is cut short", source);
  const std::string header = bytes.substr(begin, length);
  NpyArray array;
  array.type = ParseType(HeaderValue(header, "descr", ','));
  if (array.type.empty()) {
    ThrowInputError("{}: items of type {} (wanted little-endian numbers)", source,
                    HeaderValue(header, "descr", ','));
  }
  if (HeaderValue(header, "fortran_order", ',') != "False") {
    ThrowInputError("{}: not in C order; save numpy.ascontiguousarray of it", source);
  }
  const std::string shape = HeaderValue(header, "shape", ')');
  if (!ParseShape(shape, array.shape)) ThrowInputError("{}: malformed shape", source);
  array.offset = begin + length;
  auto size = static_cast<__int128>(array.type[1] - '0');
  for (const int64_t n : array.shape) {
    size *= n;
    if (size > std::numeric_limits<int64_t>::max()) break;
  }
  if (size != static_cast<__int128>(bytes.size() - array.offset)) {
    ThrowInputError("{}: {} bytes of data do not fit shape {}) of {}", source,
                    bytes.size() - array.offset, shape, array.type);
  }
  array.bytes = std::move(bytes);
  return array;
}

}  // namespace s3lam
