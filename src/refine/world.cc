#include "world.h"

#include <cmath>

#include "s3lam/base/log.h"

namespace s3lam::refine {
namespace {

void TransformTrajectory(const Similarity3& new_from_old, Trajectory& trajectory) {
  for (TimedPose& pose : trajectory) {
    pose.world_from_camera =
        TransformCameraPose(new_from_old, pose.world_from_camera.Inverse()).Inverse();
  }
}

/// A map and what is known of it into another world, or other units.
void TransformMap(const Similarity3& new_from_old, Reconstruction& model, SemanticMap& semantics) {
  TransformReconstruction(new_from_old, model);
  for (auto& [id, cluster] : semantics.clusters) {
    cluster.centroid_in_world = new_from_old * cluster.centroid_in_world;
  }
  for (auto& [id, surface] : semantics.planes) {
    surface.plane_in_world = TransformPlane(new_from_old, surface.plane_in_world);
    surface.centroid_in_world = new_from_old * surface.centroid_in_world;
    surface.axis_u_in_world = new_from_old.rotation * surface.axis_u_in_world;
    surface.axis_v_in_world = new_from_old.rotation * surface.axis_v_in_world;
    for (Eigen::Vector2d& corner : surface.extent) corner *= new_from_old.scale;
    surface.rms *= new_from_old.scale;
    // Two rotations [rad] about the axes and a shift [map units].
    surface.covariance.row(2) *= new_from_old.scale;
    surface.covariance.col(2) *= new_from_old.scale;
  }
  semantics.model_fingerprint = FingerprintOfModel(model);
}

void TransformOutput(const Similarity3& new_from_old, Output& output) {
  TransformMap(new_from_old, output.model, output.semantics);
  TransformTrajectory(new_from_old, output.keyframes);
  TransformTrajectory(new_from_old, output.frames);
}

Similarity3 ShiftBy(const Eigen::Vector3d& shift) {
  return {1.0, Eigen::Quaterniond::Identity(), shift};
}

void RestoreConstants(const Constraints& constraints, const Reconstruction& given,
                      Reconstruction& model) {
  for (const ImageId id : constraints.constant_images) {
    const auto image = model.images.find(id);
    if (image != model.images.end()) {
      image->second.cam_from_world = given.images.at(id).cam_from_world;
    }
  }
  for (const PointId id : constraints.constant_points) {
    const auto point = model.points.find(id);
    if (point != model.points.end()) point->second.xyz = given.points.at(id).xyz;
  }
}

Similarity3 MoveToChosenWorld(const Options& options, Output& output, Report& report) {
  Similarity3 new_from_old;
  if (report.ground.in_use && options.camera_height.value > 0.0) {
    report.metres_per_unit = options.camera_height.value / report.ground.height;
    new_from_old.scale = report.metres_per_unit;
    TransformOutput(new_from_old, output);
  }
  if (options.gravity.mode == GravityMode::kOff) return new_from_old;
  const auto upright_from_world =
      AlignWithGravity(options.gravity, output.semantics, output.model, report.gravity);
  if (!upright_from_world) {
    spdlog::warn("the output is not aligned with gravity: {}", report.gravity.reason);
    return new_from_old;
  }
  TransformOutput(*upright_from_world, output);
  return *upright_from_world * new_from_old;
}

void WarnOfMovedWorld(const Constraints& constraints, const Similarity3& new_from_old) {
  const bool is_held = !constraints.constant_images.empty() ||
                       !constraints.constant_points.empty() || !constraints.pose_priors.empty();
  const bool is_moved = new_from_old.scale != 1.0 ||
                        new_from_old.rotation.vec() != Eigen::Vector3d::Zero() ||
                        new_from_old.translation != Eigen::Vector3d::Zero();
  if (!is_held || !is_moved) return;
  spdlog::warn(
      "the output is in another world than its constant parts and pose priors were: "
      "camera_height.value sets the scale anew, gravity.mode the rotation");
}

}  // namespace

void TransformInput(const Similarity3& new_from_old, Input& input) {
  TransformMap(new_from_old, input.model, input.semantics);
  TransformTrajectory(new_from_old, input.frames);
}

std::optional<Eigen::Vector3d> FarPlaceOf(const Reconstruction& model) {
  constexpr double kFarInSpreads = 30.0;
  const auto count = static_cast<double>(model.images.size());
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const auto& [id, image] : model.images) mean += image.cam_from_world.CenterInB() / count;
  double squared_spread = 0.0;
  for (const auto& [id, image] : model.images) {
    squared_spread += (image.cam_from_world.CenterInB() - mean).squaredNorm() / count;
  }
  if (mean.norm() <= kFarInSpreads * std::sqrt(squared_spread)) return std::nullopt;
  return mean;
}

Input BroughtToOrigin(const Eigen::Vector3d& place, const Input& given) {
  Input input = given;
  const Similarity3 shift = ShiftBy(-place);
  TransformInput(shift, input);
  for (PosePrior& prior : input.constraints.pose_priors) {
    prior.cam_from_world = TransformCameraPose(shift, prior.cam_from_world);
  }
  return input;
}

void ReturnToPlace(const Eigen::Vector3d& place, const Input& given, Output& output) {
  TransformOutput(ShiftBy(place), output);
  RestoreConstants(given.constraints, given.model, output.model);
  output.semantics.model_fingerprint = FingerprintOfModel(output.model);
}

Similarity3 ChooseWorld(const Options& options, const Constraints& constraints, Output& output,
                        Report& report) {
  const Similarity3 new_from_old = MoveToChosenWorld(options, output, report);
  WarnOfMovedWorld(constraints, new_from_old);
  return new_from_old;
}

}  // namespace s3lam::refine
