// What signals do to a run: the output is the old one or the whole new one, and nothing lies about.

#include <sys/stat.h>

#include <chrono>
#include <thread>

#include "pipeline/model_fixture.h"
#include "support/running_program.h"

namespace s3lam {
namespace {

using testing::kDone;
using testing::Listing;
using testing::ProgramResult;
using testing::RunningProgram;
using testing::TempDir;

constexpr auto kPoll = std::chrono::milliseconds(5);

class Signals : public ::testing::Test {
 protected:
  /// A run that takes long, under way: its folder beside the output is there.
  [[nodiscard]] RunningProgram Start() const {
    const std::filesystem::path program = std::filesystem::path(S3LAM_TEST_BIN_DIR) / "s3-synth";
    RunningProgram running({program.string(), "--quiet", "--scene", "room", "--threads", "2",
                            "--output", (place_ / "place/out").string(), "--overwrite"},
                           errors());
    while (Staging().empty()) std::this_thread::sleep_for(kPoll);
    return running;
  }
  /// The names of unfinished outputs.
  [[nodiscard]] std::vector<std::string> Staging() const {
    std::vector<std::string> names = Listing(place_ / "place");
    std::erase_if(names, [](const std::string& name) { return !name.starts_with(".out.tmp-"); });
    return names;
  }
  [[nodiscard]] std::filesystem::path errors() const { return place_ / "errors"; }
  void SetUp() override { place_.Write("place/out/old.txt", "old"); }
  TempDir place_;
};

TEST_F(Signals, InterruptKeepsTheOldOutputAndLeavesNothing) {
  for (const auto& [signal, code] : {std::pair(SIGINT, 130), std::pair(SIGTERM, 143)}) {
    const RunningProgram running = Start();
    running.Send(signal);
    EXPECT_EQ(running.Wait(), code);
    EXPECT_THAT(testing::FileBytes(errors()), ::testing::StartsWith("s3-synth: ended by SIG"));
    EXPECT_THAT(Listing(place_ / "place"), ::testing::ElementsAre("out"));
    EXPECT_THAT(Listing(place_ / "place/out"), ::testing::ElementsAre("old.txt"));
  }
}

TEST_F(Signals, UserSignalTellsTheProgress) {
  const RunningProgram running = Start();
  running.Send(SIGUSR1);
  while (testing::FileBytes(errors()).find('\n') == std::string::npos) {
    std::this_thread::sleep_for(kPoll);
  }
  EXPECT_THAT(testing::FileBytes(errors()), ::testing::StartsWith("s3-synth: "));
  running.Send(SIGTERM);
  EXPECT_EQ(running.Wait(), 143);
}

TEST_F(Signals, NextRunRemovesWhatAKilledOneLeft) {
  const RunningProgram running = Start();
  running.Send(SIGKILL);
  EXPECT_EQ(running.Wait(), -SIGKILL);
  EXPECT_EQ(Staging().size(), 1u);
  EXPECT_THAT(Listing(place_ / "place/out"), ::testing::ElementsAre("old.txt"));

  const ProgramResult result =
      testing::RunTool("s3-synth", {"--scene", "posters", "--frames", "2", "--output",
                                    (place_ / "place/out").string(), "--overwrite"});
  EXPECT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_THAT(Listing(place_ / "place"), ::testing::ElementsAre("out"));
  EXPECT_THAT(Listing(place_ / "place/out"), ::testing::Contains("groundtruth.txt"));
}

TEST_F(Signals, ARunThatGoesOnIsLeftAlone) {
  const RunningProgram running = Start();
  const ProgramResult result =
      testing::RunTool("s3-synth", {"--scene", "posters", "--frames", "2", "--output",
                                    (place_ / "place/out").string(), "--overwrite"});
  EXPECT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_EQ(Staging().size(), 1u);
  running.Send(SIGINT);
  EXPECT_EQ(running.Wait(), 130);
  EXPECT_THAT(Listing(place_ / "place/out"), ::testing::Contains("groundtruth.txt"));
}

class SignalsOfReport : public testing::ModelTest {};

TEST_F(SignalsOfReport, InterruptLeavesNoPartOfThePage) {
  const TempDir place;
  std::filesystem::create_directories(inputs_ / "run");
  std::filesystem::create_directory_symlink(model(), inputs_ / "run/1_slam");
  std::filesystem::create_directory(place / "page");
  const std::filesystem::path never_there = inputs_ / "truth.txt";
  ASSERT_EQ(mkfifo(never_there.c_str(), 0600), 0);  // It waits for somebody to write into it.
  const std::filesystem::path program = std::filesystem::path(S3LAM_TEST_BIN_DIR) / "s3-report";
  const RunningProgram running(
      {program.string(), "--quiet", "--run", (inputs_ / "run").string(), "--ground-truth",
       never_there.string(), "--output", (place / "page/report.html").string()},
      place / "errors");
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (Listing(place / "page").empty()) {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline) << testing::FileBytes(place / "errors");
    std::this_thread::sleep_for(kPoll);
  }
  running.Send(SIGINT);
  EXPECT_EQ(running.Wait(), 130);
  EXPECT_THAT(testing::FileBytes(place / "errors"), ::testing::HasSubstr("no partial output"));
  EXPECT_THAT(Listing(place / "page"), ::testing::IsEmpty());
}

}  // namespace
}  // namespace s3lam
