#pragma once

#include <optional>

#include "s3lam/geometry/similarity3.h"
#include "s3lam/refine/problem_builder.h"
#include "s3lam/scene/constraints.h"

namespace s3lam {

/// The world of the pose priors, where that is another than the model's: if half of the known
/// positions are farther from the model's than ten sigmas. By all positions, or by a pose and the
/// position farthest from it where they are on a line. Empty if the worlds are the same, if
/// constant parts hold the model's, or if the priors do not determine theirs.
std::optional<Similarity3> PriorWorldFromModel(const Constraints& constraints,
                                               const Reconstruction& model);

/// Marks constant images and points and adds the pose priors. Throws InputError if a prior is of an
/// image that the map does not have.
void ApplyConstraints(const Constraints& constraints, BundleMap& map);

/// What holds the world's seven freedoms beside the constraints of the problem: nothing if constant
/// images, constant points and priors do it alone (a pose and another place, or three places that
/// are not on a line); else as ChooseGauge, with a constant image, if there is one, in the place of
/// the first image. Throws InputError for priors that do not suffice.
Gauge ChooseGaugeWithConstraints(const BundleProblem& problem);

}  // namespace s3lam
