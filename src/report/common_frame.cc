#include "s3lam/report/common_frame.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numbers>

#include "s3lam/base/statistics.h"
#include "s3lam/geometry/alignment.h"
#include "s3lam/report/measures.h"

namespace s3lam::report {
namespace {

using Eigen::Vector3d;

/// Mean of the cameras' upward directions, not normalised.
Vector3d MeanUp(const Reconstruction& model) {
  Vector3d sum = Vector3d::Zero();
  for (const auto& [id, image] : model.images) {
    sum -= image.cam_from_world.rotation.conjugate() * Vector3d::UnitY();
  }
  return model.images.empty() ? sum : (sum / static_cast<double>(model.images.size())).eval();
}

Vector3d UpInArm(const Arm& arm, const std::optional<SemanticMap>& semantics) {
  const Vector3d mean = MeanUp(arm.model);
  const Vector3d cameras_up = mean.norm() > 1e-3 ? mean.normalized() : Vector3d::UnitZ();
  // Cameras may be held at a slant; a surface that is horizontal by nature may then be farther from
  // their mean than one that is not known to be.
  const double cos_known = std::cos(60.0 * std::numbers::pi / 180.0);
  const double cos_any = std::cos(35.0 * std::numbers::pi / 180.0);
  Vector3d up = cameras_up;
  bool best_known = false;
  size_t most = 0;
  for (const PlanarSurface& plane : arm.planes) {
    const auto& c = semantics->class_table.classes.at(static_cast<size_t>(plane.class_index));
    const bool known = c.orientation == SurfaceOrientation::kHorizontal;
    if (c.orientation == SurfaceOrientation::kVertical) continue;
    const double cosine = plane.plane_in_world.normal.dot(cameras_up);
    if (std::abs(cosine) < (known ? cos_known : cos_any)) continue;
    if (known < best_known || (known == best_known && plane.inliers.size() <= most)) continue;
    best_known = known;
    most = plane.inliers.size();
    up = cosine < 0.0 ? -plane.plane_in_world.normal : plane.plane_in_world.normal;
  }
  return up;
}

Vector3d MedianPoint(const Reconstruction& model) {
  Vector3d middle;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const auto& [id, point] : model.points) values.push_back(point.xyz[axis]);
    middle[axis] = InterpolatedMedian(std::move(values));
  }
  return middle;
}

