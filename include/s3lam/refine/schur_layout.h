#pragma once

#include <cstdint>
#include <vector>

#include "s3lam/optim/block_matrix.h"
#include "s3lam/refine/structure_terms.h"

namespace s3lam {

/// A point is seen by images of a camera that is a variable.
struct PointInCamera {
  int point = 0;
  int variable = 0;
};

/// The variables that stay after the points are eliminated (poses, then planes, then the common
/// height, then the cameras' free parameters), and who touches whom. Constant and unused blocks are
/// no variables.
struct SchurLayout {
  std::vector<int> variable_of_pose;    // -1: none
  std::vector<int> variable_of_plane;   // -1: none
  std::vector<int> variable_of_camera;  // -1: none
  int height_variable = -1;
  int num_poses = 0;    // Variables [0, num_poses) are poses,
  int num_planes = 0;   // the next num_planes are planes,
  int num_cameras = 0;  // the last num_cameras are cameras.
  int held_pose = -1;   // The variable whose distance to the gauge's first pose is held.
  std::vector<int> pose_of_variable;
  std::vector<int> plane_of_variable;   // Of variable num_poses + k.
  std::vector<int> camera_of_variable;  // Of variable first_camera() + k.
  std::vector<int> size;                // Tangent dimension of each variable.
  std::vector<int> offset;              // First scalar of each variable, and their number.

  std::vector<size_t> observation_begin;  // Of each point; one more than points.
  std::vector<size_t> term_begin;         // Of each point among the points on planes.
  std::vector<size_t> chunk_begin;        // Chunks of points with like many observations.
  std::vector<size_t> pose_begin;         // Range of each pose variable in the next.
  std::vector<uint32_t> of_pose;          // Observations by pose variable.
  std::vector<size_t> plane_begin;        // Range of each plane variable in the next.
  std::vector<uint32_t> of_plane;         // Points on planes by plane variable.
  std::vector<PointInCamera> seen;        // Ascending by point, once per camera.
  std::vector<size_t> seen_begin;         // Of each point among those.
  std::vector<size_t> camera_begin;       // Range of each camera variable in the next.
  std::vector<uint32_t> of_camera;        // Points in cameras by camera variable.

  [[nodiscard]] int num_variables() const { return static_cast<int>(size.size()); }
  [[nodiscard]] int num_rows() const { return offset.back(); }
  [[nodiscard]] size_t num_chunks() const { return chunk_begin.size() - 1; }
  [[nodiscard]] int first_camera() const { return num_variables() - num_cameras; }
  [[nodiscard]] bool IsPose(int variable) const { return variable < num_poses; }
  [[nodiscard]] bool IsPlane(int variable) const {
    return variable >= num_poses && variable < num_poses + num_planes;
  }
  [[nodiscard]] bool IsCamera(int variable) const { return variable >= first_camera(); }
  [[nodiscard]] bool IsUsed(size_t point) const {
    return observation_begin[point + 1] > observation_begin[point];
  }
  /// Of a block; -1 if it is constant.
  [[nodiscard]] int VariableOf(const StructureBlock& block) const;
};

SchurLayout MakeSchurLayout(const BundleProblem& problem, const std::vector<StructureTerm>& terms);

/// For each variable the later ones that share a point or a term with it, ascending. Stops, with an
/// empty result, when the blocks would hold more than `max_values` numbers.
std::vector<std::vector<int>> FindCoupledVariables(const BundleProblem& problem,
                                                   const std::vector<StructureTerm>& terms,
                                                   const SchurLayout& layout, size_t max_values,
                                                   int num_threads);

}  // namespace s3lam
