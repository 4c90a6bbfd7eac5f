#include "s3lam/report/run_folder.h"

#include "s3lam/base/error.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/file.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/io/trajectory.h"

namespace s3lam::report {
namespace fs = std::filesystem;
namespace {

constexpr const char* kSlam = "1_slam";
constexpr const char* kLift = "2_lift";
constexpr const char* kRefine = "3_refine";
constexpr const char* kPlain = "3_refine_plain";

Trajectory ReadArmTrajectory(const fs::path& directory) {
  for (const char* name : {"frames.txt", "keyframes.txt"}) {
    if (fs::exists(directory / name)) return ReadTumTrajectory(directory / name);
  }
  return {};
}

void ReadArm(const fs::path& directory, const char* key, const char* title, RunFolder& run) {
  Arm arm;
  arm.key = key;
  arm.title = title;
  arm.model = ReadColmapModel(directory);
  arm.trajectory = ReadArmTrajectory(directory);
  run.arms.push_back(std::move(arm));
}

nlohmann::json ReadJsonIfThere(const fs::path& path) {
  return fs::exists(path) ? ReadJson(path) : nlohmann::json();
}

void ReadRecords(const fs::path& directory, RunFolder& run) {
  for (const char* folder : {kSlam, kLift, kPlain, kRefine}) {
    if (!fs::is_directory(directory / folder)) continue;
    StageRecord record{folder, ReadJsonIfThere(directory / folder / "report.json"),
                       ReadJsonIfThere(directory / folder / "config.json")};
    if (!record.report.is_object() && !record.report.is_null()) {
      ThrowInputError("{}: not a JSON object", (directory / folder / "report.json").string());
    }
    run.stages.push_back(std::move(record));
  }
}

/// The image folder that project.ini names.
fs::path NotedImageDirectory(const fs::path& directory) {
  for (const char* folder : {kSlam, kRefine, kPlain}) {
    if (const auto images = ReadColmapProject(directory / folder / "project.ini")) return *images;
  }
  return {};
}

void ReadModels(const fs::path& directory, RunFolder& run) {
  const fs::path coloured = directory / kLift / "model_by_class";
  if (fs::is_directory(directory / kSlam)) {
    ReadArm(directory / kSlam, "before", "SLAM", run);
  } else if (fs::is_directory(coloured)) {
    ReadArm(coloured, "before", "input model", run);
    run.missing.emplace_back(
        "There is no 1_slam/: the map before refinement is the input model, in class colours.");
  } else {
    run.missing.emplace_back("There is no 1_slam/: nothing is shown of the map before refinement.");
  }
  if (fs::is_directory(directory / kPlain)) {
    ReadArm(directory / kPlain, "plain", "BA without planes", run);
  } else {
    run.missing.emplace_back("There is no 3_refine_plain/: no bundle adjustment without planes.");
  }
  if (fs::is_directory(directory / kRefine)) {
    ReadArm(directory / kRefine, "planar", "planar BA", run);
  } else {
    run.missing.emplace_back("There is no 3_refine/: no planar bundle adjustment.");
  }
  if (run.arms.empty()) {
    ThrowInputError("{}: holds no model (1_slam, 2_lift/model_by_class, 3_refine_plain, 3_refine)",
                    directory.string());
  }
}

void ReadSemantics(const fs::path& directory, RunFolder& run) {
  if (!fs::is_directory(directory / kLift)) {
    run.missing.emplace_back("There is no 2_lift/: no classes, objects and planes.");
    return;
  }
  SemanticMap semantics = ReadSemanticMap(directory / kLift);
  Arm& first = run.arms.front();
  if (first.key == "before") {
    const std::string source = (directory / kLift).string();
    CheckMadeFromModel(semantics, FingerprintOfModel(first.model), source);
    CheckSemanticMap(semantics, first.model, source);
    for (const auto& [id, plane] : semantics.planes) first.planes.push_back(plane);
  }
  const fs::path refined = directory / kRefine / "planes.json";
  if (run.arms.back().key == "planar" && fs::exists(refined)) {
    run.arms.back().planes = ReadRefinedPlanes(refined, semantics);
  }
  run.semantics = std::move(semantics);
}

}  // namespace

std::map<PlaneId, PlanarSurface> AllPlanes(const RunFolder& run) {
  std::map<PlaneId, PlanarSurface> planes;
  if (run.semantics) planes = run.semantics->planes;
  for (const Arm& arm : run.arms) {
    for (const PlanarSurface& plane : arm.planes) planes.emplace(plane.id, plane);
  }
  return planes;
}

const nlohmann::json* FindReport(const RunFolder& run, const std::string& folder) {
  for (const StageRecord& stage : run.stages) {
    if (stage.folder == folder && stage.report.is_object()) return &stage.report;
  }
  return nullptr;
}

RunFolder ReadRunFolder(const fs::path& directory) {
  if (!fs::is_directory(directory)) ThrowInputError("{}: no such folder", directory.string());
  RunFolder run;
  run.name = fs::canonical(directory).filename().string();
  ReadModels(directory, run);
  ReadSemantics(directory, run);
  ReadRecords(directory, run);
  run.image_directory = NotedImageDirectory(directory);
  return run;
}

}  // namespace s3lam::report
