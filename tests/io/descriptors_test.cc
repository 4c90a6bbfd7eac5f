#include "s3lam/io/descriptors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

PointDescriptors SomeDescriptors() {
  Rng rng(5);
  PointDescriptors descriptors;
  for (uint64_t i = 0; i < 5; ++i) {
    for (uint8_t& byte : descriptors[PointId(3 + 1000000007 * i)]) {
      byte = static_cast<uint8_t>(rng.Below(256));
    }
  }
  return descriptors;
}

std::string Written(const PointDescriptors& descriptors) {
  std::ostringstream stream;
  WriteDescriptors(descriptors, stream);
  return stream.str();
}

TEST(Descriptors, RoundTripIsExact) {
  const PointDescriptors descriptors = SomeDescriptors();
  std::istringstream stream(Written(descriptors));
  EXPECT_EQ(ReadDescriptors(stream, "stream"), descriptors);
  const testing::TempDir dir;
  WriteDescriptors(descriptors, dir / "descriptors.bin");
  EXPECT_EQ(ReadDescriptors(dir / "descriptors.bin"), descriptors);
  std::istringstream empty(Written({}));
  EXPECT_TRUE(ReadDescriptors(empty, "empty").empty());
}

TEST(Descriptors, EveryTruncationIsAnError) {
  const std::string whole = Written(SomeDescriptors());
  for (size_t size = 0; size < whole.size(); ++size) {
    std::istringstream stream(whole.substr(0, size));
    EXPECT_THROW(ReadDescriptors(stream, "cut"), InputError) << size;
  }
}

TEST(Descriptors, DamageIsNamed) {
  const std::string whole = Written(SomeDescriptors());
  const auto expect_error = [](const std::string& bytes, const std::string& message) {
    std::istringstream stream(bytes);
    EXPECT_THAT([&] { ReadDescriptors(stream, "file"); },
                ThrowsMessage<InputError>(HasSubstr(message)));
  };
  expect_error("X" + whole.substr(1), "file: not a file of point descriptors");
  expect_error(whole + "x", "1 bytes after");
  std::string claims = whole;
  claims.replace(8, 8, std::string(8, '\x7f'));
  expect_error(claims, "claims");
  std::string repeated = whole;
  repeated.replace(16 + 40, 8, whole.substr(16, 8));  // The second id becomes the first.
  expect_error(repeated, "out of order");
}

}  // namespace
}  // namespace s3lam