/// The direction at right angles to `up` in which the nearer nine tenths of the points spread most.
Vector3d LongSide(const Reconstruction& model, const Vector3d& middle, const Vector3d& up) {
  std::vector<std::pair<double, Vector3d>> arms;
  for (const auto& [id, point] : model.points) {
    const Vector3d arm = point.xyz - middle;
    const Vector3d flat = arm - up.dot(arm) * up;
    arms.emplace_back(flat.squaredNorm(), flat);
  }
  std::sort(arms.begin(), arms.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < arms.size() - arms.size() / 10; ++i) {
    scatter += arms[i].second * arms[i].second.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  Vector3d side = solver.eigenvectors().col(2);
  side -= up.dot(side) * up;
  if (!(side.norm() > 1e-6)) side = up.unitOrthogonal();
  // The sign of an eigenvector is arbitrary: the cameras' side is the viewer's, who is at -y.
  Vector3d cameras = Vector3d::Zero();
  for (const auto& [id, image] : model.images) cameras += image.cam_from_world.CenterInB() - middle;
  if (cameras.dot(up.cross(side)) > 0.0) side = -side;
  return side.normalized();
}

/// The view's rotation and origin, in the arm's scale.
Similarity3 ViewFromArm(const Arm& arm, const std::optional<SemanticMap>& semantics) {
  const Vector3d up = UpInArm(arm, semantics);
  const Vector3d middle = MedianPoint(arm.model);
  const Vector3d side = LongSide(arm.model, middle, up);
  Eigen::Matrix3d axes;
  axes << side.transpose(), up.cross(side).transpose(), up.transpose();
  const Eigen::Quaterniond rotation = Eigen::Quaterniond(axes).normalized();
  return {1.0, rotation, -(rotation * middle)};
}

/// The similarity that brings the cameras of one arm onto those of another; none if they do not
/// determine it.
Similarity3 AlignCameras(const Reconstruction& a, const Reconstruction& b) {
  std::vector<Vector3d> in_a;
  std::vector<Vector3d> in_b;
  for (const auto& [id, image] : b.images) {
    const auto other = a.images.find(id);
    if (other == a.images.end()) continue;
    in_a.push_back(other->second.cam_from_world.CenterInB());
    in_b.push_back(image.cam_from_world.CenterInB());
  }
  return AlignPoints(in_a, in_b).value_or(Similarity3{});
}

ArmErrors MeasureErrors(const Arm& arm, const Trajectory& truth, double max_dt_s,
                        const Similarity3& truth_from_arm, const Similarity3& view_from_truth) {
  ArmErrors errors;
  for (const auto& [i, j] : AssociateByTime(arm.trajectory, truth, max_dt_s)) {
    const Vector3d in_truth = truth_from_arm * arm.trajectory[i].world_from_camera.translation;
    errors.time_s.push_back(truth[j].time_s - truth.front().time_s);
    errors.error.push_back((in_truth - truth[j].world_from_camera.translation).norm());
    errors.position_in_view.push_back(view_from_truth * in_truth);
  }
  errors.rmse = RootMeanSquare(errors.error);
  return errors;
}

/// Empty if any arm's trajectory cannot be aligned.
std::vector<Similarity3> AlignToTruth(const RunFolder& run, const Trajectory& truth,
                                      const TrajectoryErrorOptions& options, std::string& note) {
  std::vector<Similarity3> truth_from_arm;
  for (const Arm& arm : run.arms) {
    const auto compared = CompareTrajectories(arm.trajectory, truth, options);
    if (!compared) {
      note = fmt::format(
          "The ground truth cannot be compared with \"{}\": {} of {} poses have a counterpart "
          "within {} s, or all lie on one line.",
          arm.title, AssociateByTime(arm.trajectory, truth, options.max_dt_s).size(),
          arm.trajectory.size(), options.max_dt_s);
      return {};
    }
    truth_from_arm.push_back(compared->truth_from_estimate);
  }
  return truth_from_arm;
}

}  // namespace

CommonFrame MakeCommonFrame(const RunFolder& run, const Trajectory& truth,
                            const TrajectoryErrorOptions& options) {
  CommonFrame frame;
  frame.unit = "map units";
  const Arm& last = run.arms.back();
  const Similarity3 oriented_from_last = ViewFromArm(last, run.semantics);
  std::vector<Similarity3> truth_from_arm;
  if (!truth.empty()) truth_from_arm = AlignToTruth(run, truth, options, frame.note);
  if (truth_from_arm.empty()) {
    for (const Arm& arm : run.arms) {
      frame.view_from_arm.push_back(&arm == &last
                                        ? oriented_from_last
                                        : oriented_from_last * AlignCameras(last.model, arm.model));
    }
    return frame;
  }
  frame.unit = "ground truth's unit";
  const Similarity3 scaled{truth_from_arm.back().scale, Eigen::Quaterniond::Identity(),
                           Vector3d::Zero()};
  const Similarity3 view_from_truth = scaled * oriented_from_last * truth_from_arm.back().Inverse();
  for (size_t k = 0; k < run.arms.size(); ++k) {
    frame.view_from_arm.push_back(view_from_truth * truth_from_arm[k]);
    frame.errors.push_back(
        MeasureErrors(run.arms[k], truth, options.max_dt_s, truth_from_arm[k], view_from_truth));
  }
  for (const TimedPose& pose : truth) {
    frame.truth_in_view.push_back(view_from_truth * pose.world_from_camera.translation);
  }
  return frame;
}

}  // namespace s3lam::report
