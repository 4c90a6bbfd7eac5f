#pragma once

#include <Eigen/Core>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>
#include <vector>

#include "s3lam/base/id.h"

namespace s3lam {

/// The direction of one plane and the name of its class.
struct LabelledNormal {
  PlaneId id;
  std::string label;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  // Unit.
};

/// Takes the planes out of semantics.json or planes.json: the list "planes" with "id", "class" and
/// "normal_in_world" of each. Throws InputError naming `source` and the entry.
std::vector<LabelledNormal> LabelledNormalsFromJson(const nlohmann::json& json,
                                                    const std::string& source);

/// Angle between the normals of two planes, up to sign [deg], in [0, 90].
struct PlaneAnglePair {
  PlaneId a;
  PlaneId b;
  std::string label_a;
  std::string label_b;
  double angle_deg = 0.0;
};

/// All pairs of planes whose labels are both in `labels` (all planes if it is empty), in the order
/// of the list.
std::vector<PlaneAnglePair> PairwisePlaneAngles(std::span<const LabelledNormal> planes,
                                                std::span<const std::string> labels = {});

/// How far pairs are from parallel (those below 45 deg) and from orthogonal (the others): the
/// figures that show whether surfaces parallel or at right angles in reality came out so. All zero
/// without such pairs.
struct PlaneAngleSummary {
  struct Deviation {
    size_t count = 0;
    double min_deg = 0.0;
    double median_deg = 0.0;
    double max_deg = 0.0;
  };
  Deviation from_parallel;
  Deviation from_orthogonal;
};
PlaneAngleSummary SummarizePlaneAngles(std::span<const PlaneAnglePair> pairs);

nlohmann::json ToJson(std::span<const PlaneAnglePair> pairs);
/// The pairs and their summary for people.
std::string ToTable(std::span<const PlaneAnglePair> pairs);

}  // namespace s3lam
