#include "s3lam/report/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "s3lam/base/statistics.h"

namespace s3lam::report {
namespace {

using nlohmann::json;

constexpr const char* kNothing = "-";

/// A list in a report; an empty one where there is none.
const json& ListIn(const json* report, const char* key) {
  static const json kNone = json::array();
  if (report == nullptr || !report->contains(key) || !(*report)[key].is_array()) return kNone;
  return (*report)[key];
}

/// Reports may come from another version: what is not a number is not shown.
std::string NumberIn(const json& object, const char* key, const char* unit = "") {
  if (!object.is_object() || !object.contains(key) || !object[key].is_number()) return kNothing;
  return fmt::format("{:.4g}{}", object[key].get<double>(), unit);
}

std::string TextIn(const json& object, const char* key) {
  if (!object.is_object() || !object.contains(key) || !object[key].is_string()) return kNothing;
  return object[key].get<std::string>();
}

std::vector<std::string> Row(std::string label, const RunFolder& run,
                             const std::function<std::string(size_t)>& cell) {
  std::vector<std::string> row = {std::move(label)};
  for (size_t k = 0; k < run.arms.size(); ++k) row.push_back(cell(k));
  return row;
}

std::string ClassName(const RunFolder& run, const PlanarSurface& plane) {
  return run.semantics->class_table.classes.at(static_cast<size_t>(plane.class_index)).name;
}

/// "3 (book)"; the number alone for a plane that no part of the run knows.
std::string NameOfPlane(const RunFolder& run, const std::map<PlaneId, PlanarSurface>& planes,
                        const json& pair, const char* key) {
  if (!pair.is_object() || !pair.contains(key) || !pair[key].is_number_unsigned()) return kNothing;
  const PlaneId id(pair[key].get<uint32_t>());
  const auto plane = planes.find(id);
  if (plane == planes.end()) return fmt::format("{}", id.value());
  return fmt::format("{} ({})", id.value(), ClassName(run, plane->second));
}

/// The entries of planes in the report of the planar adjustment.
std::map<PlaneId, const json*> RefinedPlanes(const RunFolder& run) {
  std::map<PlaneId, const json*> planes;
  for (const json& plane : ListIn(FindReport(run, "3_refine"), "planes")) {
    if (!plane.is_object() || !plane.contains("id") || !plane["id"].is_number_unsigned()) continue;
    planes.emplace(PlaneId(plane["id"].get<uint32_t>()), &plane);
  }
  return planes;
}

}  // namespace

Table SummaryTable(const RunFolder& run, const Measures& measures) {
  Table table;
  table.title = "Summary";
  table.header = {""};
  for (const Arm& arm : run.arms) table.header.push_back(arm.title);
  const auto count = [](size_t n) { return fmt::format("{}", n); };
  table.rows.push_back(Row("images in the model", run,
                           [&](size_t k) { return count(run.arms[k].model.images.size()); }));
  table.rows.push_back(
      Row("poses", run, [&](size_t k) { return count(run.arms[k].trajectory.size()); }));
  table.rows.push_back(
      Row("points", run, [&](size_t k) { return count(run.arms[k].model.points.size()); }));
  table.rows.push_back(
      Row("planes", run, [&](size_t k) { return count(run.arms[k].planes.size()); }));
  if (!measures.frame.errors.empty()) {
    table.rows.push_back(Row("trajectory error, RMSE [ground truth's unit]", run, [&](size_t k) {
      return fmt::format("{:.5g}", measures.frame.errors[k].rmse);
    }));
  }
  table.rows.push_back(Row(fmt::format("reprojection error of {} common observations, RMS [px]",
                                       measures.reprojection_px.front().size()),
                           run, [&](size_t k) {
                             return fmt::format("{:.4f}",
                                                RootMeanSquare(measures.reprojection_px[k]));
                           }));
  if (measures.planes.empty()) return table;
  const std::string points =
      fmt::format("distance of {} points from their planes, ", measures.plane_distances[0].size());
  table.rows.push_back(
      Row(points + fmt::format("RMS [{}]", measures.frame.unit), run, [&](size_t k) {
        return fmt::format("{:.5g}", RootMeanSquare(measures.plane_distances[k]));
      }));
  table.rows.push_back(
      Row(points + fmt::format("median [{}]", measures.frame.unit), run, [&](size_t k) {
        return fmt::format("{:.5g}", InterpolatedMedian(measures.plane_distances[k]));
      }));
  return table;
}

Table PlaneTable(const RunFolder& run, const Measures& measures) {
  Table table;
  table.title = "Planes";
  table.header = {"plane", "class", "object", "points"};
  table.num_text_columns = 2;
  for (const Arm& arm : run.arms) {
    table.header.push_back(fmt::format("median off it, {} [{}]", arm.title, measures.frame.unit));
  }
  table.header.insert(table.header.end(), {"turned [deg]", "kappa"});
  if (!run.semantics) return table;
  const std::map<PlaneId, const json*> refined_planes = RefinedPlanes(run);
  for (const auto& [id, plane] : AllPlanes(run)) {
    std::vector<std::string> row = {fmt::format("{}", id.value()), ClassName(run, plane),
                                    fmt::format("{}", plane.cluster_id.value()),
                                    fmt::format("{}", plane.inliers.size())};
    const auto measured = std::find_if(measures.planes.begin(), measures.planes.end(),
                                       [&id = id](const PlaneDistances& p) { return p.id == id; });
    for (size_t k = 0; k < run.arms.size(); ++k) {
      row.push_back(measured == measures.planes.end()
                        ? kNothing
                        : fmt::format("{:.4g}", measures.frame.view_from_arm[k].scale *
                                                    InterpolatedMedian(measured->distances[k])));
    }
    const auto entry = refined_planes.find(id);
    const json refined = entry == refined_planes.end() ? json() : *entry->second;
    row.push_back(NumberIn(refined, "turned_deg"));
    row.push_back(NumberIn(refined, "kappa"));
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table RelationTable(const RunFolder& run) {
  Table table;
  table.title = "Relations of planes";
  table.header = {"plane", "and plane", "relation", "enforced"};
  table.num_text_columns = 4;
  const std::map<PlaneId, PlanarSurface> planes = AllPlanes(run);
  const json* report = FindReport(run, "3_refine");
  const json& arms = ListIn(report, "arms");
  for (const json& arm : arms) {
    table.header.push_back(fmt::format("off, {} [deg]", TextIn(arm, "name")));
  }
  for (const json& pair : ListIn(report, "plane_pairs")) {
    const bool enforced = pair.is_object() && pair.value("enforced", json()) == json(true);
    std::vector<std::string> row = {NameOfPlane(run, planes, pair, "a"),
                                    NameOfPlane(run, planes, pair, "b"), TextIn(pair, "relation"),
                                    enforced ? "yes" : "no"};
    const json& deviations = ListIn(pair.is_object() ? &pair : nullptr, "deviation_deg");
    for (size_t k = 0; k < arms.size(); ++k) {
      const bool known = k < deviations.size() && deviations[k].is_number();
      row.push_back(known ? fmt::format("{:.3f}", deviations[k].get<double>()) : kNothing);
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table TimingTable(const RunFolder& run) {
  Table table;
  table.title = "Timings";
  table.header = {"stage", "step", "seconds"};
  table.num_text_columns = 2;
  for (const StageRecord& stage : run.stages) {
    if (!stage.report.is_object()) continue;
    if (stage.report.contains("seconds") && stage.report["seconds"].is_object()) {
      for (const auto& [step, seconds] : stage.report["seconds"].items()) {
        if (!seconds.is_number()) continue;
        table.rows.push_back({stage.folder, step, fmt::format("{:.3f}", seconds.get<double>())});
      }
    }
    table.rows.push_back(
        {stage.folder, "peak memory", NumberIn(stage.report, "peak_memory_mib", " MiB")});
  }
  return table;
}

}  // namespace s3lam::report
