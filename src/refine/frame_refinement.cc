#include "s3lam/refine/frame_refinement.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/optim/pose_refinement.h"
#include "s3lam/refine/projection.h"

namespace s3lam {
namespace {

/// Index of the pose at exactly this time; -1 without one.
int FindTime(const Trajectory& frames, double time_s) {
  const auto it = std::lower_bound(frames.begin(), frames.end(), time_s,
                                   [](const TimedPose& p, double time) { return p.time_s < time; });
  return it != frames.end() && it->time_s == time_s ? static_cast<int>(it - frames.begin()) : -1;
}

/// The observation in an undistorted image of the camera's focal length whose centre is (0, 0);
/// false where the distortion cannot be inverted.
bool Undistort(const Camera& camera, const FrameObservation& observation, PoseObservation& result) {
  const auto normalized = camera.CameraFromImage(observation.xy.cast<double>());
  if (!normalized) return false;
  Eigen::Vector2d pixel;
  Matrix23 jacobian;
  if (!ProjectPoint(camera.model, camera.params.data(), {normalized->x(), normalized->y(), 1.0},
                    &pixel, &jacobian)) {
    return false;
  }
  const double focal = camera.MeanFocal();
  // How many original pixels an undistorted one is here: far off the axis of a wide lens, few.
  const double scale = std::sqrt(std::abs(jacobian.leftCols<2>().determinant())) / focal;
  result.xy = focal * *normalized;
  result.inverse_sigma = scale / static_cast<double>(observation.sigma);
  return std::isfinite(result.inverse_sigma) && result.inverse_sigma > 0.0;
}

bool RefineFrame(const FrameRefinementOptions& options, const Reconstruction& refined,
                 const ObservedFrame& frame, Rigid3& world_from_camera) {
  const Camera& camera = refined.cameras.at(frame.camera_id);
  std::vector<PoseObservation> observations;
  for (const FrameObservation& o : frame.observations) {
    const auto point = refined.points.find(o.point_id);
    PoseObservation observation;
    if (point == refined.points.end() || !Undistort(camera, o, observation)) continue;
    observation.point_in_world = point->second.xyz;
    observations.push_back(observation);
  }
  Rigid3 cam_from_world = world_from_camera.Inverse();
  const double focal = camera.MeanFocal();
  const PoseRefinementResult result =
      RefinePose({focal, focal, 0.0, 0.0}, observations, cam_from_world);
  const double needed =
      std::max(static_cast<double>(options.min_inliers),
               options.min_inlier_share * static_cast<double>(observations.size()));
  if (static_cast<double>(result.num_inliers) < needed) return false;
  world_from_camera = cam_from_world.Inverse();
  return true;
}

}  // namespace

void FrameRefinementOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled,
          "refine the poses of frames that are no keyframes against the refined map, where "
          "observations.bin says what they see; otherwise they go along with the keyframes");
  v.Value("min_inliers", min_inliers, "a frame that sees fewer points goes along", 6, 1000000);
  v.Value("min_inlier_share", min_inlier_share,
          "a frame of whose observations a smaller part fits goes along", 0.0, 1.0);
}

void CheckFrameObservations(const FrameObservations& observed, const Reconstruction& model,
                            const Trajectory& frames, const std::string& source) {
  for (const ObservedFrame& frame : observed) {
    if (!model.cameras.contains(frame.camera_id)) {
      ThrowInputError("{}: the frame at {} s is of camera {}, which the model does not have",
                      source, frame.time_s, frame.camera_id.value());
    }
    if (FindTime(frames, frame.time_s) < 0) {
      ThrowInputError("{}: the frame at {} s is not in frames.txt", source, frame.time_s);
    }
    for (const FrameObservation& o : frame.observations) {
      if (model.points.contains(o.point_id)) continue;
      ThrowInputError("{}: the frame at {} s sees point {}, which the model does not have", source,
                      frame.time_s, o.point_id.value());
    }
  }
}

FrameRefinementReport RefineFrames(const FrameRefinementOptions& options,
                                   const Reconstruction& refined, const FrameObservations& observed,
                                   int num_threads, Trajectory& frames) {
  FrameRefinementReport report;
  report.num_frames = frames.size();
  if (!options.enabled) return report;
  std::vector<uint8_t> was_refined(observed.size(), 0);
  ParallelFor(observed.size(), num_threads, [&](size_t i) {
    const int index = FindTime(frames, observed[i].time_s);
    if (index < 0) return;
    was_refined[i] = RefineFrame(options, refined, observed[i], frames[index].world_from_camera);
  });
  report.num_refined =
      static_cast<size_t>(std::count(was_refined.begin(), was_refined.end(), uint8_t{1}));
  return report;
}

FrameObservations FollowMergedPoints(const FrameObservations& observed,
                                     const std::map<PointId, PointId>& merged_into) {
  if (merged_into.empty()) return observed;
  FrameObservations followed = observed;
  for (ObservedFrame& frame : followed) {
    std::set<PointId> seen;
    for (const FrameObservation& o : frame.observations) seen.insert(o.point_id);
    std::vector<FrameObservation> kept;
    for (FrameObservation o : frame.observations) {
      const PointId before = o.point_id;
      for (auto it = merged_into.find(before); it != merged_into.end();
           it = merged_into.find(o.point_id)) {
        o.point_id = it->second;
      }
      if (o.point_id == before || seen.insert(o.point_id).second) kept.push_back(o);
    }
    frame.observations = std::move(kept);
  }
  return followed;
}

FrameObservations KeepKnownPoints(const FrameObservations& observed, const Reconstruction& model) {
  FrameObservations kept = observed;
  for (ObservedFrame& frame : kept) {
    std::erase_if(frame.observations,
                  [&](const FrameObservation& o) { return !model.points.contains(o.point_id); });
  }
  return kept;
}

}  // namespace s3lam
