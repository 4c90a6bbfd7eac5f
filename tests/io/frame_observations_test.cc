#include "s3lam/io/frame_observations.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <sstream>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

FrameObservations SomeFrames() {
  FrameObservations frames(3);
  frames[0] = {0.5, CameraId(1), {{PointId(7), {1.5F, 2.25F}, 1.2F}, {PointId(3), {8, 9}, 1}}};
  frames[1] = {0.625, CameraId(1), {}};
  frames[2] = {1e9 + 0.1, CameraId(4), {{PointId(1000000007), {100.5F, 0.5F}, 0.7F}}};
  return frames;
}

std::string Written(const FrameObservations& frames) {
  std::ostringstream stream;
  WriteFrameObservations(frames, stream);
  return stream.str();
}

void ExpectSame(const FrameObservations& a, const FrameObservations& b) {
  ASSERT_EQ(a.size(), b.size());
  for (size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].time_s, b[i].time_s);
    EXPECT_EQ(a[i].camera_id, b[i].camera_id);
    ASSERT_EQ(a[i].observations.size(), b[i].observations.size());
    for (size_t k = 0; k < a[i].observations.size(); ++k) {
      EXPECT_EQ(a[i].observations[k].point_id, b[i].observations[k].point_id);
      EXPECT_EQ(a[i].observations[k].xy, b[i].observations[k].xy);
      EXPECT_EQ(a[i].observations[k].sigma, b[i].observations[k].sigma);
    }
  }
}

TEST(FrameObservations, RoundTripIsExact) {
  std::istringstream stream(Written(SomeFrames()));
  ExpectSame(ReadFrameObservations(stream, "stream"), SomeFrames());
  const testing::TempDir dir;
  WriteFrameObservations(SomeFrames(), dir / "observations.bin");
  ExpectSame(ReadFrameObservations(dir / "observations.bin"), SomeFrames());
  std::istringstream empty(Written({}));
  EXPECT_TRUE(ReadFrameObservations(empty, "empty").empty());
}

TEST(FrameObservations, EveryTruncationIsAnError) {
  const std::string whole = Written(SomeFrames());
  for (size_t size = 0; size < whole.size(); ++size) {
    std::istringstream stream(whole.substr(0, size));
    EXPECT_THROW(ReadFrameObservations(stream, "cut"), InputError) << size;
  }
}

TEST(FrameObservations, DamageIsNamed) {
  const std::string whole = Written(SomeFrames());
  const auto expect_error = [](const std::string& bytes, const std::string& message) {
    std::istringstream stream(bytes);
    EXPECT_THAT([&] { ReadFrameObservations(stream, "file"); },
                ThrowsMessage<InputError>(HasSubstr(message)));
  };
  const auto with_double = [&](size_t place, double value) {
    std::string bytes = whole;
    std::memcpy(bytes.data() + place, &value, sizeof(value));
    return bytes;
  };
  const auto with_float = [&](size_t place, float value) {
    std::string bytes = whole;
    std::memcpy(bytes.data() + place, &value, sizeof(value));
    return bytes;
  };
  expect_error("X" + whole.substr(1), "file: not a file of frame observations");
  expect_error("S3OBSV00" + whole.substr(8), "version 00 is not known here (only 01)");
  expect_error(whole + "x", "1 bytes after");
  std::string claims = whole;
  claims.replace(8, 8, std::string(8, '\x7f'));
  expect_error(claims, "claims");
  const size_t first_frame = 16;
  const size_t second_frame = first_frame + 20 + 2 * 20;
  expect_error(with_double(second_frame, 0.5), "out of order");
  expect_error(with_double(first_frame, std::nan("")), "out of order");
  expect_error(with_float(first_frame + 20 + 8, std::nanf("")), "observation of point 7");
  expect_error(with_float(first_frame + 20 + 16, 0.0F), "sigma 0 px");
}

}  // namespace
}  // namespace s3lam
