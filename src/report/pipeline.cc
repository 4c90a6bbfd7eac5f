#include "s3lam/report/pipeline.h"

#include <fmt/format.h>

#include <algorithm>

#include "s3lam/base/options_json.h"
#include "s3lam/report/figures.h"
#include "s3lam/report/frame_trust.h"
#include "s3lam/report/page.h"
#include "s3lam/report/tables.h"
#include "s3lam/report/viewer_data.h"

namespace s3lam::report {
namespace {

Measures Measure(const Options& options, const RunFolder& run, const Trajectory& truth) {
  TrajectoryErrorOptions trajectory;
  trajectory.align = options.align;
  trajectory.max_dt_s = options.max_dt_s;
  Measures measures;
  measures.frame = MakeCommonFrame(run, truth, trajectory);
  measures.reprojection_px = CommonReprojectionErrors(run.arms);
  if (run.semantics) measures.planes = MeasurePlaneDistances(run.arms, *run.semantics);
  measures.plane_distances.resize(run.arms.size());
  for (const PlaneDistances& plane : measures.planes) {
    for (size_t k = 0; k < run.arms.size(); ++k) {
      for (const double distance : plane.distances[k]) {
        measures.plane_distances[k].push_back(measures.frame.view_from_arm[k].scale * distance);
      }
    }
  }
  return measures;
}

/// An arm that has no planes of its own is shown with those fitted to its points.
void GivePlanes(const std::vector<PlaneDistances>& measured, RunFolder& run) {
  for (size_t k = 0; k < run.arms.size(); ++k) {
    if (!run.arms[k].planes.empty() || run.arms[k].key == "planar") continue;
    for (const PlaneDistances& plane : measured) run.arms[k].planes.push_back(plane.fitted[k]);
  }
}

std::vector<Figure> MakeFigures(const Options& options, const Input& input, const RunFolder& run,
                                const Measures& measures, const FrameTrust& trust,
                                std::vector<std::string>& missing) {
  std::vector<Figure> figures;
  AddTrustFigure(trust, figures);
  AddMapFigures(options, run, measures, figures);
  AddTrajectoryFigures(run, measures, figures);
  AddResidualFigures(options, run, measures, figures);
  AddKeyframeFigures(options, run, input.image_directory, figures, missing);
  return figures;
}

std::vector<std::pair<std::string, nlohmann::json>> Configurations(const Options& options,
                                                                   const RunFolder& run) {
  std::vector<std::pair<std::string, nlohmann::json>> configurations;
  for (const StageRecord& stage : run.stages) {
    if (!stage.config.is_null()) configurations.emplace_back(stage.folder, stage.config);
  }
  configurations.emplace_back("this report", OptionsToJson(options));
  return configurations;
}

}  // namespace

void Options::Visit(OptionVisitor& v) {
  v.Choice("align", align, kTrajectoryAlignmentNames, "what is aligned to the ground truth first");
  v.Value("max_dt_s", max_dt_s, "largest time difference of associated poses [s]", 0.0, 1e9);
  v.Value("histogram_bins", histogram_bins, "bins of a histogram", 2, 1000);
  v.Value("view_width", view_width, "width of the views of the map [px]", 50, 10000);
  v.Value("gallery_images", gallery_images, "keyframes shown, evenly spread; 0: none", 0, 10000);
  v.Value("gallery_width", gallery_width, "width of the keyframes shown [px]", 16, 10000);
  v.Value("jpeg_quality", jpeg_quality, "of the keyframes in the page", 1, 100);
}

Report Run(const Options& options, const Input& input, Output& output) {
  RunFolder run = input.run;
  const Measures measures = Measure(options, run, input.truth);
  GivePlanes(measures.planes, run);
  const FrameTrust trust = ReadFrameTrust(run);
  Report report;
  report.doubts = DescribeDoubts(run, trust);
  report.missing = run.missing;
  if (input.truth.empty()) {
    report.missing.emplace_back("No ground truth was given: no errors of trajectories.");
  }
  if (!measures.frame.note.empty()) report.missing.push_back(measures.frame.note);
  report.summary = SummaryTable(run, measures);

  PageContent page;
  page.title = "S3LAM: " + run.name;
  page.figures = MakeFigures(options, input, run, measures, trust, report.missing);
  page.doubts = report.doubts;
  page.missing = report.missing;
  page.summary = report.summary;
  page.viewer = MakeViewerData(run, measures.frame, trust);
  page.tables = {PlaneTable(run, measures), RelationTable(run), TimingTable(run)};
  page.configurations = Configurations(options, run);
  page.jpeg_quality = options.jpeg_quality;
  report.num_points = page.viewer.num_points;
  report.num_figures = page.figures.size();
  output.html = MakePage(page);
  output.figures = std::move(page.figures);
  return report;
}

nlohmann::json ToJson(const Report& report) {
  nlohmann::json summary = nlohmann::json::object();
  for (const auto& row : report.summary.rows) {
    for (size_t k = 1; k < row.size(); ++k) summary[report.summary.header[k]][row[0]] = row[k];
  }
  return {{"doubts", report.doubts},
          {"missing", report.missing},
          {"points", report.num_points},
          {"figures", report.num_figures},
          {"summary", std::move(summary)}};
}

std::string ToText(const Report& report) {
  size_t width = 0;
  for (const auto& row : report.summary.rows) width = std::max(width, row[0].size());
  std::string text;
  const auto add = [&](const std::vector<std::string>& row) {
    text += fmt::format("{:<{}}", row[0], width);
    for (size_t k = 1; k < row.size(); ++k) text += fmt::format("{:>20}", row[k]);
    text += "\n";
  };
  add(report.summary.header);
  for (const auto& row : report.summary.rows) add(row);
  for (const auto* sentences : {&report.doubts, &report.missing}) {
    for (const std::string& sentence : *sentences) text += sentence + "\n";
  }
  return text;
}

}  // namespace s3lam::report
