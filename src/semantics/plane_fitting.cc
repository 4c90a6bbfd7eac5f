#include "s3lam/semantics/plane_fitting.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>
#include <vector>

#include "plane_patches.h"
#include "s3lam/base/log.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/statistics.h"
#include "s3lam/geometry/convex_hull.h"

namespace s3lam {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr size_t kLeastPart = 10;  // Points, to tell whether a plane is two.

/// Depth of a point: the median over the cameras that observe it.
double MedianDepthOf(const Reconstruction& reconstruction, const ScenePoint& point) {
  std::vector<double> depths;
  for (const TrackElement& element : point.track) {
    depths.push_back((reconstruction.images.at(element.image_id).cam_from_world * point.xyz).z());
  }
  return Median(std::move(depths));
}

/// The points of a cluster that are known well enough to tell where a surface is.
struct Candidates {
  std::vector<PointId> ids;
  std::vector<UncertainPoint> points;
  double median_depth = 0.0;
};

Candidates FindCandidates(const Reconstruction& reconstruction, const Cluster& cluster,
                          double sigma_px, const PlaneFittingOptions& options) {
  Candidates result;
  std::vector<double> depths;
  for (const PointId id : cluster.points) {
    const ScenePoint& point = reconstruction.points.at(id);
    const auto covariance = PointCovariance(reconstruction, point, sigma_px);
    const double depth = MedianDepthOf(reconstruction, point);
    if (!covariance || !(depth > 0.0)) continue;
    const double roughness = options.roughness * depth;
    const double limit = options.max_point_sigma * depth;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(*covariance,
                                                                Eigen::EigenvaluesOnly);
    const double largest = solver.eigenvalues().maxCoeff() + roughness * roughness;
    if (!(largest < limit * limit)) continue;
    result.ids.push_back(id);
    result.points.push_back({point.xyz, *covariance, roughness});
    depths.push_back(depth);
  }
  result.median_depth = Median(std::move(depths));
  return result;
}

/// Joins planes of a cluster that are one surface, until none are. A surface whose points are less
/// certain than they claim first comes apart into parallel layers.
void JoinLayers(const Candidates& candidates, const PlaneFittingOptions& options,
                std::vector<size_t> rest, std::vector<PlaneFit>& fits) {
  const JoinLimits apart{options.merge_angle_deg * kRadPerDeg, options.merge_sigmas};
  const JoinLimits layered{options.layer_angle_deg * kRadPerDeg, options.layer_sigmas};
  for (size_t a = 0; a < fits.size(); ++a) {
    bool has_grown = false;
    for (size_t b = a + 1; b < fits.size();) {
      auto joint = JoinPlanes(candidates.points, fits[a], fits[b], apart, layered);
      if (!joint) {
        ++b;
        continue;
      }
      fits[a] = std::move(*joint);
      fits.erase(fits.begin() + static_cast<std::ptrdiff_t>(b));
      has_grown = true;
      b = a + 1;  // The grown plane may now reach one passed over.
    }
    if (!has_grown) continue;
    fits[a] = GatherPoints(candidates.points, rest, std::move(fits[a]), options.fit.inlier_sigmas);
    std::vector<size_t> remaining;
    std::set_difference(rest.begin(), rest.end(), fits[a].inliers.begin(), fits[a].inliers.end(),
                        std::back_inserter(remaining));
    rest = std::move(remaining);
  }
}

/// True if most observations of the inliers come from behind the plane.
bool FacesAway(const Reconstruction& reconstruction, const PlanarSurface& surface) {
  int in_front = 0;
  int behind = 0;
  for (const PointId id : surface.inliers) {
    for (const TrackElement& element : reconstruction.points.at(id).track) {
      const Eigen::Vector3d center =
          reconstruction.images.at(element.image_id).cam_from_world.CenterInB();
      ++(surface.plane_in_world.SignedDistance(center) >= 0.0 ? in_front : behind);
    }
  }
  return behind > in_front;
}

PlanarSurface MakeSurface(const Reconstruction& reconstruction, const Cluster& cluster,
                          const Candidates& candidates, const PlaneFit& fit) {
  PlanarSurface surface;
  surface.cluster_id = cluster.id;
  surface.class_index = cluster.class_index;
  surface.plane_in_world = fit.plane;
  surface.centroid_in_world = fit.centroid;
  surface.axis_u_in_world = fit.axis_u;
  surface.axis_v_in_world = fit.axis_v;
  surface.rms = fit.rms;
  surface.rms_sigma = fit.rms_sigma;
  surface.covariance = fit.covariance;
  for (const size_t i : fit.inliers) surface.inliers.push_back(candidates.ids[i]);
  if (FacesAway(reconstruction, surface)) {
    // Turning the frame half about u keeps it right-handed; rotation about v and shift change sign.
    surface.plane_in_world.normal *= -1.0;
    surface.plane_in_world.offset *= -1.0;
    surface.axis_v_in_world *= -1.0;
    const Eigen::Vector3d signs(1.0, -1.0, -1.0);
    surface.covariance = signs.asDiagonal() * surface.covariance * signs.asDiagonal();
  }
  std::vector<Eigen::Vector2d> outline;
  for (const PointId id : surface.inliers) {
    const Eigen::Vector3d d = reconstruction.points.at(id).xyz - surface.centroid_in_world;
    outline.emplace_back(surface.axis_u_in_world.dot(d), surface.axis_v_in_world.dot(d));
  }
  surface.extent = ConvexHull(std::move(outline));
  return surface;
}

/// Where the normals of a cluster's planes lie, and where they are expected.
struct Bands {
  NormalBand possible;
  NormalBand expected;  // Within the other one.
};

/// The plane that most points support, determined or not. A small surface leaves room for planes of
/// quite different slopes; among such, one as expected is the likelier by far.
std::optional<PlaneFit> FitLikeliestPlane(std::span<const UncertainPoint> points,
                                          const Bands& bands, const PlaneFittingOptions& options,
                                          Rng& rng) {
  auto best = FindPlane(points, options.fit, bands.possible, rng);
  if (!best || !IsDetermined(points, *best, options.fit)) return best;
  if (bands.expected.Contains(best->plane.normal)) return best;
  auto expected = FitPlaneRobustly(points, options.fit, bands.expected, rng);
  const double enough = options.exact_share * static_cast<double>(best->inliers.size());
  if (!expected || static_cast<double>(expected->inliers.size()) < enough) return best;
  return expected;
}

/// What most of the points left of a cluster support: a plane, or points that make none.
struct Finding {
  PlaneFit fit;  // If it is no plane, the inliers alone.
  bool is_plane = false;
};

Finding NoPlane(std::vector<size_t> inliers) {
  Finding finding;
  finding.fit.inliers = std::move(inliers);
  return finding;
}

/// The next plane among the candidates listed in `rest`, as one connected patch of one surface.
std::optional<Finding> FitNextPlane(const Candidates& candidates, const std::vector<size_t>& rest,
                                    size_t min_inliers, const Bands& bands,
                                    const PlaneFittingOptions& options, Rng& rng) {
  std::vector<UncertainPoint> points;
  for (const size_t i : rest) points.push_back(candidates.points[i]);
  const auto whole = FitLikeliestPlane(points, bands, options, rng);
  if (!whole) return std::nullopt;
  const bool is_determined = IsDetermined(points, *whole, options.fit);
  const double max_gap = options.max_gap * candidates.median_depth;
  std::vector<size_t> patch =
      is_determined ? LargestPatch(points, *whole, max_gap) : whole->inliers;
  for (size_t& i : patch) i = rest[i];
  if (!is_determined) return NoPlane(std::move(patch));
  auto fit = FitPlane(candidates.points, patch);
  if (!fit || !bands.possible.Contains(fit->plane.normal)) return NoPlane(std::move(patch));
  PlaneFit part = SplitAtGaps(candidates.points, *fit, kLeastPart);
  const bool is_sound =
      part.inliers.size() >= min_inliers && bands.possible.Contains(part.plane.normal);
  return Finding{is_sound ? std::move(part) : std::move(*fit), true};
}

/// A cluster to fit planes to.
struct Task {
  const Cluster* cluster = nullptr;
  const SemanticClass* semantic_class = nullptr;
  Candidates candidates;
  std::vector<PlanarSurface> surfaces;
  size_t points_left = 0;  // Enough for another plane, had not so many been found already.

