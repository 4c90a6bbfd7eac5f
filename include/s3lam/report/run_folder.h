#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"
#include "s3lam/scene/trajectory.h"

namespace s3lam::report {

/// One state of the map: before, after plain bundle adjustment, after planar bundle adjustment.
struct Arm {
  std::string key;    // "before", "plain", "planar"; in file names.
  std::string title;  // For people.
  Reconstruction model;
  Trajectory trajectory;  // All frames if known, else the keyframes; may be empty.
  std::vector<PlanarSurface> planes;
};

/// The report.json and config.json of one folder; null where there is none.
struct StageRecord {
  std::string folder;
  nlohmann::json report;
  nlohmann::json config;
};

/// What a folder as tools/run.sh makes it holds.
struct RunFolder {
  std::string name;
  std::vector<Arm> arms;  // In the order of processing; at least one.
  std::optional<SemanticMap> semantics;
  std::vector<StageRecord> stages;
  std::filesystem::path image_directory;  // As the run noted it; empty if unknown.
  std::vector<std::string> missing;       // One sentence for each part that is not there.
};

/// Reads 1_slam/, 2_lift/, 3_refine_plain/ and 3_refine/, as far as they are there. Without 1_slam/
/// (a run on a COLMAP model) the state before is the model in 2_lift/model_by_class/. Throws
/// InputError naming the file if there is no model at all, or something is damaged or does not
/// belong together.
RunFolder ReadRunFolder(const std::filesystem::path& directory);

/// The planes of the semantic map, and those that only an arm has.
std::map<PlaneId, PlanarSurface> AllPlanes(const RunFolder& run);

/// The report.json of a stage; null where there is none. It may be of another version, or not of
/// ours at all: anything may lack in it.
const nlohmann::json* FindReport(const RunFolder& run, const std::string& folder);

}  // namespace s3lam::report
