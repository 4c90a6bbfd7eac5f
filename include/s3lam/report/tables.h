#pragma once

#include <vector>

#include "s3lam/report/common_frame.h"
#include "s3lam/report/measures.h"
#include "s3lam/report/pipeline.h"

namespace s3lam::report {

/// What was measured for each arm.
struct Measures {
  CommonFrame frame;
  std::vector<std::vector<double>> reprojection_px;  // Per arm.
  std::vector<PlaneDistances> planes;
  std::vector<std::vector<double>> plane_distances;  // Per arm, all planes [frame.unit].
};

Table SummaryTable(const RunFolder& run, const Measures& measures);
/// One row per plane; distances only for planes of the semantic map, whose points all arms know.
Table PlaneTable(const RunFolder& run, const Measures& measures);
/// The pairs of nearly parallel or orthogonal planes, from the report of the planar adjustment.
Table RelationTable(const RunFolder& run);
/// Seconds of each step and peak memory of each program.
Table TimingTable(const RunFolder& run);

}  // namespace s3lam::report
