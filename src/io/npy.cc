#include "s3lam/io/npy.h"

#include <bit>
#include <cstdint>
#include <cstring>
#include <istream>
#include <ostream>
#include <sstream>
#include <string>

#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

static_assert(std::endian::native == std::endian::little, "arrays are written as they lie");

constexpr std::string_view kMagic("\x93NUMPY\x01\x00", 8);
constexpr size_t kAlignment = 64;  // Of the data, by the format's definition.

/// The value after `'key':` in the header's dictionary, up to `end`.
std::string HeaderValue(const std::string& header, const std::string& key, char end) {
  const size_t at = header.find("'" + key + "':");
  if (at == std::string::npos) return {};
  size_t begin = at + key.size() + 3;
  while (begin < header.size() && header[begin] == ' ') ++begin;
  const size_t stop = header.find(end, begin);
  return stop == std::string::npos ? std::string() : header.substr(begin, stop - begin);
}

/// Parses "(rows, columns".
bool ParseShape(const std::string& text, Eigen::Index& rows, Eigen::Index& columns) {
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  char open = 0;
  char comma = 0;
  std::string rest;
  if (!(stream >> open >> rows >> comma >> columns) || open != '(' || comma != ',') return false;
  return rows >= 0 && columns >= 0 && !(stream >> rest);
}

}  // namespace

void WriteNpy(const MatrixXfRow& matrix, std::ostream& stream) {
  std::string header =
      fmt::format("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}), }}", matrix.rows(),
                  matrix.cols());
  const size_t fixed = kMagic.size() + 2;
  const size_t total = (fixed + header.size() + 1 + kAlignment - 1) / kAlignment * kAlignment;
  header.append(total - fixed - header.size() - 1, ' ').push_back('\n');
  const auto length = static_cast<uint16_t>(header.size());
  stream.write(kMagic.data(), static_cast<std::streamsize>(kMagic.size()));
  stream.put(static_cast<char>(length & 0xff)).put(static_cast<char>(length >> 8));
  stream << header;
  stream.write(reinterpret_cast<const char*>(matrix.data()),
               static_cast<std::streamsize>(sizeof(float) * static_cast<size_t>(matrix.size())));
}

void WriteNpy(const MatrixXfRow& matrix, const std::filesystem::path& path) {
  WriteFile(path, [&](std::ostream& stream) { WriteNpy(matrix, stream); });
}

MatrixXfRow ReadNpy(std::istream& stream, const std::string& source) {
  std::string prefix(kMagic.size() + 2, '\0');
  stream.read(prefix.data(), static_cast<std::streamsize>(prefix.size()));
  if (!stream || std::string_view(prefix).substr(0, kMagic.size()) != kMagic) {
    ThrowInputError("{}: not a .npy file of version 1.0", source);
  }
  const size_t length = static_cast<uint8_t>(prefix[8]) | static_cast<uint8_t>(prefix[9]) << 8;
  std::string header(length, '\0');
  stream.read(header.data(), static_cast<std::streamsize>(length));
  if (!stream) ThrowInputError("{}: header is cut short", source);
  Eigen::Index rows = 0;
  Eigen::Index columns = 0;
  if (HeaderValue(header, "descr", ',') != "'<f4'" ||
      HeaderValue(header, "fortran_order", ',') != "False" ||
      !ParseShape(HeaderValue(header, "shape", ')'), rows, columns)) {
    ThrowInputError("{}: expected a float32 array of two dimensions in C order", source);
  }
  // Read before allocating, so that a wrong shape cannot ask for more memory than the file has.
  std::ostringstream content;
  content << stream.rdbuf();
  const std::string data = std::move(content).str();
  const auto cells = static_cast<__int128>(rows) * columns;
  if (static_cast<__int128>(data.size()) != cells * static_cast<int>(sizeof(float))) {
    ThrowInputError("{}: {} bytes of data do not fit shape ({}, {})", source, data.size(), rows,
                    columns);
  }
  MatrixXfRow matrix(rows, columns);
  if (!data.empty()) std::memcpy(matrix.data(), data.data(), data.size());
  return matrix;
}

MatrixXfRow ReadNpy(const std::filesystem::path& path) {
  std::istringstream stream(ReadFile(path));
  return ReadNpy(stream, path.string());
}

}  // namespace s3lam
