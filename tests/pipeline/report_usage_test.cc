// s3-report as a user runs it.

#include "pipeline/model_fixture.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;
using testing::ExpectRefused;
using ::testing::HasSubstr;
using testing::kBadInput;
using testing::kDone;
using testing::kWrongUsage;
using testing::RunTool;

class ReportUsage : public testing::ModelTest {
 protected:
  ReportUsage() {
    fs::create_directories(run());
    fs::create_directory_symlink(model(), run() / "1_slam");
    fs::create_directory_symlink(semantics(), run() / "2_lift");
  }
  [[nodiscard]] fs::path run() const { return inputs_ / "run"; }
  void ExpectReportRefused(std::vector<std::string> arguments,
                           const std::vector<std::string>& parts) {
    arguments.insert(arguments.end(), {"--run", run().string()});
    ExpectRefusedWithoutTrace("s3-report", arguments, kBadInput, parts);
  }
};

TEST_F(ReportUsage, WritesOneFileAndPictures) {
  const auto result = RunTool(
      "s3-report", {"--run", run().string(), "--output", (inputs_ / "out/report.html").string(),
                    "--png", (inputs_ / "pictures").string(), "--json"});
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_THAT(result.output, HasSubstr("\"missing\""));
  EXPECT_EQ(testing::Listing(inputs_ / "out"), std::vector<std::string>{"report.html"});
  EXPECT_THAT(testing::Listing(inputs_ / "pictures"),
              ::testing::IsSupersetOf({"map_before_top.png", "reprojection_error.png"}));
  // The same once more, by another number of threads: refused, then the same bytes.
  const std::vector<std::string> again = {"--run", run().string(), "--output",
                                          (inputs_ / "out/report.html").string()};
  ExpectRefused(RunTool("s3-report", again), kBadInput, {"report.html", "--overwrite"});
  const std::string before = testing::FileBytes(inputs_ / "out/report.html");
  std::vector<std::string> overwrite = again;
  overwrite.insert(overwrite.end(), {"--overwrite", "--threads", "1"});
  ASSERT_EQ(RunTool("s3-report", overwrite).exit_code, kDone);
  EXPECT_EQ(testing::FileBytes(inputs_ / "out/report.html"), before);
}

TEST_F(ReportUsage, NeedsSomethingToWrite) {
  ExpectRefused(RunTool("s3-report", {"--run", run().string()}), kWrongUsage,
                {"--output", "--png"});
}

TEST_F(ReportUsage, PicturesDoNotReplaceWhatIsRead) {
  fs::create_directories(inputs_ / "run/images");
  for (const fs::path& pictures : {inputs_.path(), run()}) {
    ExpectRefused(
        RunTool("s3-report", {"--run", run().string(), "--png", pictures.string(), "--overwrite"}),
        kWrongUsage, {"would remove --run"});
  }
  ExpectRefused(
      RunTool("s3-report", {"--run", model().string(), "--images", (run() / "images").string(),
                            "--png", run().string(), "--overwrite"}),
      kWrongUsage, {"would remove --images"});
  EXPECT_THAT(testing::Listing(run()), ::testing::ElementsAre("1_slam", "2_lift", "images"));
}

TEST_F(ReportUsage, EmptyRun) {
  fs::remove(run() / "1_slam");
  fs::remove(run() / "2_lift");
  ExpectReportRefused({}, {run().string(), "no model"});
}

TEST_F(ReportUsage, AbsentRun) {
  fs::remove_all(run());
  ExpectReportRefused({}, {run().string(), "no such folder"});
}

TEST_F(ReportUsage, DamagedModel) {
  Truncate(model() / "images.bin", 0.5);
  ExpectReportRefused({}, {"images.bin"});
}

TEST_F(ReportUsage, DamagedSemantics) {
  Truncate(semantics() / "semantics.json", 0.5);
  ExpectReportRefused({}, {"semantics.json"});
}

TEST_F(ReportUsage, DamagedReport) {
  inputs_.Write("model/report.json", "[1, 2]");
  ExpectReportRefused({}, {"report.json", "object"});
}

TEST_F(ReportUsage, DamagedGroundTruth) {
  const auto truth = inputs_.Write("truth.txt", "0 0 0 0 0 0 0 1\n1 1 0");
  ExpectReportRefused({"--ground-truth", truth.string()}, {"truth.txt", "2"});
}

TEST_F(ReportUsage, AbsentImages) {
  ExpectReportRefused({"--images", "/nonexistent/images"}, {"/nonexistent/images"});
}

}  // namespace
}  // namespace s3lam