  /// Of inliers of a plane.
  [[nodiscard]] size_t LeastNumber(double min_cluster_share) const {
    const double share = min_cluster_share * static_cast<double>(cluster->points.size());
    return static_cast<size_t>(
        std::max(static_cast<double>(semantic_class->min_plane_inliers), share));
  }
};

void FitPlanesToCluster(const Reconstruction& reconstruction, const Bands& bands,
                        const PlaneFittingOptions& options, Rng rng, Task& task) {
  const Candidates& candidates = task.candidates;
  const size_t min_inliers = task.LeastNumber(options.min_cluster_share);
  const auto max_planes = static_cast<size_t>(options.max_planes_per_cluster);
  std::vector<size_t> rest(candidates.ids.size());
  std::iota(rest.begin(), rest.end(), size_t{0});
  std::vector<PlaneFit> fits;
  std::vector<size_t> set_aside;  // Points of what is no plane, or too small for one.
  for (size_t i = 0; i < max_planes && rest.size() >= min_inliers; ++i) {
    auto next = FitNextPlane(candidates, rest, min_inliers, bands, options, rng);
    if (!next) break;
    PlaneFit& fit = next->fit;
    std::vector<size_t> remaining;
    std::set_difference(rest.begin(), rest.end(), fit.inliers.begin(), fit.inliers.end(),
                        std::back_inserter(remaining));
    rest = std::move(remaining);
    if (next->is_plane && fit.inliers.size() >= min_inliers) {
      fits.push_back(std::move(fit));
    } else {
      set_aside.insert(set_aside.end(), fit.inliers.begin(), fit.inliers.end());
    }
  }
  const bool is_cut_short = fits.size() == max_planes && rest.size() >= min_inliers;
  task.points_left = is_cut_short ? rest.size() : 0;
  rest.insert(rest.end(), set_aside.begin(), set_aside.end());
  std::sort(rest.begin(), rest.end());
  JoinLayers(candidates, options, std::move(rest), fits);
  task.surfaces.clear();
  for (const PlaneFit& fit : fits) {
    task.surfaces.push_back(MakeSurface(reconstruction, *task.cluster, candidates,
                                        RefitRobustly(candidates.points, fit)));
  }
}

void WarnIfCutShort(const Task& task, const PlaneFittingOptions& options) {
  if (task.points_left == 0 || options.max_planes_per_cluster == 0) return;
  spdlog::warn(
      "class {}, cluster {}: {} planes found, no more looked for among {} points left "
      "(planes.max_planes_per_cluster)",
      task.semantic_class->name, task.cluster->id.value(), options.max_planes_per_cluster,
      task.points_left);
}

/// Indices of the tasks in the order in which threads are busy to the end.
std::vector<size_t> LargestFirst(const std::vector<Task>& tasks) {
  std::vector<size_t> order(tasks.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return tasks[a].cluster->points.size() > tasks[b].cluster->points.size();
  });
  return order;
}

