// Runs that are interrupted and gone on with: the same bytes as without interruption.

#include <algorithm>
#include <array>
#include <chrono>
#include <thread>

#include "chain/chain_support.h"
#include "support/running_program.h"
#include "support/temp_dir.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;
using testing::ChainFolder;
using testing::FileBytes;
using ::testing::HasSubstr;
using testing::ProgramResult;
using testing::RunningProgram;
using testing::RunProgramApart;
using testing::TempDir;
using testing::Tool;

constexpr int kDone = 0;
constexpr int kWrongUsage = 2;
constexpr int kBadInput = 3;

class CheckpointTest : public ::testing::Test {
 protected:
  [[nodiscard]] fs::path output() const { return place_ / "place/out"; }
  [[nodiscard]] fs::path checkpoint() const { return place_ / "place/checkpoint"; }
  [[nodiscard]] fs::path errors() const { return place_ / "errors"; }

  /// The steps that are kept, in order.
  [[nodiscard]] std::vector<fs::path> Steps() const {
    std::vector<fs::path> steps;
    std::error_code gone;  // A program that ends removes the folder, even while it is read.
    for (fs::directory_iterator entry(checkpoint(), gone); !gone && entry != end(entry);
         entry.increment(gone)) {
      if (entry->path().extension() == ".step") steps.push_back(entry->path());
    }
    std::sort(steps.begin(), steps.end());
    return steps;
  }

