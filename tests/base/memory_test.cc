#include "s3lam/base/memory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

namespace s3lam {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

TEST(Memory, WhatThereIsIsNotRefused) {
  EXPECT_GT(AvailableMemory(), 0u);
  EXPECT_NO_THROW(RequireMemory(1 << 20, "a little"));
}

TEST(Memory, WhatThereIsNotIsRefusedByName) {
  EXPECT_THAT([] { RequireMemory(1ULL << 60, "a table"); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("a table needs about 1099511627776 MiB"), HasSubstr("free"))));
}

}  // namespace
}  // namespace s3lam
