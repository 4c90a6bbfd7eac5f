#include "s3lam/report/pipeline.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "report/report_fixture.h"
#include "s3lam/base/error.h"
#include "support/run_program.h"

namespace s3lam::report {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using testing::RunOnDisk;
using testing::SmallMap;
using ::testing::ThrowsMessage;

struct Made {
  Report report;
  Output output;
};

Made Make(const Input& input, const Options& options = {}) {
  Made made;
  made.report = Run(options, input, made.output);
  return made;
}

Input InputOf(const RunOnDisk& run) {
  return {ReadRunFolder(run.path()), testing::TrajectoryOf(SmallMap().truth), {}};
}

std::vector<std::string> FigureNames(const Output& output, const std::string& section) {
  std::vector<std::string> names;
  for (const Figure& figure : output.figures) {
    if (figure.section == section) names.push_back(figure.name);
  }
  return names;
}

/// The page by Python's parser: every element that is opened is closed, in order, nothing is loaded
/// from elsewhere, no id is there twice.
testing::ProgramResult CheckPage(const std::string& html) {
  const testing::TempDir directory;
  const fs::path page = directory.Write("page.html", html);
  const fs::path script = fs::path(S3LAM_TEST_SOURCE_DIR) / "tests" / "report" / "check_page.py";
  return testing::RunProgram({"python3", script.string(), page.string()});
}

TEST(ReportPipeline, WholeRunHasAllParts) {
  const RunOnDisk run;
  Input input = InputOf(run);
  input.image_directory = run.WriteImages();
  const Made made = Make(input);
  EXPECT_THAT(made.report.missing, IsEmpty());
  EXPECT_EQ(made.report.num_points, SmallMap().truth.points.size());
  EXPECT_THAT(FigureNames(made.output, "map"),
              ElementsAre("map_before_top", "map_plain_top", "map_planar_top", "map_before_oblique",
                          "map_plain_oblique", "map_planar_oblique", "map_before_side",
                          "map_plain_side", "map_planar_side"));
  EXPECT_EQ(FigureNames(made.output, "trajectory").size(), 7u);
  EXPECT_THAT(FigureNames(made.output, "residuals"),
              ElementsAre("reprojection_error", "plane_distance"));
  EXPECT_EQ(FigureNames(made.output, "keyframes").size(), SmallMap().truth.images.size());
  for (const char* part : {"<h2>Planes</h2>", "<h2>Timings</h2>", "everything", "1.250",
                           "<h2>Effective configuration</h2>", "Permission is hereby granted"}) {
    EXPECT_THAT(made.output.html, HasSubstr(part));
  }
}

// The last arm is the truth itself, the others are in error.
TEST(ReportPipeline, MeasuresTellTruthFromEstimate) {
  const RunOnDisk run;
  const Made made = Make(InputOf(run));
  const auto row = [&](const std::string& start) {
    for (const auto& cells : made.report.summary.rows) {
      if (cells[0].starts_with(start)) return cells;
    }
    return std::vector<std::string>(4, "0");
  };
  EXPECT_GT(std::stod(row("trajectory error")[1]), 1e-3);
  EXPECT_LT(std::stod(row("trajectory error")[3]), 1e-6);
  EXPECT_GT(std::stod(row("reprojection error")[1]), 2.0);
  EXPECT_NEAR(std::stod(row("reprojection error")[3]), 0.5 * std::sqrt(2.0), 0.05);  // Its noise.
  EXPECT_GT(std::stod(row("distance of")[1]), 1e-3);
  EXPECT_LT(std::stod(row("distance of")[3]), 1e-6);
}

TEST(ReportPipeline, PageIsValidAndLoadsNothing) {
  const RunOnDisk run;
  const auto checked = CheckPage(Make(InputOf(run)).output.html);
  EXPECT_EQ(checked.exit_code, 0) << checked.output;
}

TEST(ReportPipeline, SameInputSameBytes) {
  const RunOnDisk run;
  Input input = InputOf(run);
  input.image_directory = run.WriteImages();
  EXPECT_EQ(Make(input).output.html, Make(input).output.html);
}

TEST(ReportPipeline, HostileNamesStayText) {
  const RunOnDisk run;
  Input input = InputOf(run);
  const std::string hostile = "</script><script>alert(1)</script><!--\xFF\"'&";
  input.run.name = hostile;
  for (Arm& arm : input.run.arms) arm.title = hostile;
  for (SemanticClass& c : input.run.semantics->class_table.classes) c.name = hostile;
  for (StageRecord& stage : input.run.stages) stage.config["name"] = hostile;
  const std::string html = Make(input).output.html;
  EXPECT_THAT(html, Not(HasSubstr("<script>alert")));
  EXPECT_EQ(html.find('\xFF'), std::string::npos);
  const auto checked = CheckPage(html);
  EXPECT_EQ(checked.exit_code, 0) << checked.output;
}

TEST(ReportPipeline, ImageNamesThatAreNoUtf8) {
  const RunOnDisk run;
  Input input = InputOf(run);
  input.image_directory = run.WriteImages();
  auto& images = input.run.arms.back().model.images;
  Image& image = images.begin()->second;
  const std::string odd = "frame<\xFF>.png";
  fs::rename(input.image_directory / image.name, input.image_directory / odd);
  image.name = odd;
  const std::string html = Make(input).output.html;
  EXPECT_THAT(html, HasSubstr("frame&lt;\xEF\xBF\xBD&gt;.png"));
  EXPECT_EQ(CheckPage(html).exit_code, 0);
}

TEST(ReportPipeline, MissingPartsAreSaid) {
  const RunOnDisk run;
  fs::remove_all(run.path() / "1_slam");
  fs::remove_all(run.path() / "2_lift");
  fs::remove_all(run.path() / "3_refine_plain");
  const Made made = Make({ReadRunFolder(run.path()), {}, {}});
  for (const char* part : {"1_slam/", "2_lift/", "3_refine_plain/", "ground truth"}) {
    EXPECT_THAT(made.report.missing, ::testing::Contains(HasSubstr(part)));
    EXPECT_THAT(made.output.html, HasSubstr(part));
  }
  EXPECT_THAT(FigureNames(made.output, "trajectory"), IsEmpty());
  EXPECT_THAT(FigureNames(made.output, "keyframes"), IsEmpty());
  EXPECT_EQ(FigureNames(made.output, "map").size(), 3u);
  EXPECT_EQ(CheckPage(made.output.html).exit_code, 0);
}

TEST(ReportPipeline, RunOnAModelShowsTheModelBefore) {
  const RunOnDisk run;
  fs::rename(run.path() / "1_slam", run.path() / "2_lift" / "model_by_class");
  const RunFolder folder = ReadRunFolder(run.path());
  EXPECT_EQ(folder.arms.front().title, "input model");
  EXPECT_EQ(folder.arms.front().planes.size(), SmallMap().semantics.planes.size());
}

TEST(ReportPipeline, TruthOfAnotherTimeIsSaid) {
  const RunOnDisk run;
  Input input = InputOf(run);
  for (TimedPose& pose : input.truth) pose.time_s += 1000.0;
  const Made made = Make(input);
  EXPECT_THAT(made.report.missing, ::testing::Contains(HasSubstr("0 of 8 poses")));
  EXPECT_THAT(FigureNames(made.output, "trajectory"), IsEmpty());
}

// A switch of what is not there would make believe that it is.
TEST(ReportPipeline, TruthIsSwitchedOnlyWhereItIs) {
  const RunOnDisk run;
  Input input = InputOf(run);
  const std::string of_switch = "id=\"showTruth\"";
  EXPECT_THAT(Make(input).output.html, HasSubstr(of_switch));
  input.truth.clear();
  EXPECT_THAT(Make(input).output.html, Not(HasSubstr(of_switch)));
}

TEST(ReportPipeline, AskedImagesMustBeThere) {
  const RunOnDisk run;
  Input input = InputOf(run);
  input.image_directory = run.path() / "nowhere";
  EXPECT_THAT([&] { Make(input); }, ThrowsMessage<InputError>(HasSubstr("nowhere")));
  input.image_directory = run.WriteImages();
  const std::string name = SmallMap().truth.images.begin()->second.name;
  cv::imwrite((input.image_directory / name).string(), cv::Mat(10, 20, CV_8UC3));
  EXPECT_THAT([&] { Make(input); },
              ThrowsMessage<InputError>(AllOf(HasSubstr(name), HasSubstr("20 x 10"))));
  fs::remove(input.image_directory / name);
  EXPECT_THAT([&] { Make(input); }, ThrowsMessage<InputError>(HasSubstr(name)));
}

TEST(ReportPipeline, NoKeyframesOnRequest) {
  const RunOnDisk run;
  Input input = InputOf(run);
  input.image_directory = run.WriteImages();
  Options options;
  options.gallery_images = 0;
  EXPECT_THAT(FigureNames(Make(input, options).output, "keyframes"), IsEmpty());
  options.gallery_images = 3;
  EXPECT_EQ(FigureNames(Make(input, options).output, "keyframes").size(), 3u);
}

// The planar adjustment divides planes: the pieces have ids of their own.
TEST(ReportPipeline, PlanesThatOnlyRefinementKnows) {
  const RunOnDisk run;
  const fs::path path = run.path() / "3_refine" / "planes.json";
  nlohmann::json planes = ReadJson(path);
  planes["planes"][0]["id"] = 4000;
  WriteJson(path, planes);
  const Made made = Make(InputOf(run));
  EXPECT_THAT(made.output.html, HasSubstr("<td class=\"text\">4000</td>"));
  EXPECT_EQ(CheckPage(made.output.html).exit_code, 0);
}

TEST(RunFolder, EmptyAndAbsentFoldersAreRefused) {
  const testing::TempDir directory;
  EXPECT_THAT([&] { ReadRunFolder(directory.path()); },
              ThrowsMessage<InputError>(HasSubstr("no model")));
  EXPECT_THAT([&] { ReadRunFolder(directory / "absent"); },
              ThrowsMessage<InputError>(HasSubstr("absent")));
}

TEST(RunFolder, PlanesOfAnotherVersionAreRefusedByName) {
  const RunOnDisk run;
  const fs::path path = run.path() / "3_refine" / "planes.json";
  nlohmann::json document = ReadJson(path);
  document["version"] = 2;
  WriteJson(path, document);
  EXPECT_THAT([&] { ReadRunFolder(run.path()); },
              ThrowsMessage<InputError>(HasSubstr("planes.json: version 2 is not known here")));
}

TEST(RunFolder, DamagedPlanesAreNamed) {
  const RunOnDisk run;
  const fs::path path = run.path() / "3_refine" / "planes.json";
  nlohmann::json planes = ReadJson(path);
  const auto expect_refused = [&](const nlohmann::json& json,
                                  const char* reason = "planes.json: planes[") {
    WriteJson(path, json);
    EXPECT_THAT([&] { ReadRunFolder(run.path()); }, ThrowsMessage<InputError>(HasSubstr(reason)));
  };
  nlohmann::json spoiled = planes;
  spoiled["planes"][0].erase("offset");
  expect_refused(spoiled);
  spoiled = planes;
  spoiled["planes"][0]["normal_in_world"] = {1.0, 2.0};
  expect_refused(spoiled);
  spoiled["planes"][0]["normal_in_world"] = {1.0, 1.0, 0.0};
  expect_refused(spoiled, "not a unit vector");
  spoiled = planes;
  spoiled["planes"][0]["cluster_id"] = 4000;
  expect_refused(spoiled);
  expect_refused(nlohmann::json::object(), "planes.json: 'planes' is missing");
}

TEST(RunFolder, SemanticsOfAnotherModelAreRefused) {
  const RunOnDisk run;
  Reconstruction other = SmallMap().estimate;
  other.points.begin()->second.xyz.x() += 1.0;
  run.WriteModel("1_slam", other);
  EXPECT_THAT([&] { ReadRunFolder(run.path()); },
              ThrowsMessage<InputError>(HasSubstr("made from another model")));
  while (other.points.size() > 10) {
    for (const TrackElement& element : other.points.begin()->second.track) {
      other.images.at(element.image_id).points2D[element.point2D_index].point_id = kInvalidPointId;
    }
    other.points.erase(other.points.begin());
  }
  run.WriteModel("1_slam", other);
  EXPECT_THAT([&] { ReadRunFolder(run.path()); }, ThrowsMessage<InputError>(HasSubstr("2_lift")));
}

}  // namespace
}  // namespace s3lam::report