  [[nodiscard]] std::vector<std::string> Refine(const std::vector<std::string>& more) const {
    std::vector<std::string> words = {Tool("s3-refine"), "--quiet",
                                      "--model",         ChainFolder("1_slam").string(),
                                      "--semantics",     ChainFolder("2_lift_noisy").string(),
                                      "--output",        output().string()};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  [[nodiscard]] std::vector<std::string> WithCheckpoint(std::vector<std::string> words) const {
    words.insert(words.end(), {"--checkpoint", checkpoint().string()});
    return words;
  }
  [[nodiscard]] std::vector<std::string> Resumed(std::vector<std::string> words) const {
    words = WithCheckpoint(std::move(words));
    words.emplace_back("--resume");
    return words;
  }

  /// Interrupts a run when it has kept one step, the next when it has kept two, and so on, each
  /// time in another way. Returns how often it was interrupted.
  int RunInPieces(const std::vector<std::string>& words) {
    constexpr std::array kSignals = {SIGINT, SIGKILL, SIGTERM};
    for (int interruptions = 0;; ++interruptions) {
      auto newest = Newest();
      const RunningProgram running(words, errors());
      for (int kept = 0; kept <= interruptions && !running.HasEnded();) {
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
        const auto now = Newest();
        kept += now == newest ? 0 : 1;
        newest = now;
      }
      const int signal = kSignals[static_cast<size_t>(interruptions) % kSignals.size()];
      running.Send(signal);
      const int code = running.Wait();
      if (code == kDone) {
        EXPECT_FALSE(fs::exists(checkpoint()));  // Not needed any more.
        return interruptions;
      }
      // Ended after putting the result in place, where signals are not watched for any more.
      if (fs::exists(output())) return interruptions;
      EXPECT_EQ(code, signal == SIGKILL ? -SIGKILL : 128 + signal) << FileBytes(errors());
      if (signal != SIGKILL) {
        EXPECT_THAT(FileBytes(errors()), HasSubstr("--resume"));
      }
      if (HasFailure()) return interruptions;
    }
  }

  /// A run that was interrupted after its first step.
  void Interrupt(const std::vector<std::string>& words) {
    const RunningProgram running(words, errors());
    while (Steps().empty()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    running.Send(SIGKILL);
    ASSERT_EQ(running.Wait(), -SIGKILL);
  }

  static void ExpectRefused(const std::vector<std::string>& words, int code,
                            const std::vector<std::string>& parts) {
    const ProgramResult result = RunProgramApart(words);
    EXPECT_EQ(result.exit_code, code) << result.errors;
    for (const std::string& part : parts) EXPECT_THAT(result.errors, HasSubstr(part));
  }

  /// Tells whether a step was kept meanwhile: how many there are, and when the last changed.
  [[nodiscard]] std::pair<size_t, fs::file_time_type> Newest() const {
    std::pair<size_t, fs::file_time_type> newest{0, fs::file_time_type::min()};
    for (const fs::path& step : Steps()) {
      std::error_code gone;
      const auto time = fs::last_write_time(step, gone);
      if (gone) continue;
      ++newest.first;
      newest.second = std::max(newest.second, time);
    }
    return newest;
  }

  TempDir place_;
};

TEST_F(CheckpointTest, RefineInPiecesGivesTheSameBytes) {
  EXPECT_GE(RunInPieces(Resumed(Refine({}))), 2);
  testing::ExpectSameBytes(ChainFolder("3_refine_noisy"), output());
}

TEST_F(CheckpointTest, SlamInPiecesGivesTheSameBytes) {
  // After every frame.
  const std::vector<std::string> words = {
      Tool("s3-slam"),  "--quiet",    "--checkpoint-every",          "0",
      "--database",     "--sequence", ChainFolder("scene").string(), "--output",
      output().string()};
  EXPECT_GE(RunInPieces(Resumed(words)), 5);
  testing::ExpectSameBytes(ChainFolder("1_slam"), output());
}

TEST_F(CheckpointTest, SlamWithUnknownCameraInPiecesGivesTheSameBytes) {
  std::vector<std::string> words = {Tool("s3-slam"),
                                    "--quiet",
                                    "--camera",
                                    "auto",
                                    "--frames",
                                    ":40",
                                    "--checkpoint-every",
                                    "0",
                                    "--sequence",
                                    ChainFolder("scene").string(),
                                    "--output"};
  const fs::path whole = place_ / "whole";
  const ProgramResult result = RunProgramApart([&] {
    std::vector<std::string> at_once = words;
    at_once.push_back(whole.string());
    return at_once;
  }());
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  words.push_back(output().string());
  EXPECT_GE(RunInPieces(Resumed(words)), 5);
  testing::ExpectSameBytes(whole, output());
}

TEST_F(CheckpointTest, OfChangedImagesIsRefused) {
  const fs::path scene = place_ / "scene";
  fs::copy(ChainFolder("scene"), scene, fs::copy_options::recursive);
  const std::vector<std::string> words = {Tool("s3-slam"), "--quiet",  "--sequence",
                                          scene.string(),  "--output", output().string()};
  Interrupt(WithCheckpoint(words));
  const fs::path image = scene / "rgb/frame-000003.jpg";  // Of the same size as before.
  std::string bytes = FileBytes(image);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
  place_.Write(fs::relative(image, place_.path()), bytes);
  ExpectRefused(Resumed(words), kBadInput, {checkpoint().string(), "inputs/images was"});
}

TEST_F(CheckpointTest, OfAnotherRunIsRefusedByName) {
  Interrupt(WithCheckpoint(Refine({})));
  const std::string folder = checkpoint().string();
  ExpectRefused(Resumed(Refine({"--set", "outer.max_iterations=7"})), kBadInput,
                {folder, "config/outer/max_iterations was 6 and is 7", "--overwrite"});
  const TempDir other;
  ExpectRefused(Resumed(Refine({"--constant", other.Write("c.json", "{}").string()})), kBadInput,
                {folder, "inputs/constant was nothing and is"});
  ExpectRefused(Resumed(Refine({"--seed", "2"})), kBadInput, {folder, "seed was 0 and is 2"});
  ExpectRefused(WithCheckpoint(Refine({})), kBadInput, {folder, "--resume", "--overwrite"});
  EXPECT_FALSE(fs::exists(output()));
  const ProgramResult anew = RunProgramApart(WithCheckpoint(Refine({"--overwrite"})));
  EXPECT_EQ(anew.exit_code, kDone) << anew.errors;
}

TEST_F(CheckpointTest, DamageIsFound) {
  Interrupt(WithCheckpoint(Refine({})));
  const fs::path step = Steps().front();
  const std::string whole = FileBytes(step);
  std::string changed = whole;
  changed[whole.size() / 2] = static_cast<char>(changed[whole.size() / 2] ^ 1);
  for (const std::string& bytes :
       {changed, whole.substr(0, whole.size() - 1), whole.substr(0, 5)}) {
    place_.Write(fs::relative(step, place_.path()), bytes);
    ExpectRefused(Resumed(Refine({})), kBadInput, {step.string(), "damaged"});
  }
  place_.Write("place/checkpoint/checkpoint.json", "{}");
  ExpectRefused(Resumed(Refine({})), kBadInput, {"checkpoint.json", "not of a checkpoint"});
}

TEST_F(CheckpointTest, FoldersOfOthersAreLeftAlone) {
  place_.Write("place/checkpoint/letter.txt", "mine");
  ExpectRefused(WithCheckpoint(Refine({"--overwrite"})), kBadInput,
                {checkpoint().string(), "neither empty nor a checkpoint"});
  EXPECT_EQ(FileBytes(checkpoint() / "letter.txt"), "mine");
  fs::remove(checkpoint() / "letter.txt");
  place_.Write("place/checkpoint/.out.tmp-AbCdEf/model", "of another run");
  ExpectRefused(WithCheckpoint(Refine({"--overwrite"})), kBadInput, {"neither empty nor"});
  EXPECT_EQ(FileBytes(checkpoint() / ".out.tmp-AbCdEf/model"), "of another run");
  fs::remove_all(checkpoint() / ".out.tmp-AbCdEf");
  ExpectRefused(Refine({"--resume"}), kWrongUsage, {"--checkpoint"});
}

}  // namespace
}  // namespace s3lam
