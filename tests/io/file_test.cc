#include "s3lam/io/file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <ostream>

#include "s3lam/base/error.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

using testing::FileBytes;
using ::testing::HasSubstr;
using testing::TempDir;
using ::testing::ThrowsMessage;

TEST(File, BytesComeBack) {
  const TempDir dir;
  const std::string bytes("a\0b\r\n\xff", 6);
  WriteFile(dir / "file", [&](std::ostream& stream) { stream << bytes; });
  EXPECT_EQ(ReadFile(dir / "file"), bytes);
}

TEST(File, WhatCannotBeReadIsNamed) {
  const TempDir dir;
  EXPECT_THAT([&] { ReadFile(dir / "absent"); }, ThrowsMessage<InputError>(HasSubstr("absent")));
  EXPECT_THAT([&] { ReadFile(dir.path()); }, ThrowsMessage<InputError>(HasSubstr("directory")));
}

TEST(File, WhatCannotBeWrittenIsNamed) {
  const TempDir dir;
  const auto write = [](std::ostream& stream) { stream << std::string(1 << 20, 'x'); };
  EXPECT_THAT([&] { WriteFile(dir / "absent/file", write); },
              ThrowsMessage<std::runtime_error>(HasSubstr("absent/file")));
  if (std::filesystem::exists("/dev/full")) {  // A disk without space.
    EXPECT_THAT([&] { WriteFile("/dev/full", write); },
                ThrowsMessage<std::runtime_error>(HasSubstr("/dev/full")));
  }
}

TEST(Json, RoundTripAndFaults) {
  const TempDir dir;
  const nlohmann::json json = {{"a", 0.1}, {"b", {1, 2}}};
  WriteJson(dir / "file.json", json);
  EXPECT_EQ(ReadJson(dir / "file.json"), json);
  EXPECT_THAT(FileBytes(dir / "file.json"), ::testing::EndsWith("}\n"));
  EXPECT_THAT([&] { ReadJson(dir.Write("bad.json", "{\"a\": }")); },
              ThrowsMessage<InputError>(HasSubstr("bad.json: not valid JSON near byte 7")));
}

TEST(Json, NamesThatAreNotUtf8CanBeWritten) {
  const TempDir dir;
  WriteJson(dir / "file.json", {{"name", "caf\xe9.png"}});
  EXPECT_EQ(ReadJson(dir / "file.json")["name"], "caf\xef\xbf\xbd.png");
}

}  // namespace
}  // namespace s3lam
