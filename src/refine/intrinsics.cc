#include "s3lam/refine/intrinsics.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/optim/self_calibration.h"

namespace s3lam {
namespace {

/// A pixel of the border must come back from its ray to within this [px].
constexpr double kRoundTrip = 0.01;
constexpr int kBorderSteps = 8;
constexpr size_t kMaxChecked = 5;  // Cameras, each of which takes about a second.

struct CameraUse {
  std::set<int> poses;
  int observations = 0;
};

std::vector<CameraUse> UseOfCameras(const BundleProblem& problem,
                                    const std::vector<int>& camera_of_pose) {
  std::vector<CameraUse> use(problem.cameras.size());
  for (const BundleObservation& o : problem.observations) {
    CameraUse& of_camera = use[camera_of_pose[o.pose]];
    of_camera.poses.insert(o.pose);
    ++of_camera.observations;
  }
  return use;
}

bool TooFew(const IntrinsicsOptions& options, const CameraUse& use) {
  return static_cast<int>(use.poses.size()) < options.min_images ||
         use.observations < options.min_observations;
}

/// One problem camera for all chosen ones of a model and size that together saw enough to be
/// refined; the others of them are left without poses.
void ShareCameras(const IntrinsicsOptions& options, const std::set<CameraId>& chosen,
                  BundleMap& map) {
  BundleProblem& problem = map.problem;
  std::map<std::tuple<int, int, int>, int> first;
  std::vector<int> replaced_by(problem.cameras.size());
  for (size_t c = 0; c < problem.cameras.size(); ++c) {
    const int index = static_cast<int>(c);
    replaced_by[c] = index;
    if (!chosen.contains(map.camera_ids[c].front())) continue;
    const Camera& camera = problem.cameras[c];
    const auto key = std::tuple(static_cast<int>(camera.model), camera.width, camera.height);
    replaced_by[c] = first.emplace(key, index).first->second;
  }
  std::vector<int> camera_of_pose = problem.camera_of_pose;
  for (int& camera : camera_of_pose) camera = replaced_by[camera];
  const std::vector<CameraUse> use = UseOfCameras(problem, camera_of_pose);
  for (size_t c = 0; c < problem.cameras.size(); ++c) {
    const int index = replaced_by[c];
    if (TooFew(options, use[index])) replaced_by[c] = static_cast<int>(c);
    if (replaced_by[c] == static_cast<int>(c)) continue;
    auto& ids = map.camera_ids[index];
    ids.insert(ids.end(), map.camera_ids[c].begin(), map.camera_ids[c].end());
    map.camera_ids[c].clear();
  }
  for (int& camera : problem.camera_of_pose) camera = replaced_by[camera];
}

/// Ascending, of those that enough was taken with and that are not refined.
std::vector<size_t> MostUsedKeptCameras(const IntrinsicsOptions& options,
                                        const BundleProblem& problem) {
  const std::vector<CameraUse> use = UseOfCameras(problem, problem.camera_of_pose);
  std::vector<size_t> cameras;
  for (size_t c = 0; c < use.size(); ++c) {
    const bool is_refined =
        c < problem.free_camera_params.size() && !problem.free_camera_params[c].empty();
    if (!is_refined && !TooFew(options, use[c])) cameras.push_back(c);
  }
  std::stable_sort(cameras.begin(), cameras.end(),
                   [&](size_t a, size_t b) { return use[a].observations > use[b].observations; });
  cameras.resize(std::min(cameras.size(), kMaxChecked));
  std::sort(cameras.begin(), cameras.end());
  return cameras;
}

/// What one camera saw.
CalibrationProblem ProblemOfCamera(const BundleProblem& problem, size_t camera, double sigma_px) {
  CalibrationProblem result;
  result.points = problem.points;
  for (const PoseBlock& pose : problem.poses) result.poses.push_back(FromPoseBlock(pose.data()));
  for (const BundleObservation& o : problem.observations) {
    if (problem.camera_of_pose[o.pose] != static_cast<int>(camera)) continue;
    result.observations.push_back({o.pose, o.point, o.pixel, 1.0 / (o.sigma * sigma_px)});
  }
  return result;
}

std::set<CameraId> ChosenCameras(const IntrinsicsOptions& options, const BundleMap& map) {
  std::set<CameraId> known;
  for (const auto& ids : map.camera_ids) known.insert(ids.begin(), ids.end());
  if (options.cameras.empty()) return known;
  std::set<CameraId> chosen;
  for (const std::string& name : options.cameras) {
    const auto it = std::find_if(known.begin(), known.end(),
                                 [&](CameraId id) { return std::to_string(id.value()) == name; });
    if (it == known.end()) ThrowInputError("intrinsics.cameras: the model has no camera {}", name);
    chosen.insert(*it);
  }
  return chosen;
}

/// The ray of every border pixel is found and leads back to it.
bool InvertibleOnBorder(const Camera& camera) {
  for (int step = 0; step < kBorderSteps; ++step) {
    const double along = static_cast<double>(step) / kBorderSteps;
    const double x = along * camera.width;
    const double y = along * camera.height;
    for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(x, 0.0), Eigen::Vector2d(camera.width, y),
                                         Eigen::Vector2d(camera.width - x, camera.height),
                                         Eigen::Vector2d(0.0, camera.height - y)}) {
      const auto ray = camera.CameraFromImage(pixel);
      if (!ray) return false;
      const auto back = camera.ImageFromCamera({ray->x(), ray->y(), 1.0});
      if (!back || (*back - pixel).norm() > kRoundTrip) return false;
    }
  }
  return true;
}

