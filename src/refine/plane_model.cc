#include "s3lam/refine/plane_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

#include "plane_distance.h"
#include "s3lam/base/statistics.h"
#include "s3lam/robust/plane_fit.h"

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 3> kSigmaKindNames{"pixel", "relative_depth", "metric"};
constexpr std::array<std::string_view, 4> kPlaneModeNames{"off", "fixed", "joint", "hard"};

/// Box of a plane's inliers along its in-plane axes.
struct Extent {
  Eigen::Vector3d centroid, u, v;
  Eigen::Vector2d low, high;

  [[nodiscard]] bool Contains(const Eigen::Vector3d& x) const {
    const Eigen::Vector2d uv(u.dot(x - centroid), v.dot(x - centroid));
    return (uv.array() >= low.array()).all() && (uv.array() <= high.array()).all();
  }
};

Extent ExtentOfInliers(const PlanarSurface& surface, const std::vector<int>& inliers,
                       const BundleProblem& problem, double margin) {
  const auto [u, v] = PlaneAxes(surface.plane_in_world.normal);
  Extent extent{Eigen::Vector3d::Zero(), u, v, Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
  for (const int i : inliers) {
    extent.centroid += problem.points[i] / static_cast<double>(inliers.size());
  }
  for (const int i : inliers) {
    const Eigen::Vector3d arm = problem.points[i] - extent.centroid;
    const Eigen::Vector2d uv(u.dot(arm), v.dot(arm));
    extent.low = extent.low.cwiseMin(uv);
    extent.high = extent.high.cwiseMax(uv);
  }
  const Eigen::Vector2d grow = margin * (extent.high - extent.low);
  extent.low -= grow;
  extent.high += grow;
  return extent;
}

std::vector<int> IndicesOf(const std::vector<PointId>& ids, const BundleMap& map) {
  std::vector<int> indices;
  for (const PointId id : ids) {
    const int index = map.IndexOfPoint(id);
    if (index >= 0) indices.push_back(index);
  }
  std::sort(indices.begin(), indices.end());
  indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
  return indices;
}

/// Gives every point that is in a cluster but no plane's inlier to the nearest plane of the cluster
/// whose extent it is within.
void AddNearbyPoints(const SemanticMap& semantics, const BundleMap& map,
                     const std::vector<Extent>& extents, PlaneModel& model) {
  std::vector<uint8_t> taken(map.point_ids.size(), 0);
  std::map<ClusterId, std::vector<int>> planes_of_cluster;
  for (size_t k = 0; k < model.planes.size(); ++k) {
    planes_of_cluster[model.planes[k].cluster_id].push_back(static_cast<int>(k));
    for (const int i : model.planes[k].candidates) taken[i] = 1;
  }
  for (const auto& [cluster_id, planes] : planes_of_cluster) {
    for (const int i : IndicesOf(semantics.clusters.at(cluster_id).points, map)) {
      if (taken[i] != 0) continue;
      int nearest = -1;
      for (const int k : planes) {
        if (!extents[k].Contains(map.problem.points[i])) continue;
        if (nearest < 0 ||
            std::abs(Distance(map.problem, k, i)) < std::abs(Distance(map.problem, nearest, i))) {
          nearest = k;
        }
      }
      if (nearest >= 0) model.planes[nearest].candidates.push_back(i);
    }
  }
  for (PlaneState& plane : model.planes) {
    std::sort(plane.candidates.begin(), plane.candidates.end());
  }
}

/// Where a candidate of a plane belongs.
struct Verdict {
  bool is_near = false;      // A member, if it is not expelled.
  bool is_outlier = false;   // Looked at, and not near.
  bool is_expelled = false;  // A candidate no more.
};

Verdict Judge(const MembershipOptions& options, const PlaneSigmaOptions& sigma_options,
              const BundleSolverOptions& solver, const PlaneModel& model,
              const BundleProblem& problem, int plane, int point, bool was_member) {
  if (!(model.keypoint_size[point] > 0.0)) return {};
  const PlaneState& state = model.planes[plane];
  Verdict verdict;
  // The heights of cameras pull at the ground; points that could then leave it would undo that.
  if (state.is_ground && !state.members.empty()) {
    verdict.is_near = was_member;
    return verdict;
  }
  const double sigma = PlaneSigma(sigma_options, model, solver.sigma_px, state, point);
  const double variance = NormalVariance(model, problem, plane, point);
  double distance = Distance(problem, plane, point);
  if (was_member && !problem.IsConstantPoint(point)) {
    distance = FreeDistance(distance, variance, sigma, solver.huber_plane);
  }
  const double innovation = Innovation(distance, variance, sigma);
  verdict.is_near = innovation <= options.max_sigma &&
                    std::sqrt(variance + sigma * sigma) <= state.max_uncertainty;
  verdict.is_outlier = !verdict.is_near;
  verdict.is_expelled = innovation > options.leave_sigma;
  return verdict;
}

/// One term per member of each plane.
void WriteTerms(const PlaneSigmaOptions& options, double sigma_px, const PlaneModel& model,
                BundleProblem& problem) {
  problem.points_on_planes.clear();
  for (size_t k = 0; k < model.planes.size(); ++k) {
    const PlaneState& state = model.planes[k];
    if (!state.in_use) continue;
    const double strength = state.is_ground ? model.ground_strength : 1.0;
    for (const int i : state.members) {
      problem.points_on_planes.push_back(
          {i, static_cast<int>(k), PlaneSigma(options, model, sigma_px, state, i) / strength});
    }
  }
  std::sort(problem.points_on_planes.begin(), problem.points_on_planes.end(),
            [](const PointOnPlane& a, const PointOnPlane& b) {
              return std::pair(a.point, a.plane) < std::pair(b.point, b.plane);
            });
}

}  // namespace

