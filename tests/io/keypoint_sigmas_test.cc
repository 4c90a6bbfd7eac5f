#include "s3lam/io/keypoint_sigmas.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <sstream>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

KeypointSigmas SomeSigmas() {
  return {{ImageId(2), {0.4F, 1.2F, 0.48F}}, {ImageId(5), {}}, {ImageId(9), {2.0F}}};
}

std::string Written(const KeypointSigmas& sigmas) {
  std::ostringstream stream;
  WriteKeypointSigmas(sigmas, stream);
  return stream.str();
}

void ExpectError(const std::string& bytes, const std::string& message) {
  std::istringstream stream(bytes);
  EXPECT_THAT([&] { ReadKeypointSigmas(stream, "file"); },
              ThrowsMessage<InputError>(HasSubstr(message)));
}

TEST(KeypointSigmas, RoundTripIsExact) {
  std::istringstream stream(Written(SomeSigmas()));
  EXPECT_EQ(ReadKeypointSigmas(stream, "stream"), SomeSigmas());
  const testing::TempDir dir;
  WriteKeypointSigmas(SomeSigmas(), dir / "keypoint_sigmas.bin");
  EXPECT_EQ(ReadKeypointSigmas(dir / "keypoint_sigmas.bin"), SomeSigmas());
}

TEST(KeypointSigmas, EveryTruncationIsAnError) {
  const std::string whole = Written(SomeSigmas());
  for (size_t size = 0; size < whole.size(); ++size) {
    std::istringstream stream(whole.substr(0, size));
    EXPECT_THROW(ReadKeypointSigmas(stream, "cut"), InputError) << size;
  }
}

TEST(KeypointSigmas, DamageIsNamed) {
  const std::string whole = Written(SomeSigmas());
  ExpectError("S3OBSV01" + whole.substr(8), "not a file of keypoint sigmas");
  ExpectError("S3KSIG02" + whole.substr(8), "version 02 is not known here (only 01)");
  ExpectError(whole + "x", "file");
  std::string damaged = whole;
  damaged[16] = 7;  // The first image's id.
  ExpectError(damaged, "image id 5 is out of order");
  for (const float wrong : {0.0F, -1.0F, std::numeric_limits<float>::infinity()}) {
    damaged = whole;
    std::memcpy(damaged.data() + 28, &wrong, sizeof(wrong));
    ExpectError(damaged, "a keypoint of image 2 with sigma");
  }
}

TEST(KeypointSigmas, TheModelMustHaveAsManyKeypoints) {
  Reconstruction model;
  for (const auto& [id, sigmas] : SomeSigmas()) {
    Image& image = model.images[id];
    image.id = id;
    image.name = "image" + std::to_string(id.value());
    image.points2D.resize(sigmas.size());
  }
  EXPECT_NO_THROW(CheckKeypointSigmas(SomeSigmas(), model, "file"));
  KeypointSigmas fewer = SomeSigmas();
  fewer[ImageId(2)].pop_back();
  EXPECT_THAT([&] { CheckKeypointSigmas(fewer, model, "file"); },
              ThrowsMessage<InputError>(HasSubstr("2 sigmas for the 3 keypoints of image image2")));
  fewer.erase(ImageId(2));
  EXPECT_THROW(CheckKeypointSigmas(fewer, model, "file"), InputError);
}

}  // namespace
}  // namespace s3lam
