// Which model and which semantic map belong together.

#include <nlohmann/json.hpp>

#include "pipeline/model_fixture.h"

namespace s3lam {
namespace {

using testing::ExpectRefused;
using testing::kBadInput;
using testing::kDone;
using testing::ProgramResult;
using testing::RunTool;

class EvalSemantics : public testing::ModelTest {
 protected:
  [[nodiscard]] ProgramResult Evaluate(const std::filesystem::path& model) const {
    return RunTool("s3-eval",
                   {"--json", "--model", model.string(), "--semantics", semantics().string()});
  }

  void Refine(const std::vector<std::string>& arguments) const {
    std::vector<std::string> all = {"--output", output().string(), "--overwrite"};
    all.insert(all.end(), arguments.begin(), arguments.end());
    const ProgramResult result = RunTool("s3-refine", all);
    ASSERT_EQ(result.exit_code, kDone) << result.errors;
  }

  /// The model with the same ids and another place of its first point.
  void MoveAPoint() const {
    Reconstruction reconstruction = ReadColmapModel(model());
    reconstruction.points.begin()->second.xyz.x() += 0.01;
    WriteColmapModel(reconstruction, model());
  }
};

TEST_F(EvalSemantics, OfTheModelItself) {
  const ProgramResult result = Evaluate(model());
  ASSERT_EQ(result.exit_code, kDone) << result.errors;
  EXPECT_FALSE(nlohmann::json::parse(result.output)["cloud"]["planes"].empty());
}

TEST_F(EvalSemantics, OfTheModelBeforeItsRefinement) {
  Refine(RefineArguments());
  EXPECT_EQ(Evaluate(output()).exit_code, kDone);
  Refine({"--model", model().string()});  // Without planes.
  EXPECT_EQ(Evaluate(output()).exit_code, kDone);
}

TEST_F(EvalSemantics, OfAnotherModelIsRefused) {
  MoveAPoint();
  ExpectRefused(Evaluate(model()), kBadInput, {semantics().string(), "made from another model"});
  ExpectRefineRefused({semantics().string(), "made from another model"});
}

TEST_F(EvalSemantics, OfAnotherModelThanTheOneRefinedIsRefused) {
  MoveAPoint();
  Refine({"--model", model().string()});
  ExpectRefused(Evaluate(output()), kBadInput, {semantics().string(), "made from another model"});
}

TEST_F(EvalSemantics, AReportOfSomethingElseBesideTheModelDoesNotMatter) {
  for (const char* report : {"[1, 2]", R"({"input_model_fingerprint": 3})", "{}"}) {
    inputs_.Write("model/report.json", report);
    EXPECT_EQ(Evaluate(model()).exit_code, kDone) << report;
  }
}

}  // namespace
}  // namespace s3lam
