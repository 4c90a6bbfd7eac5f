#include "s3lam/eval/plane_angles.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "plane_json.h"
#include "s3lam/base/error.h"
#include "s3lam/eval/trajectory_error.h"
#include "s3lam/geometry/plane.h"

namespace s3lam {
namespace {

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;

LabelledNormal ParsePlane(const nlohmann::json& json, const std::string& where) {
  LabelledNormal plane;
  try {
    plane.id = PlaneId(json.at("id").get<uint32_t>());
    plane.label = json.at("class").get<std::string>();
    plane.normal = PlaneFromJson(json.at("normal_in_world"), 0.0).normal;
  } catch (const nlohmann::json::exception& error) {
    ThrowInputError("{}: {}", where, error.what());
  } catch (const InputError& error) {
    ThrowInputError("{}: {}", where, error.what());
  }
  return plane;
}

bool IsSelected(const LabelledNormal& plane, std::span<const std::string> labels) {
  return labels.empty() || std::find(labels.begin(), labels.end(), plane.label) != labels.end();
}

PlaneAngleSummary::Deviation Summarize(std::vector<double> deviations) {
  const ErrorStatistics statistics = ComputeErrorStatistics(std::move(deviations));
  return {statistics.count, statistics.min, statistics.median, statistics.max};
}

nlohmann::json DeviationToJson(const PlaneAngleSummary::Deviation& deviation) {
  return {{"count", deviation.count},
          {"min_deg", deviation.min_deg},
          {"median_deg", deviation.median_deg},
          {"max_deg", deviation.max_deg}};
}

}  // namespace

std::vector<LabelledNormal> LabelledNormalsFromJson(const nlohmann::json& json,
                                                    const std::string& source) {
  if (!json.is_object() || !json.contains("planes") || !json["planes"].is_array()) {
    ThrowInputError("{}: no list 'planes'", source);
  }
  std::vector<LabelledNormal> planes;
  for (const nlohmann::json& plane : json["planes"]) {
    planes.push_back(ParsePlane(plane, fmt::format("{}: planes[{}]", source, planes.size())));
  }
  return planes;
}

std::vector<PlaneAnglePair> PairwisePlaneAngles(std::span<const LabelledNormal> planes,
                                                std::span<const std::string> labels) {
  std::vector<PlaneAnglePair> pairs;
  for (size_t i = 0; i < planes.size(); ++i) {
    if (!IsSelected(planes[i], labels)) continue;
    for (size_t j = i + 1; j < planes.size(); ++j) {
      if (!IsSelected(planes[j], labels)) continue;
      const double angle = PlaneAngle({planes[i].normal, 0.0}, {planes[j].normal, 0.0});
      pairs.push_back({planes[i].id, planes[j].id, planes[i].label, planes[j].label,
                       kDegreesPerRadian * angle});
    }
  }
  return pairs;
}

PlaneAngleSummary SummarizePlaneAngles(std::span<const PlaneAnglePair> pairs) {
  std::vector<double> parallel;
  std::vector<double> orthogonal;
  for (const PlaneAnglePair& pair : pairs) {
    if (pair.angle_deg < 45.0) {
      parallel.push_back(pair.angle_deg);
    } else {
      orthogonal.push_back(90.0 - pair.angle_deg);
    }
  }
  return {Summarize(std::move(parallel)), Summarize(std::move(orthogonal))};
}

nlohmann::json ToJson(std::span<const PlaneAnglePair> pairs) {
  nlohmann::json list = nlohmann::json::array();
  for (const PlaneAnglePair& pair : pairs) {
    list.push_back({{"a", pair.a.value()},
                    {"b", pair.b.value()},
                    {"class_a", pair.label_a},
                    {"class_b", pair.label_b},
                    {"angle_deg", pair.angle_deg}});
  }
  const PlaneAngleSummary summary = SummarizePlaneAngles(pairs);
  return {{"pairs", list},
          {"from_parallel", DeviationToJson(summary.from_parallel)},
          {"from_orthogonal", DeviationToJson(summary.from_orthogonal)}};
}

std::string ToTable(std::span<const PlaneAnglePair> pairs) {
  std::string table = fmt::format("{:<28}{:<28}{:>12}\n", "plane", "plane", "angle [deg]");
  for (const PlaneAnglePair& pair : pairs) {
    table +=
        fmt::format("{:<28}{:<28}{:>12.3f}\n", fmt::format("{} {}", pair.a.value(), pair.label_a),
                    fmt::format("{} {}", pair.b.value(), pair.label_b), pair.angle_deg);
  }
  const PlaneAngleSummary summary = SummarizePlaneAngles(pairs);
  const auto row = [](std::string_view name, const PlaneAngleSummary::Deviation& deviation) {
    return fmt::format("{:<22}{:>6} pairs, min {:.3f}, median {:.3f}, max {:.3f} deg\n", name,
                       deviation.count, deviation.min_deg, deviation.median_deg, deviation.max_deg);
  };
  table += "\n";
  table += row("from parallel", summary.from_parallel);
  table += row("from orthogonal", summary.from_orthogonal);
  return table;
}

}  // namespace s3lam