void PlaneSigmaOptions::Visit(OptionVisitor& v) {
  v.Choice("kind", kind, kSigmaKindNames,
           "sigma of a point-plane distance: kappa x sigma_px x depth / f with kappa measured per "
           "class, alpha x median depth, or metres");
  v.Value(
      "min_kappa", min_kappa,
      "least kappa of a class (kind pixel): what the keypoints of a track err by in common, which "
      "planes that follow the points do not show",
      1e-6, 1e6);
  v.Value("max_roughness_px", max_roughness_px,
          "kappa x sigma_px is no larger than this (or three sigma_px): what departs more from a "
          "plane is not on it "
          "(kind pixel) [px]",
          1e-6, 1e6);
  v.Value("alpha", alpha, "part of the map's median depth (kind relative_depth)", 1e-9, 1e3);
  v.Value("metres", metres, "sigma (kind metric) [m]", 1e-9, 1e3);
  v.Value("metres_per_unit", metres_per_unit, "length of a map unit (kind metric) [m]", 1e-9, 1e9);
}

void PlaneOptions::Visit(OptionVisitor& v) {
  v.Choice("mode", mode, kPlaneModeNames,
           "off: plain bundle adjustment; fixed: planes held in a solve and fitted anew between "
           "solves; joint: planes optimised too; hard: joint, and the points of planes with "
           "overwhelming evidence are moved onto them");
  v.Group("sigma", sigma, "Strength of the point-plane terms.");
  v.Group("membership", membership, "Which points lie on a plane.");
}

std::string PlaneModeName(PlaneMode mode) {
  return std::string(kPlaneModeNames[static_cast<size_t>(mode)]);
}

void MembershipOptions::Visit(OptionVisitor& v) {
  v.Value("max_sigma", max_sigma,
          "points farther from their plane have no term (1.96: 95 % of chi-squared with 1 dof)",
          0.1, 1e6);
  v.Value("leave_sigma", leave_sigma, "points farther from their plane leave it for good", 0.1,
          1e6);
  v.Value("extent_margin", extent_margin,
          "points of a cluster may join a plane within its extent grown by this part", 0.0, 100.0);
  v.Value("min_points", min_points, "a plane with fewer points is not used", 3, 1000000);
  v.Group("cells", cells, "Parts of a surface that do not lie on its plane.");
}

PlaneModel BuildPlaneModel(const MembershipOptions& options, const SemanticMap& semantics,
                           BundleMap& map) {
  PlaneModel model;
  std::vector<Extent> extents;
  for (const auto& [id, surface] : semantics.planes) {
    model.next_id = id.value() + 1;  // Ascending.
    PlaneState plane;
    plane.id = id;
    plane.cluster_id = surface.cluster_id;
    plane.class_index = surface.class_index;
    plane.candidates = IndicesOf(surface.inliers, map);
    if (static_cast<int>(plane.candidates.size()) < options.min_points) continue;
    extents.push_back(
        ExtentOfInliers(surface, plane.candidates, map.problem, options.extent_margin));
    map.problem.planes.push_back(
        AnchoredPlane::FromPlane(surface.plane_in_world, extents.back().centroid));
    model.planes.push_back(std::move(plane));
  }
  AddNearbyPoints(semantics, map, extents, model);
  model.kappa_of_class.assign(static_cast<size_t>(semantics.class_table.size()), 0.0);
  return model;
}

