#include "s3lam/eval/plane_errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <tuple>

#include "plane_json.h"
#include "s3lam/base/error.h"

namespace s3lam {
namespace {

using nlohmann::json;

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;
/// Known planes this close to parallel (orthogonal) are counted as such.
constexpr double kRelationDeg = 1.0;

double AngleDeg(const Plane& a, const Plane& b) { return kDegreesPerRadian * PlaneAngle(a, b); }

const json& List(const json& object, const char* key, const std::string& source) {
  if (!object.is_object() || !object.contains(key) || !object[key].is_array()) {
    ThrowInputError("{}: no list '{}'", source, key);
  }
  return object[key];
}

KnownPlane ParseKnown(const json& object, const std::string& frame,
                      const std::map<int, std::string>& class_names) {
  KnownPlane known;
  known.name = object.at("name").get<std::string>();
  if (object.contains("class")) {
    known.label = object["class"].get<std::string>();
  } else if (!class_names.empty()) {
    const auto name = class_names.find(object.at("category_id").get<int>());
    if (name == class_names.end()) throw InputError("its class is not in the class table");
    known.label = name->second;
  }
  const json& plane = object.at("plane_" + frame);
  known.plane_in_truth = PlaneFromJson(plane.at("n"), plane.at("d").get<double>());
  known.centroid_in_truth =
      known.plane_in_truth.Project(VectorFromJson(object.at("centroid_" + frame)));
  for (const json& corner : object.at("polygon_" + frame)) {
    const double distance = (VectorFromJson(corner) - known.centroid_in_truth).norm();
    known.radius = std::max(known.radius, distance);
  }
  return known;
}

FittedPlane ParseFitted(const json& object) {
  FittedPlane fitted;
  fitted.id = PlaneId(object.at("id").get<uint32_t>());
  fitted.label = object.at("class").get<std::string>();
  fitted.plane = PlaneFromJson(object.at("normal_in_world"), object.at("offset").get<double>());
  fitted.centroid = VectorFromJson(object.at("centroid_in_world"));
  // semantics.json lists the points of a plane, planes.json counts them.
  fitted.num_points =
      object.contains("inliers") ? object["inliers"].size() : object.at("points").get<size_t>();
  return fitted;
}

/// Calls `parse` and puts the place into what it throws.
template <typename Parse>
auto Located(const std::string& source, const char* list, size_t index, const Parse& parse) {
  try {
    return parse();
  } catch (const json::exception& error) {
    ThrowInputError("{}: {}[{}]: {}", source, list, index, error.what());
  } catch (const InputError& error) {
    ThrowInputError("{}: {}[{}]: {}", source, list, index, error.what());
  }
}

/// How much a fitted plane differs from a known one, in units of what is allowed; empty if they
/// cannot be the same.
std::optional<double> Difference(const KnownPlane& known, const FittedPlane& fitted,
                                 const PlaneErrorOptions& options) {
  if (!known.label.empty() && known.label != fitted.label) return std::nullopt;
  const double angle = AngleDeg(known.plane_in_truth, fitted.plane) / options.max_angle_deg;
  const double distance =
      std::abs(known.plane_in_truth.SignedDistance(fitted.centroid)) / options.max_distance;
  const Eigen::Vector3d foot = known.plane_in_truth.Project(fitted.centroid);
  const double beside = (foot - known.centroid_in_truth).norm();
  if (angle > 1.0 || distance > 1.0 || beside > known.radius + options.max_distance) {
    return std::nullopt;
  }
  return angle + distance;
}

std::vector<PlaneMatch> Match(std::span<const KnownPlane> known,
                              std::span<const FittedPlane> fitted,
                              const PlaneErrorOptions& options) {
  std::vector<std::tuple<double, size_t, size_t>> candidates;
  for (size_t i = 0; i < known.size(); ++i) {
    for (size_t j = 0; j < fitted.size(); ++j) {
      if (const auto difference = Difference(known[i], fitted[j], options)) {
        candidates.emplace_back(*difference, i, j);
      }
    }
  }
  std::sort(candidates.begin(), candidates.end());
  std::vector<PlaneMatch> matches;
  for (const KnownPlane& plane : known) matches.push_back({plane, std::nullopt, 0.0, 0.0});
  std::vector<bool> taken(fitted.size(), false);
  for (const auto& [difference, i, j] : candidates) {
    if (matches[i].fitted || taken[j]) continue;
    taken[j] = true;
    matches[i].fitted = fitted[j];
    matches[i].normal_deg = AngleDeg(known[i].plane_in_truth, fitted[j].plane);
    matches[i].offset = std::abs(fitted[j].plane.SignedDistance(known[i].centroid_in_truth));
  }
  return matches;
}

void MeasurePairs(PlaneErrors& errors) {
  std::vector<double> parallel;
  std::vector<double> orthogonal;
  std::vector<double> all;
  for (size_t i = 0; i < errors.matches.size(); ++i) {
    const PlaneMatch& a = errors.matches[i];
    for (size_t j = i + 1; a.fitted && j < errors.matches.size(); ++j) {
      const PlaneMatch& b = errors.matches[j];
      if (!b.fitted) continue;
      const double truth = AngleDeg(a.known.plane_in_truth, b.known.plane_in_truth);
      const double error = std::abs(AngleDeg(a.fitted->plane, b.fitted->plane) - truth);
      all.push_back(error);
      if (truth < kRelationDeg) parallel.push_back(error);
      if (truth > 90.0 - kRelationDeg) orthogonal.push_back(error);
    }
  }
  errors.parallel_deg = ComputeErrorStatistics(std::move(parallel));
  errors.orthogonal_deg = ComputeErrorStatistics(std::move(orthogonal));
  errors.all_pairs_deg = ComputeErrorStatistics(std::move(all));
}

json MatchToJson(const PlaneMatch& match) {
  json entry{{"name", match.known.name}, {"class", match.known.label}};
  entry["plane"] = match.fitted ? json(match.fitted->id.value()) : json(nullptr);
  if (match.fitted) {
    entry["points"] = match.fitted->num_points;
    entry["normal_deg"] = match.normal_deg;
    entry["offset"] = match.offset;
  }
  return entry;
}

}  // namespace

void PlaneErrorOptions::Visit(OptionVisitor& v) {
  v.Value("max_angle_deg", max_angle_deg,
          "a fitted plane farther from a known one is another plane [deg]", 0.0, 90.0);
  v.Value("max_distance", max_distance,
          "likewise, of its centroid from the known plane [unit of the truth]", 0.0);
  v.Value("frame", frame, "ending of plane_, centroid_ and polygon_ in the file of known planes");
}

std::vector<KnownPlane> KnownPlanesFromJson(const json& document, const std::string& frame,
                                            const std::map<int, std::string>& class_names,
                                            const std::string& source) {
  std::vector<KnownPlane> planes;
  const json& list = List(document, "objects", source);
  for (size_t i = 0; i < list.size(); ++i) {
    const json& object = list[i];
    if (!object.is_object() || !object.contains("plane_" + frame)) continue;
    if (object.contains("plane_reliable") && object["plane_reliable"] == false) continue;
    planes.push_back(
        Located(source, "objects", i, [&] { return ParseKnown(object, frame, class_names); }));
  }
  if (planes.empty()) ThrowInputError("{}: no object has 'plane_{}'", source, frame);
  return planes;
}

std::vector<FittedPlane> FittedPlanesFromJson(const json& document, const std::string& source) {
  std::vector<FittedPlane> planes;
  const json& list = List(document, "planes", source);
  for (size_t i = 0; i < list.size(); ++i) {
    planes.push_back(Located(source, "planes", i, [&] { return ParseFitted(list[i]); }));
  }
  return planes;
}

PlaneErrors ComparePlanes(std::span<const KnownPlane> known, std::span<const FittedPlane> fitted,
                          const Similarity3& truth_from_estimate,
                          const PlaneErrorOptions& options) {
  std::vector<FittedPlane> in_truth(fitted.begin(), fitted.end());
  for (FittedPlane& plane : in_truth) {
    plane.plane = TransformPlane(truth_from_estimate, plane.plane);
    plane.centroid = truth_from_estimate * plane.centroid;
  }
  PlaneErrors errors;
  errors.num_fitted = fitted.size();
  errors.matches = Match(known, in_truth, options);
  std::vector<double> angles;
  std::vector<double> offsets;
  for (const PlaneMatch& match : errors.matches) {
    if (!match.fitted) continue;
    angles.push_back(match.normal_deg);
    offsets.push_back(match.offset);
  }
  errors.num_found = angles.size();
  errors.normal_deg = ComputeErrorStatistics(std::move(angles));
  errors.offset = ComputeErrorStatistics(std::move(offsets));
  MeasurePairs(errors);
  return errors;
}

json ToJson(const PlaneErrors& errors) {
  json list = json::array();
  for (const PlaneMatch& match : errors.matches) list.push_back(MatchToJson(match));
  return {{"known", errors.matches.size()},
          {"found", errors.num_found},
          {"fitted", errors.num_fitted},
          {"normal_deg", ToJson(errors.normal_deg)},
          {"offset", ToJson(errors.offset)},
          {"parallel_deg", ToJson(errors.parallel_deg)},
          {"orthogonal_deg", ToJson(errors.orthogonal_deg)},
          {"all_pairs_deg", ToJson(errors.all_pairs_deg)},
          {"planes", list}};
}

std::string ToTable(const PlaneErrors& errors) {
  std::string table = fmt::format("known planes          {} of {} found, {} fitted\n\n",
                                  errors.num_found, errors.matches.size(), errors.num_fitted);
  table += fmt::format("{:<28}{:<20}{:>8}{:>8}{:>12}{:>12}\n", "known plane", "class", "plane",
                       "points", "normal [deg]", "offset");
  for (const PlaneMatch& match : errors.matches) {
    table += fmt::format("{:<28}{:<20}", match.known.name, match.known.label);
    table += match.fitted ? fmt::format("{:>8}{:>8}{:>12.3f}{:>12.4f}\n", match.fitted->id.value(),
                                        match.fitted->num_points, match.normal_deg, match.offset)
                          : fmt::format("{:>8}\n", "-");
  }
  table += "\n";
  table += TableHeader();
  table += TableRow("normals off [deg]", errors.normal_deg);
  table += TableRow("offset", errors.offset);
  table += TableRow("parallel off [deg]", errors.parallel_deg);
  table += TableRow("orthogonal off [deg]", errors.orthogonal_deg);
  return table + TableRow("all angles off [deg]", errors.all_pairs_deg);
}

}  // namespace s3lam
