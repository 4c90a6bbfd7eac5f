#include "s3lam/refine/pipeline.h"

#include <algorithm>
#include <array>
#include <set>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/refine/constraints.h"
#include "s3lam/refine/frames.h"
#include "s3lam/refine/plane_output.h"

namespace s3lam::refine {
namespace {

ArmState Snapshot(const std::string& name, const BundleMap& map) {
  return {name, map.problem.cameras, map.problem.poses, map.problem.points};
}

void CheckUsable(const BundleMap& map) {
  const Gauge& gauge = map.problem.gauge;
  if (map.problem.observations.empty() || (gauge.fixed_pose >= 0 && gauge.scale_pose < 0)) {
    ThrowInputError(
        "the model cannot be adjusted: of {} images and {} points, no two images at different "
        "places see common points",
        map.image_ids.size(), map.point_ids.size());
  }
}

std::vector<uint8_t> UsedPoses(const BundleProblem& problem) {
  std::vector<uint8_t> used(problem.poses.size(), 0);
  for (const BundleObservation& o : problem.observations) used[o.pose] = 1;
  return used;
}

/// The refined images as keyframes that carry others along, at the given times.
std::vector<MovedKeyframe> MovedKeyframes(const Reconstruction& original, const BundleMap& map,
                                          const std::vector<double>& times) {
  const std::vector<uint8_t> used = UsedPoses(map.problem);
  std::vector<MovedKeyframe> moved;
  for (size_t i = 0; i < map.image_ids.size(); ++i) {
    if (used[i] == 0) continue;
    moved.push_back({times[i], original.images.at(map.image_ids[i]).cam_from_world,
                     FromPoseBlock(map.problem.poses[i].data())});
  }
  return moved;
}

/// Images that see too little to be refined go along with those before and after them by id.
void CarryUnusedImages(const Reconstruction& original, BundleMap& map) {
  std::vector<double> order(map.image_ids.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<double>(i);
  const std::vector<uint8_t> used = UsedPoses(map.problem);
  const std::vector<MovedKeyframe> keyframes = MovedKeyframes(original, map, order);
  for (size_t i = 0; i < used.size(); ++i) {
    if (used[i] != 0 || map.problem.pose_is_constant[i] != 0) continue;
    const Rigid3& old_pose = original.images.at(map.image_ids[i]).cam_from_world;
    const Trajectory carried = CarryFrames({{order[i], old_pose.Inverse()}}, keyframes);
    map.problem.poses[i] = ToPoseBlock(carried.front().world_from_camera.Inverse());
  }
}

void MoveTrajectories(const Options& options, const Input& input, const BundleMap& map,
                      Output& output, Report& report) {
  output.frames = input.frames;
  const FrameObservations observations = FollowMergedPoints(input.observations, map.merged_into);
  output.observations = KeepKnownPoints(observations, output.model);
  output.keyframes.clear();
  if (input.image_times_s.empty()) return;
  const auto keyframes = MovedKeyframes(input.model, map, input.image_times_s);
  output.frames = CarryFrames(input.frames, keyframes);
  report.frames =
      RefineFrames(options.frames, output.model, observations, options.num_threads, output.frames);
  size_t i = 0;
  for (const auto& [id, image] : output.model.images) {
    output.keyframes.push_back({input.image_times_s[i++], image.cam_from_world.Inverse()});
  }
}

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

/// In metres, by the known height of the camera; upright, by the classes that are level or upright.
/// Returns how the output was transformed.
Similarity3 ChooseWorld(const Options& options, Output& output, Report& report) {
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

/// Covariances at the solution, for what the output has.
void AddCovariance(const Options& options, const BundleMap& map, const PlaneModel& planes,
                   const SemanticMap& semantics, const Similarity3& new_from_old, Output& output) {
  const auto covariance = ComputeCovariance(options.covariance, options.solver, map.problem);
  if (!covariance) {
    spdlog::warn("no covariances: the observations leave something undetermined");
    return;
  }
  output.covariance.computed = true;
  for (size_t i = 0; i < map.image_ids.size(); ++i) {
    if (!covariance->poses[i]) continue;
    output.covariance.poses[map.image_ids[i]] = CenterCovariance(
        *covariance->poses[i], FromPoseBlock(map.problem.poses[i].data()), new_from_old);
  }
  for (size_t k = 0; k < planes.planes.size(); ++k) {
    const auto surface = semantics.planes.find(planes.planes[k].id);
    if (!covariance->planes[k] || surface == semantics.planes.end()) continue;
    Eigen::Matrix3d of_surface =
        SurfaceCovariance(*covariance->planes[k], map.problem.planes[k], surface->second);
    of_surface.row(2) *= new_from_old.scale;
    of_surface.col(2) *= new_from_old.scale;
    output.covariance.planes[surface->first] = of_surface;
  }
}

double HeldDistance(const BundleProblem& problem) {
  if (problem.gauge.scale_pose < 0) return 1.0;
  return (problem.CenterOf(problem.gauge.scale_pose) - problem.CenterOf(problem.gauge.fixed_pose))
      .norm();
}

void CountUse(const BundleMap& map, Report& report) {
  report.num_images = map.image_ids.size();
  report.num_points = map.point_ids.size();
  for (const uint8_t used : UsedPoses(map.problem)) report.num_images_in_use += used;
  int previous = -1;
  for (const BundleObservation& o : map.problem.observations) {
    report.num_points_in_use += o.point != previous;
    previous = o.point;
  }
}

/// Bundle adjustment without planes, with the camera parameters that may change; again from the
/// start with all cameras kept if one ends where it cannot be believed. From here on cameras stay.
std::vector<OuterIteration> AdjustCameras(Options& options, BundleMap& map,
                                          std::vector<IntrinsicsReport>& reports) {
  if (!options.intrinsics.Any()) {
    auto iterations = AdjustPlain(options, map);
    if (options.intrinsics.check_distortion) {
      reports = CheckDistortion(options.intrinsics, options.solver.sigma_px, map);
    }
    return iterations;
  }
  const BundleMap given = map;
  reports = FreeIntrinsics(options.intrinsics, map);
  const std::vector<Camera> before = map.problem.cameras;
  auto iterations = AdjustPlain(options, map);
  map.problem.free_camera_params.clear();
  std::string doubts;
  for (size_t c = 0; c < before.size() && doubts.empty(); ++c) {
    doubts = DoubtsAboutCamera(options.intrinsics, before[c], map.problem.cameras[c]);
    if (doubts.empty()) continue;
    doubts = fmt::format("camera {}: {}", given.camera_ids[c].front().value(), doubts);
  }
  if (!doubts.empty()) {
    spdlog::warn("all cameras are kept as given: {}", doubts);
    map = given;
    iterations = AdjustPlain(options, map);
  }
  for (IntrinsicsReport& report : reports) {
    if (report.refined && !doubts.empty()) report.reason = doubts;
    report.refined = report.refined && doubts.empty();
    for (size_t c = 0; c < map.camera_ids.size(); ++c) {
      const auto& ids = map.camera_ids[c];
      if (std::find(ids.begin(), ids.end(), report.cameras.front()) == ids.end()) continue;
      report.model_after = CameraModelName(map.problem.cameras[c].model);
      report.after = map.problem.cameras[c].params;
    }
  }
  return iterations;
}

void CountExactPlanes(const BundleProblem& problem, Report& report) {
  std::set<int> planes;
  for (const PointOnPlane& term : problem.points_on_planes) {
    if (!term.is_exact) continue;
    planes.insert(term.plane);
    ++report.num_exact_points;
  }
  report.num_exact_planes = planes.size();
}

std::string NoteOnPlanes(const Options& options, const PlaneModel& planes, size_t members) {
  if (options.planes.mode == PlaneMode::kOff) return {};
  if (planes.planes.empty()) return "no planes given: plain bundle adjustment";
  if (members == 0) return "no plane has enough points near it: plain bundle adjustment";
  return {};
}

Report RunInWorld(const Options& given, const Input& input, Output& output) {
  Report report;
  Options options = given;
  SolveJournal journal(input.steps);
  options.journal = &journal;
  BundleMap map;
  PlaneModel planes;
  {
    const ScopedStep step(report.seconds, "build");
    map = BuildBundleMap(input.model, input.keypoint_sigmas);
    SelectObservations(options.outliers, options.solver.sigma_px, true, map);
    AddLooks(input.descriptors, input.semantics, map);
    ApplyConstraints(input.constraints, map);
    map.problem.gauge = ChooseGaugeWithConstraints(map.problem);
    CheckUsable(map);
    planes = BuildPlaneModel(options.planes.membership, input.semantics, map);
  }
  std::vector<ArmState> arms{Snapshot("input", map)};
  const double held_distance = HeldDistance(map.problem);
  {
    const ScopedStep step(report.seconds, "plain");
    report.iterations = AdjustCameras(options, map, report.cameras);
    arms.push_back(Snapshot("plain", map));
  }
  const double sigma_px = options.solver.sigma_px;
  report.keypoint_sigma_px = sigma_px;
  report.keypoints_differ = !input.keypoint_sigmas.empty();
  {
    const ScopedStep step(report.seconds, "planar");
    CutBendingPlanes(options.bending, input.semantics.class_table, sigma_px, planes, map.problem);
    AddKnownDistances(options.relations, input.constraints.plane_distances, input.semantics, planes,
                      map.problem);
    const auto planar = AdjustPlanar(options, input.semantics, planes, map, report.ground);
    report.iterations.insert(report.iterations.end(), planar.begin(), planar.end());
    if (!planar.empty()) arms.push_back(Snapshot("planar", map));
  }
  const ScopedStep step(report.seconds, "output");
  report.gauge_scale_change = HeldDistance(map.problem) / held_distance - 1.0;
  report.observations = report.iterations.back().observations;
  report.membership = report.iterations.back().membership;
  for (const OuterIteration& iteration : report.iterations) {
    report.num_retriangulated += iteration.retriangulated;
    report.num_merged += iteration.merged;
  }
  CountExactPlanes(map.problem, report);
  report.median_depth = planes.median_depth;
  report.note = NoteOnPlanes(options, planes, report.membership.members);
  report.plane_mode = PlaneModeName(options.planes.mode);
  CountUse(map, report);
  CompareArms(arms, map, planes, options.planes.sigma, sigma_px, input.semantics.class_table,
              report);
  CarryUnusedImages(input.model, map);
  output.model = ToReconstruction(map, input.model);
  output.semantics =
      RefinedSemantics(input.semantics, planes, map, output.model, options.planes.sigma, sigma_px);
  MoveTrajectories(options, input, map, output, report);
  const SemanticMap semantics = output.semantics;
  const Similarity3 new_from_old = ChooseWorld(options, output, report);
  WarnOfMovedWorld(input.constraints, new_from_old);
  if (options.covariance.enabled) {
    const ScopedStep covariance_step(report.seconds, "covariance");
    AddCovariance(options, map, planes, semantics, new_from_old, output);
  }
  report.peak_memory_mib = PeakMemoryMiB();
  return report;
}

}  // namespace

void Options::Visit(OptionVisitor& v) {
  v.Value("keypoint_sigma_px", keypoint_sigma_px,
          "standard deviation of a keypoint [px]; 0: measured by the median reprojection error",
          0.0, 1e6);
  v.Group("solver", solver, "The bundle adjustment.");
  v.Group("outliers", outliers, "Observations that are left out.");
  v.Group("intrinsics", intrinsics, "Camera parameters that are refined.");
  v.Group("planes", planes, "Planes and the points on them.");
  v.Group("exact_planes", exact_planes, "Planes whose points are put onto them (mode hard).");
  v.Group("retriangulation", retriangulation, "Points and tracks mended between solves.");
  v.Group("bending", bending, "Surfaces that bend: cut into pieces.");
  v.Group("relations", relations, "Planes that are parallel, orthogonal or coplanar.");
  v.Group("camera_height", camera_height, "The camera keeps its height above the ground.");
  v.Group("frames", frames, "Frames that are no keyframes.");
  v.Group("gravity", gravity, "Which way is up in the output.");
  v.Group("covariance", covariance, "How certain the result is.");
  v.Group("outer", outer, "Rounds of solving and choosing inliers.");
}

Report Run(const Options& given, const Input& given_input, Output& output) {
  if (const auto world = PriorWorldFromModel(given_input.constraints, given_input.model)) {
    spdlog::info("the map is brought into the world of the pose priors, {:.6g} times as large",
                 world->scale);
    Input moved = given_input;
    TransformMap(*world, moved.model, moved.semantics);
    TransformTrajectory(*world, moved.frames);
    return RunInWorld(given, moved, output);
  }
  return RunInWorld(given, given_input, output);
}

}  // namespace s3lam::refine