/// Up to sign, the direction that most inliers of planes of horizontal classes are normal to within
/// `max_angle` [rad]; empty without any such plane.
std::optional<Eigen::Vector3d> EstimateUp(const std::vector<Task>& tasks, double max_angle) {
  std::vector<std::pair<Eigen::Vector3d, double>> votes;
  for (const Task& task : tasks) {
    if (task.semantic_class->orientation != SurfaceOrientation::kHorizontal) continue;
    for (const PlanarSurface& surface : task.surfaces) {
      votes.emplace_back(surface.plane_in_world.normal,
                         static_cast<double>(surface.inliers.size()));
    }
  }
  std::optional<Eigen::Vector3d> best;
  double most = 0.0;
  for (const auto& [candidate, own_weight] : votes) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double support = 0.0;
    for (const auto& [normal, weight] : votes) {
      const double cosine = normal.dot(candidate);
      if (std::abs(cosine) < std::cos(max_angle)) continue;
      sum += (cosine < 0.0 ? -weight : weight) * normal;
      support += weight;
    }
    if (support <= most) continue;
    most = support;
    best = sum.normalized();
  }
  return best;
}

/// Where the normals of a class lie, given which way is up.
NormalBand BandOf(SurfaceOrientation orientation, const Eigen::Vector3d& up, double max_angle) {
  if (orientation == SurfaceOrientation::kHorizontal) return {up, std::cos(max_angle), 1.0};
  if (orientation == SurfaceOrientation::kVertical) return {up, 0.0, std::sin(max_angle)};
  return {};
}

bool AllWithin(const std::vector<PlanarSurface>& surfaces, const NormalBand& band) {
  return std::all_of(surfaces.begin(), surfaces.end(), [&](const PlanarSurface& surface) {
    return band.Contains(surface.plane_in_world.normal);
  });
}

}  // namespace

void PlaneFittingOptions::Visit(OptionVisitor& v) {
  v.Group("fit", fit, "Robust fit of one plane.");
  v.Value("min_keypoint_sigma_px", min_keypoint_sigma_px,
          "Keypoints are not trusted more than this [px]; above it their standard deviation is "
          "estimated from the reprojection errors.",
          0.01);
  v.Value("roughness", roughness, "How far real surfaces depart from a plane [depth of the point].",
          0.0);
  v.Value("max_point_sigma", max_point_sigma,
          "Points less certain than this in any direction are left out [depth of the point].", 0.0);
  v.Value("max_gap", max_gap, "Largest gap within a plane [median depth of the cluster].", 1e-6);
  v.Value("merge_angle_deg", merge_angle_deg,
          "Planes of a cluster are joined within this angle ...", 0.0, 90.0);
  v.Value("merge_sigmas", merge_sigmas,
          "... if their points then scatter by less than this [standard deviations].", 0.0);
  v.Value("layer_angle_deg", layer_angle_deg,
          "Planes of a cluster that lie over each other are joined within this angle ...", 0.0,
          90.0);
  v.Value("layer_sigmas", layer_sigmas,
          "... if their points then scatter by less than this [standard deviations].", 0.0);
  v.Value("orientation_deg", orientation_deg,
          "Planes of classes that are horizontal or vertical by nature are so within this [deg].",
          0.0, 90.0);
  v.Value("exact_deg", exact_deg,
          "Of two planes that fit such a class about equally well, one within this is taken [deg].",
          0.0, 90.0);
  v.Value("exact_share", exact_share,
          "That is, with at least this share of the inliers of the other.", 0.0, 1.0);
  v.Value("max_planes_per_cluster", max_planes_per_cluster, "Planes per cluster at most.", 0);
  v.Value("min_cluster_share", min_cluster_share,
          "A plane has at least this share of its cluster's points.", 0.0, 1.0);
}

