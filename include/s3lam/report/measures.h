#pragma once

#include <map>
#include <vector>

#include "s3lam/geometry/similarity3.h"
#include "s3lam/report/run_folder.h"

namespace s3lam::report {

/// Per arm the reprojection errors [px] of the observations that all arms have, in the same order;
/// observations that are behind a camera in any arm are left out.
std::vector<std::vector<double>> CommonReprojectionErrors(const std::vector<Arm>& arms);

/// How far the points of one plane of the semantic map are from a plane fitted (least squares) to
/// them in each arm, so that no arm is measured with another's plane.
struct PlaneDistances {
  PlaneId id;
  std::vector<PlanarSurface> fitted;           // Per arm: plane, centroid, axes and outline.
  std::vector<std::vector<double>> distances;  // Per arm, of the same points [arm's units].
};

/// Over the inliers that all arms have; planes with fewer than four of them are left out.
std::vector<PlaneDistances> MeasurePlaneDistances(const std::vector<Arm>& arms,
                                                  const SemanticMap& semantics);

}  // namespace s3lam::report