void FreezeUncertainty(const BundleProblem& problem, double sigma_px, PlaneModel& model) {
  model.keypoint_size = KeypointSizes(problem);
  model.covariances = TriangulationCovariances(problem, sigma_px);
  const std::vector<double> pixel_size = PixelSizes(problem);
  std::vector<double> depths;
  for (const BundleObservation& o : problem.observations) {
    const Camera& camera = problem.cameras[problem.camera_of_pose[o.pose]];
    depths.push_back(pixel_size[o.point] * camera.MeanFocal());
  }
  model.median_depth = Median(std::move(depths));
}

double PlaneSigma(const PlaneSigmaOptions& options, const PlaneModel& model, double sigma_px,
                  const PlaneState& plane, int point) {
  switch (options.kind) {
    case PlaneSigmaKind::kRelativeDepth:
      return options.alpha * model.median_depth;
    case PlaneSigmaKind::kMetric:
      return options.metres / options.metres_per_unit;
    case PlaneSigmaKind::kPixel:
      break;
  }
  return plane.kappa * sigma_px * model.keypoint_size[point];
}

std::vector<UncertainPoint> UncertainPoints(const PlaneSigmaOptions& options, double sigma_px,
                                            const PlaneState& state,
                                            const std::vector<int>& indices,
                                            const PlaneModel& model, const BundleProblem& problem) {
  std::vector<UncertainPoint> points;
  points.reserve(indices.size());
  for (const int i : indices) {
    const double sigma = PlaneSigma(options, model, sigma_px, state, i);
    points.push_back(
        {problem.points[i], model.covariances[i] + sigma * sigma * Eigen::Matrix3d::Identity()});
  }
  return points;
}

std::optional<PlaneFit> FitMembers(const PlaneSigmaOptions& options, double sigma_px,
                                   const PlaneState& state, const PlaneModel& model,
                                   const BundleProblem& problem) {
  std::vector<int> members;
  for (const int i : state.members) {
    if (model.keypoint_size[i] > 0.0) members.push_back(i);
  }
  std::vector<size_t> all(members.size());
  std::iota(all.begin(), all.end(), size_t{0});
  return FitPlane(UncertainPoints(options, sigma_px, state, members, model, problem), all);
}

void RefitPlanes(const PlaneSigmaOptions& options, double sigma_px, bool constant_only,
                 PlaneModel& model, BundleProblem& problem) {
  for (size_t k = 0; k < model.planes.size(); ++k) {
    const PlaneState& state = model.planes[k];
    if (!state.in_use || (constant_only && !problem.planes[k].is_constant)) continue;
    const auto fit = FitMembers(options, sigma_px, state, model, problem);
    if (!fit) continue;
    AnchoredPlane& plane = problem.planes[k];
    Plane fitted = fit->plane;
    if (fitted.normal.dot(plane.parameters.head<3>()) < 0.0) {
      fitted = {-fitted.normal, -fitted.offset};
    }
    const bool is_constant = plane.is_constant;
    plane = AnchoredPlane::FromPlane(fitted, plane.anchor_in_world);
    plane.is_constant = is_constant;
  }
}

MembershipCounts AssignPoints(const MembershipOptions& options, const PlaneSigmaOptions& sigma,
                              const BundleSolverOptions& solver, PlaneModel& model,
                              BundleProblem& problem) {
  MembershipCounts counts;
  for (size_t k = 0; k < model.planes.size(); ++k) {
    PlaneState& state = model.planes[k];
    if (!state.in_use) continue;
    std::vector<int> members;
    std::vector<int> kept;
    for (const int i : state.candidates) {
      const bool was_member = std::binary_search(state.members.begin(), state.members.end(), i);
      const Verdict verdict =
          Judge(options, sigma, solver, model, problem, static_cast<int>(k), i, was_member);
      const bool is_member = verdict.is_near && !verdict.is_expelled;
      counts.outliers += verdict.is_outlier;
      counts.expelled += verdict.is_expelled;
      counts.changed += is_member != was_member;
      if (is_member) members.push_back(i);
      if (!verdict.is_expelled) kept.push_back(i);
    }
    state.in_use = static_cast<int>(members.size()) >= options.min_points;
    if (!state.in_use) members.clear();
    state.candidates = std::move(kept);
    state.members = std::move(members);
    counts.members += state.members.size();
  }
  WriteTerms(sigma, solver.sigma_px, model, problem);
  return counts;
}

void DropUnusedStructure(const PlaneModel& model, BundleProblem& problem) {
  const auto unused = [&](int plane) { return !model.planes[plane].in_use; };
  std::erase_if(problem.relations, [&](const RelationTerm& term) {
    return unused(term.plane_a) || unused(term.plane_b);
  });
  std::erase_if(problem.heights, [&](const HeightTerm& term) { return unused(term.plane); });
}

}  // namespace s3lam
