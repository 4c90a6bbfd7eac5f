#pragma once

#include <map>
#include <vector>

#include "s3lam/base/id.h"

namespace s3lam {

/// Per image of a model, the standard deviation of each of its keypoints, both axes [px]; as many
/// and in the order of the image's points2D.
using KeypointSigmas = std::map<ImageId, std::vector<float>>;

}  // namespace s3lam
