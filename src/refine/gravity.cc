#include "s3lam/refine/gravity.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 3> kModeNames{"off", "upright", "floor"};
constexpr double kDegrees = 180.0 / std::numbers::pi;
/// Upright planes within this of parallel say nothing of what is up [sine].
constexpr double kLeastSine = 0.3;
/// Mean of the cameras' upper sides along the vertical that is enough to tell up from down.
constexpr double kLeastUprightness = 0.2;
constexpr size_t kMaxProposers = 30;
constexpr int kRefinements = 5;

/// A plane whose class says how it lies.
struct Witness {
  PlaneId id;
  Eigen::Vector3d normal;
  Eigen::Vector3d centroid;
  bool level = false;
  double weight = 0.0;  // Number of points.

  /// Angle to how it should lie if `up` is up [rad].
  [[nodiscard]] double Deviation(const Eigen::Vector3d& up) const {
    const double along = std::abs(normal.dot(up));
    const double across = normal.cross(up).norm();
    return level ? std::atan2(across, along) : std::atan2(along, across);
  }
};

std::vector<Witness> CollectWitnesses(const GravityOptions& options, const SemanticMap& semantics) {
  std::vector<Witness> witnesses;
  for (const auto& [id, surface] : semantics.planes) {
    const auto& semantic_class = semantics.class_table.classes[surface.class_index];
    const auto points = static_cast<double>(surface.inliers.size());
    if (semantic_class.orientation == SurfaceOrientation::kAny || points < options.min_points) {
      continue;
    }
    witnesses.push_back({id, surface.plane_in_world.normal, surface.centroid_in_world,
                         semantic_class.orientation == SurfaceOrientation::kHorizontal, points});
  }
  std::stable_sort(witnesses.begin(), witnesses.end(),
                   [](const Witness& a, const Witness& b) { return a.weight > b.weight; });
  return witnesses;
}

std::vector<Eigen::Vector3d> Proposals(const std::vector<Witness>& witnesses) {
  std::vector<Eigen::Vector3d> proposals;
  const size_t count = std::min(witnesses.size(), kMaxProposers);
  for (size_t i = 0; i < count; ++i) {
    if (witnesses[i].level) {
      proposals.push_back(witnesses[i].normal);
      continue;
    }
    for (size_t k = i + 1; k < count; ++k) {
      const Eigen::Vector3d cross = witnesses[i].normal.cross(witnesses[k].normal);
      if (!witnesses[k].level && cross.norm() > kLeastSine) proposals.push_back(cross.normalized());
    }
  }
  return proposals;
}

/// Points weighed by how well their planes agree: one for perfect, zero from `max_deviation` on.
double Score(const std::vector<Witness>& witnesses, const Eigen::Vector3d& up,
             double max_deviation) {
  double score = 0.0;
  for (const Witness& witness : witnesses) {
    const double ratio = witness.Deviation(up) / max_deviation;
    score += witness.weight * std::max(0.0, 1.0 - ratio * ratio);
  }
  return score;
}

/// The direction that minimises the squared sines of the agreeing planes' deviations.
Eigen::Vector3d Refine(const std::vector<Witness>& witnesses, Eigen::Vector3d up,
                       double max_deviation) {
  for (int round = 0; round < kRefinements; ++round) {
    Eigen::Matrix3d quadratic = Eigen::Matrix3d::Zero();
    for (const Witness& witness : witnesses) {
      if (witness.Deviation(up) > max_deviation) continue;
      const Eigen::Matrix3d outer = witness.normal * witness.normal.transpose();
      quadratic += witness.weight *
                   (witness.level ? Eigen::Matrix3d(Eigen::Matrix3d::Identity() - outer) : outer);
    }
    const Eigen::Vector3d refined =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(quadratic).eigenvectors().col(0);
    up = refined.dot(up) < 0.0 ? Eigen::Vector3d(-refined) : refined;
  }
  return up;
}

/// +1 or -1: what makes it up and not down.
double SignOfUp(const std::vector<Witness>& witnesses, const Reconstruction& model,
                const Eigen::Vector3d& axis) {
  Eigen::Vector3d upper_side = Eigen::Vector3d::Zero();
  for (const auto& [id, image] : model.images) {
    upper_side -= image.cam_from_world.rotation.conjugate() * Eigen::Vector3d::UnitY();
  }
  const double uprightness =
      axis.dot(upper_side) / std::max(1.0, static_cast<double>(model.images.size()));
  if (std::abs(uprightness) >= kLeastUprightness) return uprightness < 0.0 ? -1.0 : 1.0;
  double towards_cameras = 0.0;
  for (const Witness& witness : witnesses) {
    if (witness.level) towards_cameras += witness.weight * witness.normal.dot(axis);
  }
  return towards_cameras < 0.0 ? -1.0 : 1.0;
}