/// Of a camera that stays as it is.
IntrinsicsReport ReportOfKept(const std::vector<CameraId>& ids, const Camera& camera) {
  IntrinsicsReport report;
  report.cameras = ids;
  report.model = report.model_after = CameraModelName(camera.model);
  report.before = report.after = camera.params;
  return report;
}

/// That of the same cameras, which are one; `camera` itself if there is none yet.
IntrinsicsReport& ReportOf(const IntrinsicsReport& camera, std::vector<IntrinsicsReport>& reports) {
  const auto it = std::find_if(reports.begin(), reports.end(), [&](const auto& report) {
    return report.cameras == camera.cameras;
  });
  return it != reports.end() ? *it : reports.emplace_back(camera);
}

void WarnOfDoubts(const IntrinsicsReport& report) {
  const auto id = report.cameras.front().value();
  if (report.distortion_is_doubtful) {
    spdlog::warn(
        "camera {}: another lens distortion would remove {:.0f} % of the reprojection cost, and a "
        "wrong one bends maps and makes their scale drift: try --set intrinsics.distortion=true",
        id, 100.0 * report.distortion_cost_share);
  }
  if (!report.better_pinhole.empty()) {
    spdlog::warn(
        "camera {}: {}: try --set intrinsics.focal_length=true, intrinsics.principal_point=true "
        "and "
        "intrinsics.distortion=true",
        id, DescribeBetterPinhole(report.better_pinhole, report.pinhole_cost_share));
  }
}

}  // namespace

void IntrinsicsOptions::Visit(OptionVisitor& v) {
  v.Value("focal_length", focal_length, "refine focal lengths");
  v.Value("principal_point", principal_point, "refine principal points");
  v.Value("distortion", distortion,
          "refine the radial distortion that camera models have; pinhole models become OPENCV");
  v.Value("tangential", tangential,
          "with it the other terms of distortion too, which take up what bends in a map more than "
          "what lenses do");
  v.Value("shared", shared,
          "the refined cameras of one model and image size are one, starting as the first of them");
  v.Value("check", check,
          "tell if another calibration would explain much better what the kept cameras saw: of the "
          "five with the most observations");
  v.Value("cameras", cameras, "ids of the cameras that are refined; none: all");
  v.Value("min_images", min_images, "a camera that fewer images were taken with is kept", 1,
          1000000);
  v.Value("min_observations", min_observations, "a camera with fewer observations is kept", 10,
          1000000000);
  v.Value("max_focal_change", max_focal_change,
          "a camera is kept if its focal length would change by more than this part", 0.0, 10.0);
  v.Value(
      "max_principal_shift", max_principal_shift,
      "a camera is kept if its principal point would move by more than this part of the image's "
      "larger side",
      0.0, 1.0);
}

std::vector<int> RefinedParams(const IntrinsicsOptions& options, CameraModel model) {
  const int num_focal = CameraModelHasSingleFocal(model) ? 1 : 2;
  const std::vector<int> radial = CameraModelRadialParams(model);
  std::vector<int> params;
  for (int i = 0; i < CameraModelNumParams(model); ++i) {
    const bool is_focal = i < num_focal;
    const bool is_principal = !is_focal && i < num_focal + 2;
    const bool is_radial = std::find(radial.begin(), radial.end(), i) != radial.end();
    const bool wanted = is_focal       ? options.focal_length
                        : is_principal ? options.principal_point
                                       : options.distortion && (is_radial || options.tangential);
    if (wanted) params.push_back(i);
  }
  return params;
}

std::vector<IntrinsicsReport> FreeIntrinsics(const IntrinsicsOptions& options,
                                             const HeldCameras& held, BundleMap& map) {
  BundleProblem& problem = map.problem;
  std::set<CameraId> chosen = ChosenCameras(options, map);
  for (const auto& [id, reason] : held) chosen.erase(id);
  if (options.shared) ShareCameras(options, chosen, map);
  const std::vector<CameraUse> use = UseOfCameras(problem, problem.camera_of_pose);
  problem.free_camera_params.assign(problem.cameras.size(), {});
  std::vector<IntrinsicsReport> reports;
  for (size_t c = 0; c < problem.cameras.size(); ++c) {
    if (map.camera_ids[c].empty()) continue;
    IntrinsicsReport report;
    report.cameras = map.camera_ids[c];
    Camera& camera = problem.cameras[c];
    report.model = CameraModelName(camera.model);
    report.before = camera.params;
    if (const auto it = held.find(report.cameras.front()); it != held.end()) {
      report.reason = it->second;
    } else if (std::none_of(report.cameras.begin(), report.cameras.end(),
                            [&](CameraId id) { return chosen.contains(id); })) {
      report.reason = "not asked for";
    } else if (TooFew(options, use[c])) {
      report.reason = fmt::format("only {} images and {} observations of it are in use",
                                  use[c].poses.size(), use[c].observations);
    } else {
      if (options.distortion && CameraModelNumDistortion(camera.model) == 0) {
        camera = WithDistortion(camera);
      }
      problem.free_camera_params[c] = RefinedParams(options, camera.model);
      report.refined = true;
      report.pinhole_is_refined = options.focal_length && options.principal_point;
    }
    report.model_after = CameraModelName(camera.model);
    report.after = camera.params;
    reports.push_back(std::move(report));
  }
  return reports;
}

