#include "s3lam/io/npy.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>
#include <string>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

std::string Encode(const MatrixXfRow& matrix) {
  std::ostringstream stream;
  WriteNpy(matrix, stream);
  return stream.str();
}

MatrixXfRow Decode(const std::string& bytes) {
  std::istringstream stream(bytes);
  return ReadNpy(stream, "a.npy");
}

TEST(Npy, RoundTrip) {
  MatrixXfRow matrix(2, 3);
  matrix << 1.0F, -2.5F, 3e-30F, 4.0F, 5.0F, 6.0F;
  EXPECT_EQ(Decode(Encode(matrix)), matrix);
  EXPECT_EQ(Decode(Encode(MatrixXfRow(0, 5))).cols(), 5);
}

TEST(Npy, HasNumPysLayout) {
  const std::string bytes = Encode(MatrixXfRow::Zero(2, 3));
  EXPECT_EQ(bytes.substr(0, 8), std::string("\x93NUMPY\x01\0", 8));
  EXPECT_EQ((bytes.size() - 6 * sizeof(float)) % 64, 0U);
  EXPECT_EQ(bytes[bytes.size() - 6 * sizeof(float) - 1], '\n');
  EXPECT_THAT(bytes,
              ::testing::HasSubstr("{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }"));
}

TEST(Npy, RefusesWhatDoesNotFit) {
  const std::string bytes = Encode(MatrixXfRow::Zero(2, 3));
  for (size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_THROW(Decode(bytes.substr(0, size)), InputError) << size;
  }
  EXPECT_THROW(Decode(bytes + "x"), InputError);
  const auto with = [&](const std::string& from, const std::string& to) {
    std::string changed = bytes;
    changed.replace(changed.find(from), from.size(), to);
    return changed;
  };
  EXPECT_THROW(Decode(with("<f4", "<f8")), InputError);
  EXPECT_THROW(Decode(with("False", "True ")), InputError);
  EXPECT_THROW(Decode(with("(2, 3)", "(6,)  ")), InputError);
  EXPECT_THROW(Decode(with("(2, 3)", "(2, 4)")), InputError);
  EXPECT_THROW(Decode(with("(2, 3)", "(-2,3)")), InputError);
  EXPECT_THROW(Decode(with("(2, 3), }", "(4611686018427387904, 4), }")), InputError);
}

}  // namespace
}  // namespace s3lam