/// The lowest level plane under the cameras that has its share of the points.
const Witness* FindFloor(const GravityOptions& options, const std::vector<Witness>& witnesses,
                         const Eigen::Vector3d& up) {
  double level_points = 0.0;
  for (const Witness& witness : witnesses) level_points += witness.level ? witness.weight : 0.0;
  const Witness* floor = nullptr;
  for (const Witness& witness : witnesses) {
    const bool seen_from_above = witness.normal.dot(up) > 0.0;
    if (!witness.level || !seen_from_above ||
        witness.Deviation(up) * kDegrees > options.max_deviation_deg ||
        witness.weight < options.min_floor_share * level_points) {
      continue;
    }
    if (floor == nullptr || witness.centroid.dot(up) < floor->centroid.dot(up)) floor = &witness;
  }
  return floor;
}

std::optional<Eigen::Vector3d> FindUp(const GravityOptions& options,
                                      const std::vector<Witness>& witnesses,
                                      const Reconstruction& model, GravityReport& report) {
  report.num_planes = witnesses.size();
  const std::vector<Eigen::Vector3d> proposals = Proposals(witnesses);
  if (proposals.empty()) {
    report.reason = "no plane of a horizontal class and no two of vertical classes";
    return std::nullopt;
  }
  const double max_deviation = options.max_deviation_deg / kDegrees;
  Eigen::Vector3d up = proposals.front();
  double best = -1.0;
  for (const Eigen::Vector3d& proposal : proposals) {
    const double score = Score(witnesses, proposal, max_deviation);
    if (score > best) up = proposal;
    best = std::max(best, score);
  }
  up = Refine(witnesses, up, max_deviation);
  double agreeing = 0.0;
  double total = 0.0;
  double squared = 0.0;
  for (const Witness& witness : witnesses) {
    const double deviation = witness.Deviation(up);
    total += witness.weight;
    if (deviation > max_deviation) continue;
    agreeing += witness.weight;
    squared += witness.weight * deviation * deviation;
    ++report.num_agreeing;
  }
  if (agreeing < 0.5 * total) {
    report.reason = "the planes do not agree on what is up";
    return std::nullopt;
  }
  report.deviation_deg = kDegrees * std::sqrt(squared / agreeing);
  return Eigen::Vector3d(SignOfUp(witnesses, model, up) * up);
}

}  // namespace

void GravityOptions::Visit(OptionVisitor& v) {
  v.Choice("mode", mode, kModeNames,
           "off; upright: z of the output points up, by the planes of classes that are horizontal "
           "or vertical by nature; floor: and the lowest level plane is at z = 0");
  v.Value("max_deviation_deg", max_deviation_deg,
          "planes that lie otherwise than their class should by more say nothing [deg]", 0.1, 45.0);
  v.Value("min_points", min_points, "planes with fewer points say nothing", 3, 1000000);
  v.Value("min_floor_share", min_floor_share,
          "part of the points on level planes that the floor must have", 0.0, 1.0);
}

std::optional<Eigen::Vector3d> FindUp(const GravityOptions& options, const SemanticMap& semantics,
                                      const Reconstruction& model, GravityReport& report) {
  return FindUp(options, CollectWitnesses(options, semantics), model, report);
}

std::optional<Similarity3> AlignWithGravity(const GravityOptions& options,
                                            const SemanticMap& semantics,
                                            const Reconstruction& model, GravityReport& report) {
  const std::vector<Witness> witnesses = CollectWitnesses(options, semantics);
  const auto up = FindUp(options, witnesses, model, report);
  if (!up) return std::nullopt;
  report.aligned = true;
  report.turned_deg = kDegrees * std::acos(std::clamp(up->z(), -1.0, 1.0));
  Similarity3 upright_from_world;
  upright_from_world.rotation = Eigen::Quaterniond::FromTwoVectors(*up, Eigen::Vector3d::UnitZ());
  if (options.mode != GravityMode::kFloor) return upright_from_world;
  const Witness* floor = FindFloor(options, witnesses, *up);
  if (floor == nullptr) {
    report.reason = "no level plane below the cameras to be the floor";
    return upright_from_world;
  }
  report.floor = floor->id;
  report.floor_class =
      semantics.class_table.classes[semantics.planes.at(floor->id).class_index].name;
  upright_from_world.translation.z() = -up->dot(floor->centroid);
  return upright_from_world;
}

}  // namespace s3lam
