#include "s3lam/io/npy.h"

#include <bit>
#include <cstdint>
#include <cstring>
#include <istream>
#include <ostream>
#include <sstream>
#include <string>

#include "npy_array.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace {

static_assert(std::endian::native == std::endian::little, "arrays are written as they lie");

constexpr std::string_view kMagic("\x93NUMPY\x01\x00", 8);
constexpr size_t kAlignment = 64;  // Of the data, by the format's definition.

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
  // Read before allocating, so that a wrong shape cannot ask for more memory than the file has.
  const NpyArray array = ParseNpy(ReadStream(stream, source), source);
  if (array.type != "f4" || array.shape.size() != 2) {
    ThrowInputError("{}: expected a float32 array of two dimensions", source);
  }
  MatrixXfRow matrix(array.shape[0], array.shape[1]);
  if (matrix.size() > 0) {
    std::memcpy(matrix.data(), array.data(), sizeof(float) * static_cast<size_t>(matrix.size()));
  }
  return matrix;
}

MatrixXfRow ReadNpy(const std::filesystem::path& path) {
  std::istringstream stream(ReadFile(path));
  return ReadNpy(stream, path.string());
}

}  // namespace s3lam
