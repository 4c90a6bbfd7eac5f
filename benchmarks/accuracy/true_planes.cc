// What planes could give poses: a bundle adjustment with the true planes of a rendered scene, held
// exactly where they are.

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>

#include "common/program.h"
#include "s3lam/base/error.h"
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

TrajectoryErrors ErrorsOf(const BundleProblem& problem, const Trajectory& times,
                          const Truth& truth) {
  Trajectory estimate = times;
  for (size_t i = 0; i < estimate.size(); ++i) {
    estimate[i].world_from_camera = FromPoseBlock(problem.poses[i].data()).Inverse();
  }
  const auto errors = CompareTrajectories(estimate, truth.trajectory);
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
  options.max_angle_deg = 5.0;
  options.max_distance = 0.02;
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
      problem.points_on_planes.push_back({j, index, sigma_in_pixels * pixels[j]});
    }
  }
  std::sort(problem.points_on_planes.begin(), problem.points_on_planes.end(),
            [](const auto& a, const auto& b) { return a.point < b.point; });
  problem.gauge = Gauge{};
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
  const TrajectoryErrors plain = ErrorsOf(map.problem, times, truth);
  const auto planes = TruePlanes(semantics, truth, plain.truth_from_estimate);

  const double without = plain.ate_translation.rmse;
  nlohmann::json tried = nlohmann::json::array();
  std::string table = fmt::format("{} true planes; keyframes off without them {:.3g}, with them",
                                  planes.size(), without);
  for (const double sigma : kSigmas) {
    BundleMap held = map;
    HoldTruePlanes(semantics, planes, sigma, held);
    SolveBundle(settings.solver, held.problem);
    const double error = ErrorsOf(held.problem, times, truth).ate_translation.rmse;
    tried.push_back({{"sigma_pixels", sigma}, {"ate", error}});
    table +=
        fmt::format(" {:.3g} ({} px, {:+.1f} %)", error, sigma, 100.0 * (error / without - 1.0));
  }
  const nlohmann::json report{{"keyframes", times.size()},
                              {"planes", planes.size()},
                              {"ate_plain", without},
                              {"with_planes", tried}};
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
      "weights, and prints the error of the keyframes (RMSE after Sim(3) alignment).";
  auto add = program.arguments.add_options();
  add("model", po::value<std::string>()->value_name("DIR"), "output of s3-slam");
  add("semantics", po::value<std::string>()->value_name("DIR"), "output of s3-lift");
  add("objects", po::value<std::string>()->value_name("FILE"), "the scene's objects.json");
  add("ground-truth", po::value<std::string>()->value_name("FILE"), "the scene's trajectory");
  program.run = tools::Run;
  return tools::RunProgram(argc, argv, program);
}
