#pragma once

#include <filesystem>

#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// Writes a database (SQLite, with the tables of COLMAP 3.8) with which COLMAP can go on from a
/// model, e.g. by `colmap mapper` or `colmap point_triangulator`: cameras, images and keypoints
/// with the model's ids, and between every two images that share points their matches and a
/// two-view geometry (calibrated; F, E and the relative pose from the model's poses, H zero). There
/// are no descriptors: COLMAP's matchers take SIFT's of 128 bytes alone (3.8 aborts on others), so
/// they cannot add matches.
///
/// The same model gives the same bytes. Replaces what is there. Throws std::runtime_error naming
/// the path if anything fails, a full disk included; the file is then of no use.
void WriteColmapDatabase(const Reconstruction& reconstruction, const std::filesystem::path& path);

}  // namespace s3lam
