#include "s3lam/refine/pipeline.h"

#include <algorithm>
#include <set>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/refine/constraints.h"
#include "s3lam/refine/frames.h"
#include "s3lam/refine/plane_output.h"
#include "world.h"

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

/// The refined images as keyframes that carry others along, at the given times.
std::vector<MovedKeyframe> MovedKeyframes(const Reconstruction& original, const BundleMap& map,
                                          const std::vector<double>& times) {
  const std::vector<uint8_t> used = map.problem.UsedPoses();
  std::vector<MovedKeyframe> moved;
  for (size_t i = 0; i < map.image_ids.size(); ++i) {
    if (used[i] == 0) continue;
    moved.push_back({times[i], original.images.at(map.image_ids[i]).cam_from_world,
                     FromPoseBlock(map.problem.poses[i].data())});
  }
  return moved;
}

/// What carries an image along of whose time nothing is known: the nearest keyframe and the nearest
/// of those that are at least as far from it as the image is, since a shorter baseline tells little
/// of a change of scale. Their times are such that a frame at time zero goes more with the nearer.
std::vector<MovedKeyframe> NearestKeyframes(const Eigen::Vector3d& center,
                                            std::vector<MovedKeyframe> keyframes) {
  if (keyframes.empty()) return {};
  for (MovedKeyframe& keyframe : keyframes) {
    keyframe.time_s = (keyframe.old_cam_from_world.CenterInB() - center).norm();
  }
  std::stable_sort(keyframes.begin(), keyframes.end(),
                   [](const auto& a, const auto& b) { return a.time_s < b.time_s; });
  MovedKeyframe nearest = keyframes.front();
  const auto second = std::find_if(keyframes.begin() + 1, keyframes.end(), [&](const auto& other) {
    return (other.old_cam_from_world.CenterInB() - nearest.old_cam_from_world.CenterInB()).norm() >=
           nearest.time_s;
  });
  nearest.time_s = -nearest.time_s;
  if (second == keyframes.end()) return {nearest};
  return {nearest, *second};
}