void WarnIfNoneIsRefined(const IntrinsicsOptions& options,
                         const std::vector<IntrinsicsReport>& reports) {
  if (std::any_of(reports.begin(), reports.end(), [](const auto& r) { return r.refined; })) return;
  spdlog::warn(
      "no camera is refined: none asked for has {} images (intrinsics.min_images) and {} "
      "observations (intrinsics.min_observations) in use; intrinsics.shared lets cameras that are "
      "alike be one",
      options.min_images, options.min_observations);
}

void TellParameters(const BundleMap& map, std::vector<IntrinsicsReport>& reports) {
  for (IntrinsicsReport& camera : reports) {
    for (size_t c = 0; c < map.camera_ids.size(); ++c) {
      const auto& ids = map.camera_ids[c];
      if (std::find(ids.begin(), ids.end(), camera.cameras.front()) == ids.end()) continue;
      camera.model_after = CameraModelName(map.problem.cameras[c].model);
      camera.after = map.problem.cameras[c].params;
    }
  }
}

void AddRefined(const std::vector<IntrinsicsReport>& refined,
                std::vector<IntrinsicsReport>& reports) {
  for (const IntrinsicsReport& camera : refined) {
    IntrinsicsReport& report = ReportOf(camera, reports);
    report.refined = true;
    report.reason.clear();
    report.model_after = camera.model_after;
    report.after = camera.after;
    report.distortion_cost_share = 0.0;
    report.distortion_is_doubtful = false;
    if (!camera.pinhole_is_refined) continue;
    report.pinhole_is_refined = true;
    report.pinhole_cost_share = 0.0;
    report.better_pinhole.clear();
  }
}

void CheckKeptCameras(const IntrinsicsOptions& options, double sigma_px, const BundleMap& map,
                      std::vector<IntrinsicsReport>& reports) {
  SelfCalibrationOptions check;
  check.min_cost_decrease = kDoubtfulCostShare;
  for (const size_t c : MostUsedKeptCameras(options, map.problem)) {
    const Camera& camera = map.problem.cameras[c];
    const SelfCalibrationReport checked =
        CheckCalibration(check, camera, ProblemOfCamera(map.problem, c, sigma_px));
    IntrinsicsReport& report = ReportOf(ReportOfKept(map.camera_ids[c], camera), reports);
    report.distortion_cost_share = checked.cost_decrease;
    report.distortion_is_doubtful = checked.accepted;
    report.pinhole_cost_share = checked.pinhole_cost_decrease;
    report.better_pinhole = checked.better_pinhole;
    WarnOfDoubts(report);
  }
}

std::string DoubtsAboutCamera(const IntrinsicsOptions& options, const Camera& before,
                              const Camera& after) {
  for (const auto& [was, is] :
       {std::pair(before.FocalX(), after.FocalX()), std::pair(before.FocalY(), after.FocalY())}) {
    if (!(std::abs(is / was - 1.0) <= options.max_focal_change)) {
      return fmt::format(
          "its focal length would become {:.6g} px instead of {:.6g} px "
          "(intrinsics.max_focal_change can be raised)",
          is, was);
    }
  }
  const double shift = std::hypot(after.PrincipalX() - before.PrincipalX(),
                                  after.PrincipalY() - before.PrincipalY());
  if (!(shift <= options.max_principal_shift * std::max(before.width, before.height))) {
    return fmt::format(
        "its principal point would move by {:.6g} px (intrinsics.max_principal_shift can be "
        "raised)",
        shift);
  }
  if (InvertibleOnBorder(before) && !InvertibleOnBorder(after)) {
    return "its distortion could no longer be inverted at the image's border";
  }
  return {};
}

HeldCameras DoubtfulCameras(const IntrinsicsOptions& options, const std::vector<Camera>& before,
                            const BundleMap& map) {
  HeldCameras doubtful;
  for (size_t c = 0; c < before.size(); ++c) {
    if (map.problem.free_camera_params[c].empty()) continue;
    const std::string doubts = DoubtsAboutCamera(options, before[c], map.problem.cameras[c]);
    if (doubts.empty()) continue;
    for (const CameraId id : map.camera_ids[c]) doubtful[id] = doubts;
  }
  return doubtful;
}

}  // namespace s3lam
