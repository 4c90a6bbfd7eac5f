#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "s3lam/report/common_frame.h"
#include "s3lam/report/frame_trust.h"
#include "s3lam/report/run_folder.h"

namespace s3lam::report {

/// What the 3D view of the page is given: a description, and arrays in base64 by name.
struct ViewerData {
  nlohmann::json meta;
  std::vector<std::pair<std::string, std::string>> arrays;
  size_t num_points = 0;
  bool has_truth = false;
  bool has_trust = false;  // Of some arm's trajectory.
};

/// All points of all arms; those an arm does not have are NaN in its positions. Positions are
/// float32 about the middle of the map, so that a map far from its world's origin loses nothing.
ViewerData MakeViewerData(const RunFolder& run, const CommonFrame& frame, const FrameTrust& trust);

}  // namespace s3lam::report
