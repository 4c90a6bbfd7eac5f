#pragma once

#include <Eigen/Core>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "s3lam/base/id.h"
#include "s3lam/base/options.h"
#include "s3lam/eval/error_statistics.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/geometry/similarity3.h"

namespace s3lam {

/// How fitted planes are held against known ones.
struct PlaneErrorOptions {
  double max_angle_deg = 20.0;
  double max_distance = 0.25;
  std::string frame = "gt";

  void Visit(OptionVisitor& v);
};

/// A surface whose plane is known, in the world of the ground truth.
struct KnownPlane {
  std::string name;
  std::string label;  // Its class; empty if unknown, which fits every class.
  Plane plane_in_truth;
  Eigen::Vector3d centroid_in_truth = Eigen::Vector3d::Zero();
  double radius = 0.0;  // Of the outline about the centroid.
};

/// A plane of an estimated map.
struct FittedPlane {
  PlaneId id;
  std::string label;
  Plane plane;
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  size_t num_points = 0;
};

/// Takes known planes out of a list "objects": "name", "plane_<frame>" with "n" and "d",
/// "centroid_<frame>", "polygon_<frame>"; entries without a plane, or with "plane_reliable" false,
/// are left out. The class is "class" or, by `class_names`, "category_id". Throws InputError naming
/// `source` and the entry.
std::vector<KnownPlane> KnownPlanesFromJson(const nlohmann::json& json, const std::string& frame,
                                            const std::map<int, std::string>& class_names,
                                            const std::string& source);

/// Takes the planes out of semantics.json or planes.json.
std::vector<FittedPlane> FittedPlanesFromJson(const nlohmann::json& json,
                                              const std::string& source);

/// One known plane and what was found of it.
struct PlaneMatch {
  KnownPlane known;
  std::optional<FittedPlane> fitted;  // In the world of the truth.
  double normal_deg = 0.0;            // Between the normals, up to sign.
  double offset = 0.0;  // Distance of the fitted plane from the known surface's centroid.
};

/// Lengths are in the truth's unit.
struct PlaneErrors {
  std::vector<PlaneMatch> matches;  // In the order of the known planes.
  size_t num_found = 0;
  size_t num_fitted = 0;
  ErrorStatistics normal_deg;  // Over the planes found.
  ErrorStatistics offset;
  /// Over pairs of found planes: how far the angle between the fitted two is from the true one, for
  /// pairs that are parallel, orthogonal in truth (within a degree), and for all.
  ErrorStatistics parallel_deg;
  ErrorStatistics orthogonal_deg;
  ErrorStatistics all_pairs_deg;
};

/// A fitted plane is a known one's if their classes agree, they are within max_angle_deg of one
/// another, and the fitted centroid is within max_distance of the known plane and (beside it)
/// within the outline's radius plus max_distance. Each plane is in one match at most; pairs are
/// made by increasing difference.
PlaneErrors ComparePlanes(std::span<const KnownPlane> known, std::span<const FittedPlane> fitted,
                          const Similarity3& truth_from_estimate,
                          const PlaneErrorOptions& options = {});

nlohmann::json ToJson(const PlaneErrors& errors);
std::string ToTable(const PlaneErrors& errors);

}  // namespace s3lam
