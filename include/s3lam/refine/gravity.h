#pragma once

#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/similarity3.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

enum class GravityMode {
  kOff,
  kUpright,  // z points up.
  kFloor,    // And the lowest level surface is at z = 0.
};

/// Which way is up, from classes that are level or upright by nature (their orientation in the
/// class table).
struct GravityOptions {
  GravityMode mode = GravityMode::kOff;
  double max_deviation_deg = 5.0;
  int min_points = 30;
  double min_floor_share = 0.05;

  void Visit(OptionVisitor& v);
};

struct GravityReport {
  bool aligned = false;
  std::string reason;          // Why not, if not.
  size_t num_planes = 0;       // Whose class says something.
  size_t num_agreeing = 0;     // Within max_deviation_deg.
  double deviation_deg = 0.0;  // RMS of those, weighted by points.
  double turned_deg = 0.0;     // Between the old z and up.
  PlaneId floor;               // At z = 0; invalid without.
  std::string floor_class;
};

/// The direction (unit, in the model's world) that planes of horizontal classes are nearest to
/// being orthogonal to and planes of vertical classes nearest to containing: of the directions that
/// single planes and pairs of upright planes propose, the one that most points agree with, refined
/// over those. The sign is that of the cameras' upper sides, or, for cameras that look straight up
/// or down, of the normals of level planes (which point towards cameras). Empty, with the reason in
/// the report, if no level plane and no two upright ones have min_points, or if less than half of
/// their points agree.
std::optional<Eigen::Vector3d> FindUp(const GravityOptions& options, const SemanticMap& semantics,
                                      const Reconstruction& model, GravityReport& report);

/// The least turn that makes z point up and, in mode floor, the shift that puts the lowest level
/// plane below the cameras with at least min_floor_share of all level points at z = 0.
std::optional<Similarity3> AlignWithGravity(const GravityOptions& options,
                                            const SemanticMap& semantics,
                                            const Reconstruction& model, GravityReport& report);

}  // namespace s3lam
