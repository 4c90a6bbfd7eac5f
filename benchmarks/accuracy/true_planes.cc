// What planes could give poses: a bundle adjustment with the true planes of a rendered scene, held
// exactly where they are, with keypoints as they are and with ones that err independently.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <map>
#include <utility>
#include <vector>

#include "common/program.h"
#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"
#include "s3lam/eval/plane_errors.h"
#include "s3lam/eval/trajectory_error.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/file.h"
#include "s3lam/io/keypoint_sigmas.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/io/trajectory.h"
#include "s3lam/refine/outer_loop.h"
#include "s3lam/refine/problem_builder.h"

namespace s3lam::tools {
namespace {

namespace fs = std::filesystem;
namespace po = boost::program_options;

/// Sigmas of points on true planes that are tried, in sizes of a pixel at the point's depth: what
/// is best is not known beforehand, since some points are not on the plane that they are said to
/// be.
constexpr std::array kSigmas{1.0, 0.3, 0.1, 0.03, 0.01};

/// Points farther from the true plane are of another surface [sizes of a pixel at their depth].
constexpr double kMaxPixels = 0.5;

constexpr int kDraws = 20;  // Of the keypoints that err independently.

constexpr double kFlat = 1e-3;  // A surface that is nowhere farther from its plane [m].

struct Truth {
  Trajectory trajectory;
  std::vector<KnownPlane> planes;
};

/// Of surfaces that are flat: a street's ground has a best plane, too.
std::vector<KnownPlane> FlatPlanes(const std::string& path) {
  nlohmann::json scene = ReadJson(path);
  const auto bends = [](const nlohmann::json& object) {
    return object.contains("plane_gt") && object["plane_gt"].value("max_distance_m", 0.0) > kFlat;
  };
  if (scene.contains("objects") && scene["objects"].is_array()) {
    std::erase_if(scene["objects"].get_ref<nlohmann::json::array_t&>(), bends);
  }
  return KnownPlanesFromJson(scene, "gt", {}, path);
}

/// Of the keyframes, whose times are those of `times`.
Trajectory TrajectoryOf(const BundleProblem& problem, const Trajectory& times) {
  Trajectory trajectory = times;
  for (size_t i = 0; i < trajectory.size(); ++i) {
    trajectory[i].world_from_camera = FromPoseBlock(problem.poses[i].data()).Inverse();
  }
  return trajectory;
}

TrajectoryErrors ErrorsOf(const BundleProblem& problem, const Trajectory& times,
                          const Trajectory& truth) {
  const auto errors = CompareTrajectories(TrajectoryOf(problem, times), truth);
  if (!errors) throw InputError("the keyframes cannot be aligned with the ground truth");
  return *errors;
}

/// The surfaces that are found planes of known ones, as those are in the map.
std::map<PlaneId, Plane> TruePlanes(const SemanticMap& semantics, const Truth& truth,
                                    const Similarity3& truth_from_map) {
  std::vector<FittedPlane> fitted;
  for (const auto& [id, surface] : semantics.planes) {
    fitted.push_back({id, "", surface.plane_in_world, surface.centroid_in_world, 0});
  }
  PlaneErrorOptions options;
  options.max_angle_deg = 1.0;
  options.max_distance = 0.01;
  std::map<PlaneId, Plane> planes;
  for (const PlaneMatch& match :
       ComparePlanes(truth.planes, fitted, truth_from_map, options).matches) {
    if (!match.fitted) continue;
    planes[match.fitted->id] = TransformPlane(truth_from_map.Inverse(), match.known.plane_in_truth);
  }
  return planes;
}

/// Puts the points of found planes onto the true ones, which hold the world then.
void HoldTruePlanes(const SemanticMap& semantics, const std::map<PlaneId, Plane>& planes,
                    double sigma_in_pixels, BundleMap& map) {
  BundleProblem& problem = map.problem;
  const std::vector<double> pixels = PixelSizes(problem);
  for (const auto& [id, plane] : planes) {
    const PlanarSurface& surface = semantics.planes.at(id);
    const int index = static_cast<int>(problem.planes.size());
    problem.planes.push_back(AnchoredPlane::FromPlane(plane, surface.centroid_in_world));
    problem.planes.back().is_constant = true;
    for (const PointId point : surface.inliers) {
      const int j = map.IndexOfPoint(point);
      if (j < 0 || !(pixels[j] > 0.0)) continue;
      if (std::abs(plane.SignedDistance(problem.points[j])) > kMaxPixels * pixels[j]) continue;
      problem.points_on_planes.push_back({j, index, sigma_in_pixels * pixels[j]});
    }
  }
  std::sort(problem.points_on_planes.begin(), problem.points_on_planes.end(),
            [](const auto& a, const auto& b) { return a.point < b.point; });
  problem.gauge = Gauge{};
}

/// What would be seen if the map were the truth, its points were on the planes they have and
/// keypoints erred independently.
void DrawObservations(double sigma_px, Rng& rng, BundleProblem& problem) {
  for (const PointOnPlane& term : problem.points_on_planes) {
    Eigen::Vector3d& point = problem.points[term.point];
    point = problem.planes[term.plane].PlaneInWorld().Project(point);
  }
  std::vector<BundleObservation> seen;
  for (BundleObservation o : problem.observations) {
    const Camera& camera = problem.cameras[problem.camera_of_pose[o.pose]];
    const auto pixel = camera.ImageFromCamera(FromPoseBlock(problem.poses[o.pose].data()) *
                                              problem.points[o.point]);
    if (!pixel) continue;
    o.pixel = *pixel + sigma_px * o.sigma * Eigen::Vector2d(rng.Gaussian(), rng.Gaussian());
    seen.push_back(o);
  }
  problem.observations = std::move(seen);
}

/// Keyframes off in the mean over the draws, with keypoints that err independently.
struct IdealErrors {
  double plain = 0.0;
  double planes_found = 0.0;  // With planes that are adjusted, too.
  double planes_held = 0.0;
};

/// `held` has points on planes, which are made exact.
IdealErrors MeasureIdeal(const BundleSolverOptions& solver, const Trajectory& times,
                         const BundleProblem& held, const TrajectoryErrors& scale, uint64_t seed) {
  const Trajectory truth = TrajectoryOf(held, times);
  const double metres = scale.truth_from_estimate.scale;
  IdealErrors mean;
  for (int draw = 0; draw < kDraws; ++draw) {
    Rng rng = Rng(seed).Fork(static_cast<uint64_t>(draw));
    BundleProblem seen = held;
    DrawObservations(solver.sigma_px, rng, seen);
    const auto error_of = [&](BundleProblem problem) {
      SolveBundle(solver, problem);
      return metres * ErrorsOf(problem, times, truth).ate_translation.rmse / kDraws;
    };
    mean.planes_held += error_of(seen);
    for (AnchoredPlane& plane : seen.planes) plane.is_constant = false;
    seen.gauge = ChooseGauge(seen);
    mean.planes_found += error_of(seen);
    seen.planes.clear();
    seen.points_on_planes.clear();
    mean.plain += error_of(seen);
  }
  return mean;
}

void Run(const po::variables_map& arguments, const CommonArguments& common) {
  const fs::path folder = Required(arguments, "model");
  const Reconstruction model = ReadColmapModel(folder);
  const Trajectory times = ReadTumTrajectory(folder / "keyframes.txt");
  const std::string lifted = Required(arguments, "semantics");
  const SemanticMap semantics = ReadSemanticMap(lifted);
  CheckMadeFromModel(semantics, FingerprintOfModel(model), lifted);
  const Truth truth{ReadTrajectory(Required(arguments, "ground-truth")),
                    FlatPlanes(Required(arguments, "objects"))};

  OuterLoopSettings settings;
  settings.solver.num_threads = common.threads;
  BundleMap map = BuildBundleMap(model, ReadKeypointSigmas(folder / "keypoint_sigmas.bin"));
  if (times.size() != map.problem.poses.size()) {
    throw InputError("keyframes.txt is not of the model's images");
  }
  SelectObservations(settings.outliers, settings.solver.sigma_px, true, map);
  map.problem.gauge = ChooseGauge(map.problem);
  AdjustPlain(settings, map);
  const TrajectoryErrors plain = ErrorsOf(map.problem, times, truth.trajectory);
  const auto planes = TruePlanes(semantics, truth, plain.truth_from_estimate);

  const double without = plain.ate_translation.rmse;
  nlohmann::json tried = nlohmann::json::array();
  std::string table = fmt::format("{} true planes; keyframes off without them {:.3g}, with them",
                                  planes.size(), without);
  for (const double sigma : kSigmas) {
    BundleMap held = map;
    HoldTruePlanes(semantics, planes, sigma, held);
    SolveBundle(settings.solver, held.problem);
    const double error = ErrorsOf(held.problem, times, truth.trajectory).ate_translation.rmse;
    tried.push_back({{"sigma_pixels", sigma}, {"ate", error}});
    table +=
        fmt::format(" {:.3g} ({} px, {:+.1f} %)", error, sigma, 100.0 * (error / without - 1.0));
  }
  BundleMap held = map;
  HoldTruePlanes(semantics, planes, kSigmas.back(), held);
  const IdealErrors ideal = MeasureIdeal(settings.solver, times, held.problem, plain, common.seed);
  const auto change = [&](double error) { return 100.0 * (error / ideal.plain - 1.0); };
  table += fmt::format(
      "\nwith keypoints that err independently {:.3g}, with planes {:.3g} ({:+.1f} %), with these "
      "known {:.3g} ({:+.1f} %)",
      ideal.plain, ideal.planes_found, change(ideal.planes_found), ideal.planes_held,
      change(ideal.planes_held));
  const nlohmann::json report{{"keyframes", times.size()},
                              {"planes", planes.size()},
                              {"ate_plain", without},
                              {"with_planes", tried},
                              {"ideal",
                               {{"ate_plain", ideal.plain},
                                {"ate_planes_found", ideal.planes_found},
                                {"ate_planes_held", ideal.planes_held}}}};
  PrintReport(common, table + "\n", report);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  using namespace s3lam;
  namespace po = boost::program_options;
  tools::Program program;
  program.name = "s3-true-planes";
  program.description =
      "What planes could give poses: adjusts the map of a rendered scene without planes and with\n"
      "the true planes of its surfaces, held exactly where they are in the ground truth, at some\n"
      "weights, and prints the error of the keyframes (RMSE after Sim(3) alignment). Prints it\n"
      "for keypoints drawn anew, too, around where the map says they are, with independent errors\n"
      "of the size that keypoints have: what exact planes, known or to be found, give at most.";
  auto add = program.arguments.add_options();
  add("model", po::value<std::string>()->value_name("DIR"), "output of s3-slam");
  add("semantics", po::value<std::string>()->value_name("DIR"), "output of s3-lift");
  add("objects", po::value<std::string>()->value_name("FILE"), "the scene's objects.json");
  add("ground-truth", po::value<std::string>()->value_name("FILE"), "the scene's trajectory");
  program.run = tools::Run;
  return tools::RunProgram(argc, argv, program);
}
