#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "s3lam/base/statistics.h"
#include "s3lam/optim/self_calibration.h"
#include "s3lam/refine/report.h"

namespace s3lam {
namespace {

using nlohmann::json;

const char* RelationName(PlaneRelation relation) {
  switch (relation) {
    case PlaneRelation::kParallel:
      return "parallel";
    case PlaneRelation::kOrthogonal:
      return "orthogonal";
    case PlaneRelation::kCoplanar:
      return "coplanar";
    case PlaneRelation::kAtDistance:
      return "at_distance";
    case PlaneRelation::kMeeting:
      return "meeting";
  }
  return "";
}

json ToJson(const ArmReport& arm) {
  return {{"name", arm.name},
          {"reprojection_rms_px", arm.reprojection_rms_px},
          {"plane_rms", arm.plane_rms},
          {"plane_rms_sigma", arm.plane_rms_sigma},
          {"pose_moved_median", arm.pose_moved_median},
          {"pose_moved_max", arm.pose_moved_max},
          {"rotation_moved_max_deg", arm.rotation_moved_max_deg},
          {"point_moved_median", arm.point_moved_median}};
}

json ToJson(const OuterIteration& iteration) {
  return {{"with_planes", iteration.with_planes},
          {"initial_cost", iteration.solve.initial_cost},
          {"final_cost", iteration.solve.final_cost},
          {"steps", iteration.solve.num_iterations},
          {"converged", iteration.solve.converged},
          {"linear_solver", iteration.solve.linear_solver},
          {"observations", iteration.observations.used},
          {"observation_outliers", iteration.observations.outliers},
          {"plane_points", iteration.membership.members},
          {"plane_outliers", iteration.membership.outliers},
          {"seconds", iteration.seconds}};
}

json PlaneReportsToJson(const RefineReport& report) {
  json planes = json::array();
  for (const PlaneReport& plane : report.planes) {
    planes.push_back({{"id", plane.id.value()},
                      {"class", plane.class_name},
                      {"points", plane.points},
                      {"kappa", plane.kappa},
                      {"rms", plane.rms},
                      {"rms_sigma", plane.rms_sigma},
                      {"turned_deg", plane.turned_deg}});
  }
  return planes;
}

json PairsToJson(const RefineReport& report) {
  json pairs = json::array();
  for (const PlanePairReport& pair : report.pairs) {
    pairs.push_back({{"a", pair.a.value()},
                     {"b", pair.b.value()},
                     {"relation", RelationName(pair.relation)},
                     {"enforced", pair.enforced},
                     {"deviation_deg", pair.deviation_deg}});
  }
  return pairs;
}

json DistancesToJson(const RefineReport& report) {
  json distances = json::array();
  for (const PlaneDistanceReport& pair : report.distances) {
    distances.push_back({{"a", pair.a.value()},
                         {"b", pair.b.value()},
                         {"known", pair.known},
                         {"measured", pair.measured}});
  }
  return distances;
}

/// Median over the pairs of one kind of the deviation in one arm; negative without pairs.
double MedianDeviation(const RefineReport& report, PlaneRelation relation, size_t arm) {
  std::vector<double> values;
  for (const PlanePairReport& pair : report.pairs) {
    if (pair.relation == relation) values.push_back(pair.deviation_deg[arm]);
  }
  return values.empty() ? -1.0 : Median(std::move(values));
}

template <typename Function>
std::string Row(const std::string& name, size_t columns, Function&& value) {
  std::string row = fmt::format("  {:<34}", name);
  for (size_t i = 0; i < columns; ++i) row += fmt::format("{:>12.4g}", value(i));
  return row + '\n';
}

json GravityToJson(const GravityReport& gravity) {
  return {{"aligned", gravity.aligned},
          {"reason", gravity.reason},
          {"planes", gravity.num_planes},
          {"planes_agreeing", gravity.num_agreeing},
          {"deviation_deg", gravity.deviation_deg},
          {"turned_deg", gravity.turned_deg},
          {"floor_plane", gravity.floor.valid() ? json(gravity.floor.value()) : json()},
          {"floor_class", gravity.floor_class}};
}

json CamerasToJson(const RefineReport& report) {
  json cameras = json::array();
  for (const IntrinsicsReport& camera : report.cameras) {
    json ids = json::array();
    for (const CameraId id : camera.cameras) ids.push_back(id.value());
    cameras.push_back({{"cameras", ids},
                       {"model", camera.model},
                       {"model_after", camera.model_after},
                       {"refined", camera.refined},
                       {"reason", camera.reason},
                       {"params_before", camera.before},
                       {"params_after", camera.after},
                       {"distortion_cost_share", camera.distortion_cost_share},
                       {"distortion_is_doubtful", camera.distortion_is_doubtful},
                       {"pinhole_cost_share", camera.pinhole_cost_share},
                       {"better_pinhole", camera.better_pinhole}});
  }
  return cameras;
}

/// What became of a camera; empty if there is nothing to tell.
std::string Describe(const IntrinsicsReport& camera) {
  if (camera.refined) {
    const std::string model =
        camera.model_after == camera.model ? "" : fmt::format("{} ", camera.model_after);
    return fmt::format("{:.6g} -> {}{:.6g}", fmt::join(camera.before, " "), model,
                       fmt::join(camera.after, " "));
  }
  std::vector<std::string> doubts;
  if (camera.distortion_is_doubtful) {
    doubts.push_back(fmt::format("another lens distortion would remove {:.0f} % of the cost",
                                 100.0 * camera.distortion_cost_share));
  }
  if (!camera.better_pinhole.empty()) {
    doubts.push_back(DescribeBetterPinhole(camera.better_pinhole, camera.pinhole_cost_share));
  }
  const std::string kept = camera.reason.empty() ? "kept" : "kept, " + camera.reason;
  if (!doubts.empty()) return fmt::format("{}, but {}", kept, fmt::join(doubts, "; "));
  return camera.reason.empty() ? "" : kept;
}

/// What alike descriptions have in common: all before the first number.
std::string KindOf(const std::string& description) {
  return description.substr(0, description.find_first_of("0123456789"));
}

std::string CamerasToTable(const RefineReport& report) {
  constexpr size_t kMostOfAKind = 10;
  std::map<std::string, size_t> counts;
  std::string text;
  for (const IntrinsicsReport& camera : report.cameras) {
    const std::string description = Describe(camera);
    if (description.empty() || ++counts[KindOf(description)] > kMostOfAKind) continue;
    text += fmt::format("\ncamera {} {}: {}\n", camera.cameras.front().value(), camera.model,
                        description);
  }
  for (const auto& [kind, count] : counts) {
    if (count <= kMostOfAKind) continue;
    text += fmt::format("\n{} more cameras like these: {}\n", count - kMostOfAKind,
                        kind.empty() ? "refined" : kind + "...");
  }
  return text;
}

std::string SizesToText(const RefineReport& report) {
  return fmt::format(
      "images {} ({} refined)   points {} ({} in use)   observations {} ({} in use, {} outliers, "
      "{} behind)\nplanes {} with {} points   mode {}{}\n\n",
      report.num_images, report.num_images_in_use, report.num_points, report.num_points_in_use,
      report.observations.total, report.observations.used, report.observations.outliers,
      report.observations.behind, report.planes.size(), report.membership.members,
      report.plane_mode, report.note.empty() ? "" : " (" + report.note + ")");
}

/// A column per arm.
std::string ArmsToTable(const RefineReport& report) {
  const auto& arms = report.arms;
  std::string text = fmt::format("  {:<34}", "");
  for (const ArmReport& arm : arms) text += fmt::format("{:>12}", arm.name);
  text += '\n';
  const size_t n = arms.size();
  text += Row("reprojection RMS [px]", n, [&](size_t i) { return arms[i].reprojection_rms_px; });
  if (!report.planes.empty()) {
    text += Row("plane RMS [map units]", n, [&](size_t i) { return arms[i].plane_rms; });
    text += Row("plane RMS [sigma]", n, [&](size_t i) { return arms[i].plane_rms_sigma; });
  }
  for (const auto& [relation, name] :
       {std::pair(PlaneRelation::kParallel, "parallel planes, off by [deg]"),
        std::pair(PlaneRelation::kOrthogonal, "orthogonal planes, off by [deg]")}) {
    if (n == 0 || MedianDeviation(report, relation, 0) < 0.0) continue;
    text += Row(name, n, [&, r = relation](size_t i) { return MedianDeviation(report, r, i); });
  }
  for (const PlaneDistanceReport& pair : report.distances) {
    text += Row(fmt::format("planes {} and {}, known as {:.4g}", pair.a.value(), pair.b.value(),
                            pair.known),
                n, [&](size_t i) { return pair.measured[i]; });
  }
  text += Row("cameras moved, median [map units]", n,
              [&](size_t i) { return arms[i].pose_moved_median; });
  text +=
      Row("cameras moved, max [map units]", n, [&](size_t i) { return arms[i].pose_moved_max; });
  return text;
}

/// What else was done, as far as it was.
std::string NotesToText(const RefineReport& report) {
  std::string text;
  if (report.num_exact_points > 0) {
    text += fmt::format("\n{} points are exactly on {} planes\n", report.num_exact_points,
                        report.num_exact_planes);
  }
  if (report.num_retriangulated + report.num_merged > 0) {
    text += fmt::format("\n{} points triangulated anew, {} merged into others\n",
                        report.num_retriangulated, report.num_merged);
  }
  if (report.ground.in_use) {
    text += fmt::format(
        "\ncamera height {:.4g} map units over {} ground planes, varies by {:.2f} % (before {:.2f} "
        "%)\n",
        report.ground.height, report.ground.num_planes, 100.0 * report.ground.spread_after,
        100.0 * report.ground.spread_before);
  }
  if (report.frames.num_frames > 0) {
    text += fmt::format(
        "\nframes {}: {} refined against the map, the others moved with the keyframes\n",
        report.frames.num_frames, report.frames.num_refined);
  }
  if (report.gravity.aligned) {
    text += fmt::format("\nz points up by {} planes, RMS {:.2f} deg{}\n",
                        report.gravity.num_agreeing, report.gravity.deviation_deg,
                        report.gravity.floor.valid()
                            ? fmt::format("; {} is at z = 0", report.gravity.floor_class)
                            : "");
  }
  return text;
}

}  // namespace

json ToJson(const RefineReport& report) {
  json arms = json::array();
  for (const ArmReport& arm : report.arms) arms.push_back(ToJson(arm));
  json iterations = json::array();
  for (const OuterIteration& iteration : report.iterations) iterations.push_back(ToJson(iteration));
  return {
      {"images", report.num_images},
      {"images_in_use", report.num_images_in_use},
      {"points", report.num_points},
      {"points_in_use", report.num_points_in_use},
      {"observations",
       {{"total", report.observations.total},
        {"used", report.observations.used},
        {"outliers", report.observations.outliers},
        {"behind", report.observations.behind},
        {"too_few", report.observations.too_few}}},
      {"plane_points",
       {{"on_planes", report.membership.members}, {"outliers", report.membership.outliers}}},
      {"plane_mode", report.plane_mode},
      {"note", report.note},
      {"points_retriangulated", report.num_retriangulated},
      {"points_merged", report.num_merged},
      {"exact_planes", {{"planes", report.num_exact_planes}, {"points", report.num_exact_points}}},
      {"keypoint_sigma_px", report.keypoint_sigma_px},
      {"keypoints_differ", report.keypoints_differ},
      {"median_depth", report.median_depth},
      {"metres_per_unit", report.metres_per_unit},
      {"gauge_scale_change", report.gauge_scale_change},
      {"camera_height",
       {{"in_use", report.ground.in_use},
        {"reason", report.ground.reason},
        {"ground_planes", report.ground.num_planes},
        {"cameras", report.ground.num_cameras},
        {"height", report.ground.height},
        {"spread_before", report.ground.spread_before},
        {"spread_after", report.ground.spread_after}}},
      {"frames", {{"total", report.frames.num_frames}, {"refined", report.frames.num_refined}}},
      {"gravity", GravityToJson(report.gravity)},
      {"cameras", CamerasToJson(report)},
      {"arms", arms},
      {"planes", PlaneReportsToJson(report)},
      {"plane_pairs", PairsToJson(report)},
      {"plane_distances", DistancesToJson(report)},
      {"iterations", iterations},
      {"seconds", report.seconds},
      {"peak_memory_mib", report.peak_memory_mib}};
}

std::string ToTable(const RefineReport& report) {
  double total = 0.0;
  for (const auto& [step, seconds] : report.seconds) total += seconds;
  return SizesToText(report) + ArmsToTable(report) + NotesToText(report) + CamerasToTable(report) +
         fmt::format("\ntime {:.2f} s   peak memory {:.0f} MiB\n", total, report.peak_memory_mib);
}

}  // namespace s3lam
