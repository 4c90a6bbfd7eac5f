// The command line and configurations, as all programs share them.

#include <nlohmann/json.hpp>

#include "pipeline/model_fixture.h"

namespace s3lam {
namespace {

using nlohmann::json;
using testing::ExpectRefused;
using ::testing::HasSubstr;
using testing::kBadInput;
using testing::kDone;
using testing::kWrongUsage;
using testing::RunTool;
using testing::TempDir;

class AnyProgram : public ::testing::TestWithParam<std::string> {};

TEST_P(AnyProgram, HelpTellsWhatItReadsAndWrites) {
  const auto result = RunTool(GetParam(), {"--help"});
  EXPECT_EQ(result.exit_code, kDone);
  for (const char* text : {"Reads", "Writes", "--config", "--set", "--threads", "--seed",
                           "--progress", "--overwrite", "--quiet", "Exit codes"}) {
    EXPECT_THAT(result.output, HasSubstr(text));
  }
}

TEST_P(AnyProgram, Version) {
  const auto result = RunTool(GetParam(), {"--version"});
  EXPECT_EQ(result.exit_code, kDone);
  EXPECT_THAT(result.output, ::testing::MatchesRegex(GetParam() + " [0-9]+\\.[0-9]+\\.[0-9]+\n"));
}

TEST_P(AnyProgram, UnknownOption) {
  ExpectRefused(RunTool(GetParam(), {"--no-such-option"}), kWrongUsage, {"no-such-option"});
}

TEST_P(AnyProgram, WordOfNoOption) {
  ExpectRefused(RunTool(GetParam(), {"clip.mp4"}), kWrongUsage, {"clip.mp4", "--help"});
}

TEST_P(AnyProgram, MissingArguments) {
  ExpectRefused(RunTool(GetParam(), {}), kWrongUsage, {"is required"});
}

TEST_P(AnyProgram, NegativeThreads) {
  ExpectRefused(RunTool(GetParam(), {"--threads", "-1"}), kWrongUsage, {"threads"});
}

TEST_P(AnyProgram, NegativeSeed) {
  ExpectRefused(RunTool(GetParam(), {"--seed", "-1"}), kWrongUsage, {"seed"});
}

TEST_P(AnyProgram, UnknownProgressStyle) {
  ExpectRefused(RunTool(GetParam(), {"--progress", "dots"}), kWrongUsage, {"dots"});
}

INSTANTIATE_TEST_SUITE_P(Programs, AnyProgram,
                         ::testing::Values("s3-slam", "s3-lift", "s3-refine", "s3-eval", "s3-synth",
                                           "s3-report"),
                         [](const auto& test) { return test.param.substr(3); });

class Configuration : public testing::ModelTest {
 protected:
  void ExpectConfigRefused(const std::vector<std::string>& arguments, int exit_code,
                           const std::vector<std::string>& parts) {
    std::vector<std::string> all = RefineArguments();
    all.insert(all.end(), arguments.begin(), arguments.end());
    ExpectRefusedWithoutTrace("s3-refine", all, exit_code, parts);
  }
};

TEST_F(Configuration, UnknownKeyNamesTheNearest) {
  const auto config = inputs_.Write("c.json", R"({"planes": {"mod": "off"}})");
  ExpectConfigRefused({"--config", config.string()}, kWrongUsage, {"c.json", "mod", "planes.mode"});
}

TEST_F(Configuration, UnknownKeyOfSet) {
  ExpectConfigRefused({"--set", "planes.mood=off"}, kWrongUsage, {"planes.mood", "planes.mode"});
}

TEST_F(Configuration, ValueOfWrongType) {
  ExpectConfigRefused({"--set", "solver.max_iterations=many"}, kWrongUsage,
                      {"solver.max_iterations"});
}

TEST_F(Configuration, ValueOutOfBounds) {
  ExpectConfigRefused({"--set", "keypoint_sigma_px=-1"}, kWrongUsage, {"keypoint_sigma_px"});
}

TEST_F(Configuration, UnknownMode) {
  ExpectConfigRefused({"--set", "planes.mode=sideways"}, kWrongUsage, {"planes.mode", "sideways"});
}

TEST_F(Configuration, MalformedFile) {
  const auto config = inputs_.Write("c.json", R"({"planes": )");
  ExpectConfigRefused({"--config", config.string()}, kBadInput, {"c.json"});
}

TEST_F(Configuration, MissingFile) {
  ExpectConfigRefused({"--config", "/nonexistent/c.json"}, kBadInput, {"/nonexistent/c.json"});
}

TEST_F(Configuration, EffectiveOneIsWrittenAndCanBeReadBack) {
  const auto config = inputs_.Write("c.json", R"({"solver": {"max_iterations": 3}})");
  std::vector<std::string> arguments = RefineArguments();
  arguments.insert(arguments.end(), {"--output", output().string(), "--config", config.string(),
                                     "--set", "planes.mode=off"});
  ASSERT_EQ(RunTool("s3-refine", arguments).exit_code, kDone);
  const std::string written = testing::FileBytes(output() / "config.json");
  EXPECT_EQ(json::parse(written)["solver"]["max_iterations"], 3);
  EXPECT_EQ(json::parse(written)["planes"]["mode"], "off");

  arguments = RefineArguments();
  arguments.insert(arguments.end(), {"--output", (inputs_ / "again").string(), "--config",
                                     (output() / "config.json").string()});
  ASSERT_EQ(RunTool("s3-refine", arguments).exit_code, kDone);
  EXPECT_EQ(testing::FileBytes(inputs_ / "again" / "config.json"), written);
}

TEST(EvalUsage, TrajectoryCutInTheMiddleOfALine) {
  const TempDir directory;
  const auto truth =
      directory.Write("truth.txt", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 1 1 0 0 0 0 1\n");
  const auto broken = directory.Write("broken.txt", "0 0 0 0 0 0 0 1\n1 1 0 0");
  ExpectRefused(
      RunTool("s3-eval", {"--estimate", broken.string(), "--ground-truth", truth.string()}),
      kBadInput, {"broken.txt", "2"});
}

TEST(EvalUsage, NothingInCommon) {
  const TempDir directory;
  const auto truth =
      directory.Write("truth.txt", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 1 1 0 0 0 0 1\n");
  const auto other =
      directory.Write("other.txt", "10 0 0 0 0 0 0 1\n11 1 0 0 0 0 0 1\n12 1 1 0 0 0 0 1\n");
  ExpectRefused(
      RunTool("s3-eval", {"--estimate", other.string(), "--ground-truth", truth.string()}),
      kBadInput, {"other.txt", "0 of 3"});
}

TEST(EvalUsage, ErrorsPerPoseReplaceNothingUnasked) {
  const TempDir directory;
  const std::string truth =
      directory.Write("truth.txt", "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 1 1 0 0 0 0 1\n").string();
  const std::filesystem::path errors = directory.Write("errors.csv", "precious");
  const auto run = [&](const std::vector<std::string>& more) {
    std::vector<std::string> arguments = {"--estimate", truth, "--ground-truth", truth};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return RunTool("s3-eval", arguments);
  };
  ExpectRefused(run({"--per-pose", errors.string()}), kBadInput, {"errors.csv", "--overwrite"});
  ExpectRefused(run({"--per-pose", errors.string(), "--overwrite", "--planes", "/nonexistent"}),
                kBadInput, {"/nonexistent"});
  ExpectRefused(run({"--per-pose", truth, "--overwrite"}), kWrongUsage, {"would remove"});
  EXPECT_EQ(testing::FileBytes(errors), "precious");
  EXPECT_THAT(testing::Listing(directory.path()),
              ::testing::ElementsAre("errors.csv", "truth.txt"));
  ASSERT_EQ(run({"--per-pose", errors.string(), "--overwrite"}).exit_code, kDone);
  EXPECT_THAT(testing::FileBytes(errors), ::testing::StartsWith("time_s,path,error"));
}

TEST(EvalUsage, MissingFile) {
  ExpectRefused(RunTool("s3-eval", {"--estimate", "/nonexistent/a.txt", "--ground-truth",
                                    "/nonexistent/b.txt"}),
                kBadInput, {"/nonexistent/a.txt"});
}

}  // namespace
}  // namespace s3lam
