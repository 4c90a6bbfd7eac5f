#pragma once

#include <Eigen/Core>
#include <optional>

#include "s3lam/geometry/similarity3.h"
#include "s3lam/refine/pipeline.h"

namespace s3lam::refine {

/// Map, semantics and frames in another world, or other units; the constraints stay as they are.
void TransformInput(const Similarity3& new_from_old, Input& input);

/// The mean place of the cameras, if that is so far from the world's origin that turning them about
/// it would drown in rounding (maps in UTM or geocentric coordinates).
std::optional<Eigen::Vector3d> FarPlaceOf(const Reconstruction& model);

/// The input, constraints and all, shifted so that `place` is the origin.
Input BroughtToOrigin(const Eigen::Vector3d& place, const Input& given);

/// Shifts the output of a BroughtToOrigin input back. What is held is as it was `given`, to the
/// last bit.
void ReturnToPlace(const Eigen::Vector3d& place, const Input& given, Output& output);

/// In metres, by the known height of the camera; upright, by the classes that are level or upright.
/// Warns if that moves what the constraints hold. Returns how the output was transformed.
Similarity3 ChooseWorld(const Options& options, const Constraints& constraints, Output& output,
                        Report& report);

}  // namespace s3lam::refine
