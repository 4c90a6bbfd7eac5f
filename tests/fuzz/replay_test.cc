// The fuzz targets without a fuzzer: every seed and every past finding as it is, cut at every byte,
// and with bytes changed, taken out and put in at random places. Needs no clang, so it always runs.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <limits>

#include "fuzz/targets.h"
#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;
using fuzz::Target;
using testing::FileBytes;

std::vector<std::string> Inputs(std::string_view target) {
  std::vector<fs::path> paths;
  for (const fs::path& root :
       {fs::path(S3LAM_TEST_FUZZ_SEEDS), fs::path(S3LAM_TEST_SOURCE_DIR) / "tests/fuzz/findings"}) {
    if (!fs::is_directory(root / target)) continue;
    for (const auto& entry : fs::directory_iterator(root / target)) paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> inputs;
  for (const fs::path& path : paths) inputs.push_back(FileBytes(path));
  return inputs;
}

std::string Mutated(std::string bytes, Rng& rng) {
  const size_t count = 1 + rng.Below(4);
  for (size_t i = 0; i < count && !bytes.empty(); ++i) {
    const auto at = static_cast<std::ptrdiff_t>(rng.Below(bytes.size()));
    const auto value = static_cast<char>(rng.Below(4) == 0 ? 0xff : rng.Bits());
    switch (rng.Below(3)) {
      case 0:
        bytes[static_cast<size_t>(at)] = value;
        break;
      case 1:
        bytes.erase(bytes.begin() + at);
        break;
      default:
        bytes.insert(bytes.begin() + at, value);
    }
  }
  return bytes;
}

class FuzzTarget : public ::testing::TestWithParam<Target> {};

TEST_P(FuzzTarget, SeedsAreAccepted) {
  const auto inputs = Inputs(GetParam().name);
  ASSERT_FALSE(inputs.empty());
  size_t num_accepted = 0;
  for (const std::string& input : inputs) {
    try {
      GetParam().run(input);
      ++num_accepted;
    } catch (const InputError&) {  // Seeds of what is refused, and findings.
    } catch (const UsageError&) {
    }
  }
  EXPECT_GE(num_accepted, 1u);
}

TEST_P(FuzzTarget, EveryTruncationIsReadOrRefused) {
  constexpr size_t kMaxCuts = 600;
  for (const std::string& input : Inputs(GetParam().name)) {
    const size_t step = 1 + input.size() / kMaxCuts;
    for (size_t size = 0; size < input.size(); size += step) {
      EXPECT_NO_THROW(fuzz::RunInput(GetParam(), input.substr(0, size))) << "cut to " << size;
    }
  }
}

TEST_P(FuzzTarget, RandomChangesAreReadOrRefused) {
  constexpr int kNumChanges = 300;
  Rng rng(1);
  for (const std::string& input : Inputs(GetParam().name)) {
    for (int i = 0; i < kNumChanges; ++i) {
      EXPECT_NO_THROW(fuzz::RunInput(GetParam(), Mutated(input, rng)));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Targets, FuzzTarget,
                         ::testing::ValuesIn(fuzz::Targets().begin(), fuzz::Targets().end()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace s3lam