/// Images that see too little to be refined go along with those before and after them, or with the
/// nearest ones if it is not known when they were taken.
void CarryUnusedImages(const Reconstruction& original, bool times_are_known, BundleMap& map) {
  std::vector<double> order(map.image_ids.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = static_cast<double>(i);
  const std::vector<uint8_t> used = map.problem.UsedPoses();
  const std::vector<MovedKeyframe> keyframes = MovedKeyframes(original, map, order);
  for (size_t i = 0; i < used.size(); ++i) {
    if (used[i] != 0 || map.problem.pose_is_constant[i] != 0) continue;
    const Rigid3 old_pose = original.images.at(map.image_ids[i]).cam_from_world.Inverse();
    const Trajectory carried =
        times_are_known
            ? CarryFrames({{order[i], old_pose}}, keyframes)
            : CarryFrames({{0.0, old_pose}}, NearestKeyframes(old_pose.translation, keyframes));
    map.problem.poses[i] = ToPoseBlock(carried.front().world_from_camera.Inverse());
  }
}

/// The model's points change places with those where they were when poses were adjusted.
void SwapWithAdjusted(const BundleMap& map, std::vector<Eigen::Vector3d>& adjusted,
                      Reconstruction& model) {
  for (size_t j = 0; j < adjusted.size(); ++j) {
    const auto point = model.points.find(map.point_ids[j]);
    if (point != model.points.end()) std::swap(point->second.xyz, adjusted[j]);
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
  // What the keypoints of a track err by in common is in those of frames, too.
  std::vector<Eigen::Vector3d> adjusted = map.points_as_adjusted;
  SwapWithAdjusted(map, adjusted, output.model);
  report.frames =
      RefineFrames(options.frames, output.model, observations, options.num_threads, output.frames);
  SwapWithAdjusted(map, adjusted, output.model);
  size_t i = 0;
  for (const auto& [id, image] : output.model.images) {
    output.keyframes.push_back({input.image_times_s[i++], image.cam_from_world.Inverse()});
  }
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

/// How much the distance that the gauge holds at the end changed since the input, relative: the
/// pair of cameras may have become another one on the way.
double ScaleChange(const BundleProblem& problem, const std::vector<PoseBlock>& input_poses) {
  const Gauge& gauge = problem.gauge;
  if (gauge.scale_pose < 0) return 0.0;
  const auto distance = [&](const std::vector<PoseBlock>& poses) {
    return (FromPoseBlock(poses[gauge.scale_pose].data()).CenterInB() -
            FromPoseBlock(poses[gauge.fixed_pose].data()).CenterInB())
        .norm();
  };
  return distance(problem.poses) / distance(input_poses) - 1.0;
}

void CountUse(const BundleMap& map, Report& report) {
  report.num_images = map.image_ids.size();
  report.num_points = map.point_ids.size();
  for (const uint8_t used : map.problem.UsedPoses()) report.num_images_in_use += used;
  int previous = -1;
  for (const BundleObservation& o : map.problem.observations) {
    report.num_points_in_use += o.point != previous;
    previous = o.point;
  }
}

HeldCameras AllCameras(const BundleMap& map, const std::string& reason) {
  HeldCameras all;
  for (const auto& ids : map.camera_ids) {
    for (const CameraId id : ids) all[id] = reason;
  }
  return all;
}

void WarnOfHeld(const HeldCameras& held) {
  std::vector<uint32_t> ids;
  for (const auto& [id, doubts] : held) ids.push_back(id.value());
  spdlog::warn("adjusted anew with camera {} kept as given; of camera {}: {}", fmt::join(ids, ", "),
               ids.front(), held.begin()->second);
}

void CheckCalibrations(const Options& options, const BundleMap& map, Report& report) {
  if (!options.intrinsics.check) return;
  CheckKeptCameras(options.intrinsics, options.solver.sigma_px, map, report.cameras);
}

/// Bundle adjustment without planes, with the camera parameters that may change; again from the
/// start with those cameras held that end where they cannot be believed, until there are none;
/// after some rounds of that, with all. Returns the parameters that were refined, per camera of the
/// problem; empty: none.
std::vector<std::vector<int>> AdjustCameras(Options& options, BundleMap& map, Report& report) {
  if (!options.intrinsics.Any()) {
    report.iterations = AdjustPlain(options, map);
    CheckCalibrations(options, map, report);
    return {};
  }
  constexpr int kMostRounds = 5;
  const BundleMap given = map;
  HeldCameras held;
  for (int round = 1;; ++round) {
    map = given;
    report.cameras = FreeIntrinsics(options.intrinsics, held, map);
    if (round == 1) WarnIfNoneIsRefined(options.intrinsics, report.cameras);
    const std::vector<Camera> before = map.problem.cameras;
    report.iterations = AdjustPlain(options, map);
    HeldCameras doubtful = DoubtfulCameras(options.intrinsics, before, map);
    if (doubtful.empty()) break;
    if (round == kMostRounds) doubtful = AllCameras(map, "too many others cannot be believed");
    WarnOfHeld(doubtful);
    held.insert(doubtful.begin(), doubtful.end());
  }
  TellParameters(map, report.cameras);
  CheckCalibrations(options, map, report);
  return std::exchange(map.problem.free_camera_params, {});
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

void WarnOfUnused(const std::vector<PlaneDistance>& distances) {
  for (const PlaneDistance& known : distances) {
    spdlog::warn(
        "the known distance of planes {} and {} is not used: the planes are off, too few points "
        "are on them, or those of the ground under the cameras stand for them",
        known.a.value(), known.b.value());
  }
}

/// What is adjusted: the map's observations that fit it roughly, what is held of it, its planes.
PlaneModel BuildProblem(const Options& options, const Input& input, BundleMap& map) {
  map = BuildBundleMap(input.model, input.keypoint_sigmas);
  SelectObservations(options.outliers, options.solver.sigma_px, true, map);
  AddLooks(input.descriptors, input.semantics, map);
  ApplyConstraints(input.constraints, map);
  map.problem.gauge = ChooseGaugeWithConstraints(map.problem);
  CheckUsable(map);
  return BuildPlaneModel(options.planes.membership, input.semantics, map);
}

/// Bundle adjustment with planes. Returns whether any took part. Adds the camera parameters that
/// were refined with them.
bool AdjustPlanes(const Options& options, const Input& input, PlaneModel& planes, BundleMap& map,
                  Report& report, std::vector<std::vector<int>>& refined_camera_params) {
  const auto& distances = input.constraints.plane_distances;
  CutBendingPlanes(options.bending, input.semantics.class_table, options.solver.sigma_px, planes,
                   map.problem);
  AddKnownDistances(options.relations, distances, input.semantics, planes, map.problem);
  PlanarReport planar = AdjustPlanar(options, input.semantics, planes, map);
  report.iterations.insert(report.iterations.end(), planar.iterations.begin(),
                           planar.iterations.end());
  report.ground = planar.ground;
  if (!planar.cameras.empty()) {
    AddRefined(planar.cameras, report.cameras);
    refined_camera_params = std::move(planar.refined_camera_params);
  }
  WarnOfUnused(planar.iterations.empty() ? distances
                                         : UnusedDistances(distances, planes, map.problem));
  return !planar.iterations.empty();
}

/// What the adjustment came to.
void TellResult(const Options& options, const Input& input, const std::vector<ArmState>& arms,
                const BundleMap& map, const PlaneModel& planes, Report& report) {
  report.keypoint_sigma_px = options.solver.sigma_px;
  report.keypoints_differ = !input.keypoint_sigmas.empty();
  report.gauge_scale_change = ScaleChange(map.problem, arms.front().poses);
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
  CompareArms(arms, map, planes, options.planes.sigma, options.solver.sigma_px,
              input.semantics.class_table, report);
}

Report RunInWorld(const Options& given_options, const Input& given, Output& output) {
  const auto place = FarPlaceOf(given.model);
  const Input shifted = place ? BroughtToOrigin(*place, given) : Input{};
  const Input& input = place ? shifted : given;
  Report report;
  Options options = given_options;
  SolveJournal journal(input.steps);
  options.journal = &journal;
  BundleMap map;
  PlaneModel planes;
  {
    const ScopedStep step(report.seconds, "build");
    planes = BuildProblem(options, input, map);
  }
  std::vector<ArmState> arms{Snapshot("input", map)};
  std::vector<std::vector<int>> refined_camera_params;
  {
    const ScopedStep step(report.seconds, "plain");
    refined_camera_params = AdjustCameras(options, map, report);
    arms.push_back(Snapshot("plain", map));
  }
  {
    const ScopedStep step(report.seconds, "planar");
    if (AdjustPlanes(options, input, planes, map, report, refined_camera_params)) {
      arms.push_back(Snapshot("planar", map));
    }
  }
  const ScopedStep step(report.seconds, "output");
  TellResult(options, input, arms, map, planes, report);
  CarryUnusedImages(input.model, !input.image_times_s.empty(), map);
  output.model = ToReconstruction(map, input.model);
  output.semantics = RefinedSemantics(input.semantics, planes, map, output.model,
                                      options.planes.sigma, options.solver.sigma_px);
  MoveTrajectories(options, input, map, output, report);
  const SemanticMap semantics = output.semantics;
  if (place) ReturnToPlace(*place, given, output);
  const Similarity3 new_from_old = ChooseWorld(options, input.constraints, output, report);
  if (options.covariance.enabled) {
    const ScopedStep covariance_step(report.seconds, "covariance");
    // What poses and planes are uncertain by because the cameras are, too.
    map.problem.free_camera_params = std::move(refined_camera_params);
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

Report Run(const Options& options, const Input& input, Output& output) {
  const auto priors_world = PriorWorldFromModel(input.constraints, input.model);
  if (!priors_world) return RunInWorld(options, input, output);
  spdlog::info("the map is brought into the world of the pose priors, {:.6g} times as large",
               priors_world->scale);
  Input moved = input;
  TransformInput(*priors_world, moved);
  return RunInWorld(options, moved, output);
}

}  // namespace s3lam::refine
