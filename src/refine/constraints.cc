#include "s3lam/refine/constraints.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "s3lam/base/error.h"
#include "s3lam/base/statistics.h"
#include "s3lam/geometry/alignment.h"

namespace s3lam {
namespace {

/// Places within this part of their extent from a line leave the rotation about it open.
constexpr double kLeastWidth = 1e-3;

bool DifferentPlaces(const std::vector<Eigen::Vector3d>& places) {
  return std::any_of(places.begin(), places.end(), [&](const Eigen::Vector3d& place) {
    return (place - places.front()).norm() > 0.0;
  });
}

/// True if not all places are on one line.
bool SpanPlane(const std::vector<Eigen::Vector3d>& places) {
  if (places.size() < 3) return false;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& place : places) mean += place / static_cast<double>(places.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& place : places) {
    scatter += (place - mean) * (place - mean).transpose();
  }
  const Eigen::Vector3d extents =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter, Eigen::EigenvaluesOnly).eigenvalues();
  return extents[1] > kLeastWidth * kLeastWidth * extents[2];
}

/// True if the known places and poses leave no freedom: one full pose and one more place, or places
/// that are not on a line.
bool HoldEverything(const BundleProblem& problem, const std::vector<uint8_t>& used_poses) {
  std::vector<Eigen::Vector3d> places;
  size_t full_poses = 0;
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    if (used_poses[i] == 0 || problem.pose_is_constant[i] == 0) continue;
    places.push_back(problem.CenterOf(static_cast<int>(i)));
    ++full_poses;
  }
  for (const PosePriorTerm& prior : problem.pose_priors) {
    if (used_poses[prior.pose] == 0 || !(prior.sigma_position > 0.0)) continue;
    places.push_back(prior.cam_from_world.CenterInB());
    full_poses += prior.sigma_rotation > 0.0;
  }
  int previous = -1;
  for (const BundleObservation& o : problem.observations) {
    if (o.point == previous || !problem.IsConstantPoint(o.point)) continue;
    previous = o.point;
    places.push_back(problem.points[o.point]);
  }
  return SpanPlane(places) || (full_poses >= 1 && DifferentPlaces(places));
}

/// By one full pose and the position farthest from it.
std::optional<Similarity3> AlignByPose(const std::vector<PosePrior>& priors,
                                       const Reconstruction& model) {
  for (const PosePrior& pose : priors) {
    if (!(pose.sigma_position > 0.0 && pose.sigma_rotation > 0.0)) continue;
    const Rigid3& in_model = model.images.at(pose.image_id).cam_from_world;
    const Eigen::Vector3d center = pose.cam_from_world.CenterInB();
    double farthest = 0.0;
    double in_model_units = 0.0;
    for (const PosePrior& other : priors) {
      const double distance = (other.cam_from_world.CenterInB() - center).norm();
      if (!(other.sigma_position > 0.0) || distance <= farthest) continue;
      farthest = distance;
      in_model_units =
          (model.images.at(other.image_id).cam_from_world.CenterInB() - in_model.CenterInB())
              .norm();
    }
    if (!(farthest > 0.0 && in_model_units > 0.0)) continue;
    Similarity3 aligned;
    aligned.scale = farthest / in_model_units;
    aligned.rotation = (pose.cam_from_world.rotation.conjugate() * in_model.rotation).normalized();
    aligned.translation = center - aligned.scale * (aligned.rotation * in_model.CenterInB());
    return aligned;
  }
  return std::nullopt;
}

}  // namespace

std::optional<Similarity3> PriorWorldFromModel(const Constraints& constraints,
                                               const Reconstruction& model) {
  constexpr double kOtherWorldSigmas = 10.0;
  if (!constraints.constant_images.empty() || !constraints.constant_points.empty()) return {};
  std::vector<Eigen::Vector3d> known;
  std::vector<Eigen::Vector3d> in_model;
  std::vector<double> misfits;
  for (const PosePrior& prior : constraints.pose_priors) {
    const auto image = model.images.find(prior.image_id);
    if (image == model.images.end()) return {};
    if (!(prior.sigma_position > 0.0)) continue;
    known.push_back(prior.cam_from_world.CenterInB());
    in_model.push_back(image->second.cam_from_world.CenterInB());
    misfits.push_back((known.back() - in_model.back()).norm() / prior.sigma_position);
  }
  if (misfits.empty() || Median(misfits) <= kOtherWorldSigmas) return {};
  if (SpanPlane(known) && SpanPlane(in_model)) return AlignPoints(known, in_model);
  return AlignByPose(constraints.pose_priors, model);
}

void ApplyConstraints(const Constraints& constraints, BundleMap& map) {
  BundleProblem& problem = map.problem;
  const auto pose_of = [&](ImageId id) {
    const auto it = std::lower_bound(map.image_ids.begin(), map.image_ids.end(), id);
    return it != map.image_ids.end() && *it == id ? static_cast<int>(it - map.image_ids.begin())
                                                  : -1;
  };
  for (const ImageId id : constraints.constant_images) {
    const int pose = pose_of(id);
    if (pose >= 0) problem.pose_is_constant[pose] = 1;
  }
  if (!constraints.constant_points.empty()) {
    problem.point_is_constant.assign(problem.points.size(), 0);
  }
  for (const PointId id : constraints.constant_points) {
    const int point = map.IndexOfPoint(id);
    if (point >= 0) problem.point_is_constant[point] = 1;
  }
  for (const PosePrior& prior : constraints.pose_priors) {
    const int pose = pose_of(prior.image_id);
    if (pose < 0) ThrowInputError("pose prior of image {}: no such image", prior.image_id.value());
    problem.pose_priors.push_back(
        {pose, prior.cam_from_world, prior.sigma_position, prior.sigma_rotation});
  }
}

Gauge ChooseGaugeWithConstraints(const BundleProblem& problem) {
  const std::vector<uint8_t> used = problem.UsedPoses();
  if (HoldEverything(problem, used)) return {};
  if (!problem.pose_priors.empty()) {
    ThrowInputError(
        "the pose priors and constant parts leave place, rotation or scale of the map open: they "
        "need one pose and another position, or three positions that are not on a line");
  }
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    if (used[i] != 0 && problem.pose_is_constant[i] != 0) {
      return ChooseGauge(problem, static_cast<int>(i));
    }
  }
  return ChooseGauge(problem);
}

}  // namespace s3lam