double EstimateKeypointSigma(const Reconstruction& reconstruction) {
  std::vector<double> errors;
  for (const auto& [id, point] : reconstruction.points) {
    if (point.track.size() < 2) continue;
    const double correction = ResidualCorrection(point.track.size());
    for (const TrackElement& element : point.track) {
      const Image& image = reconstruction.images.at(element.image_id);
      const auto projected =
          reconstruction.CameraOf(image).ImageFromCamera(image.cam_from_world * point.xyz);
      if (!projected) continue;
      errors.push_back(correction * (*projected - image.points2D[element.point2D_index].xy).norm());
    }
  }
  if (errors.empty()) return 1.0;
  return Median(std::move(errors)) / kMedianOfRayleigh;
}

std::optional<Eigen::Matrix3d> PointCovariance(const Reconstruction& reconstruction,
                                               const ScenePoint& point, double sigma_px) {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  for (const TrackElement& element : point.track) {
    const Image& image = reconstruction.images.at(element.image_id);
    const Eigen::Vector3d x = image.cam_from_world * point.xyz;
    if (!(x.z() > 0.0)) continue;
    const double scale = reconstruction.CameraOf(image).MeanFocal() / x.z();
    Eigen::Matrix<double, 2, 3> jacobian;
    jacobian << scale, 0.0, -scale * x.x() / x.z(), 0.0, scale, -scale * x.y() / x.z();
    jacobian = jacobian * image.cam_from_world.rotation.toRotationMatrix();
    information += jacobian.transpose() * jacobian;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(information);
  constexpr double kMinCondition = 1e-10;
  const Eigen::Vector3d& values = solver.eigenvalues();
  if (!values.allFinite() || !(values[0] > kMinCondition * values[2])) return std::nullopt;
  const Eigen::Matrix3d& vectors = solver.eigenvectors();
  const Eigen::Vector3d variances = sigma_px * sigma_px * values.cwiseInverse();
  return vectors * variances.asDiagonal() * vectors.transpose();
}

void FitPlanes(const Reconstruction& reconstruction, double keypoint_sigma_px,
               const PlaneFittingOptions& options, uint64_t seed, int num_threads,
               SemanticMap& map) {
  const double sigma_px = std::max(options.min_keypoint_sigma_px, keypoint_sigma_px);
  std::vector<Task> tasks;
  for (const auto& [id, cluster] : map.clusters) {
    const SemanticClass& c = map.class_table.classes[static_cast<size_t>(cluster.class_index)];
    if (c.is_planar) tasks.push_back({&cluster, &c, {}, {}, 0});
  }
  const Rng rng(seed);
  const auto fit = [&](Task& task, const Bands& bands) {
    FitPlanesToCluster(reconstruction, bands, options, rng.Fork(task.cluster->id.value()), task);
  };
  const std::vector<size_t> order = LargestFirst(tasks);
  ParallelFor(tasks.size(), num_threads, [&](size_t i) {
    Task& task = tasks[order[i]];
    task.candidates = FindCandidates(reconstruction, *task.cluster, sigma_px, options);
    fit(task, Bands{});
  });
  const double max_angle = options.orientation_deg * kRadPerDeg;
  if (const auto up = EstimateUp(tasks, max_angle)) {
    ParallelFor(tasks.size(), num_threads, [&](size_t i) {
      Task& task = tasks[order[i]];
      const SurfaceOrientation orientation = task.semantic_class->orientation;
      if (orientation == SurfaceOrientation::kAny) return;
      const Bands bands{BandOf(orientation, *up, max_angle),
                        BandOf(orientation, *up, options.exact_deg * kRadPerDeg)};
      if (!AllWithin(task.surfaces, bands.expected)) fit(task, bands);
    });
  }
  map.planes.clear();
  for (Task& task : tasks) {
    WarnIfCutShort(task, options);
    for (PlanarSurface& surface : task.surfaces) {
      surface.id = PlaneId(static_cast<uint32_t>(map.planes.size()));
      map.planes.emplace(surface.id, std::move(surface));
    }
  }
}

}  // namespace s3lam
