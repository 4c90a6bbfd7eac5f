#include "s3lam/base/sha256.h"

#include <gtest/gtest.h>

namespace s3lam {
namespace {

std::string HashOf(std::string_view text, size_t chunk) {
  Sha256 hash;
  for (size_t i = 0; i < text.size(); i += chunk) hash.Update(text.substr(i, chunk));
  return hash.Finish();
}

// The examples of FIPS 180.
TEST(Sha256, KnownHashes) {
  EXPECT_EQ(HashOf("", 1), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(HashOf("abc", 3), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  for (const size_t chunk : {1, 7, 56, 100}) {
    EXPECT_EQ(HashOf("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq", chunk),
              "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  }
  EXPECT_EQ(HashOf(std::string(1000000, 'a'), 999),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

}  // namespace
}  // namespace s3lam
