#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/io/file.h"
#include "s3lam/scene/reconstruction.h"

namespace s3lam::internal {

/// Files hold rounded quaternions: one that is nearly of unit length is made so, and a unit one
/// keeps its bits. Anything else is left for CheckReconstruction to refuse.
inline Eigen::Quaterniond TidyQuaternion(const Eigen::Quaterniond& q) {
  const double deviation = std::abs(q.squaredNorm() - 1.0);
  return deviation > 1e-14 && deviation < 1e-3 ? q.normalized() : q;
}

/// Inserts an item of a file; files are mostly sorted, so the place is mostly the end. Throws
/// InputError for an invalid or repeated id.
template <typename Map>
void InsertUnique(Map& map, typename Map::key_type id, typename Map::mapped_type&& value,
                  std::string_view what, const std::string& source) {
  if (!id.valid()) ThrowInputError("{}: invalid {} id {}", source, what, id.value());
  const size_t size_before = map.size();
  map.emplace_hint(map.end(), id, std::move(value));
  if (map.size() == size_before) {
    ThrowInputError("{}: {} {} appears twice", source, what, id.value());
  }
}

/// True, with a warning, if the camera of a model that is not supported can be left out: the images
/// of the model are known, and none is of it.
inline bool CanSkipCamera(const Reconstruction& model, CameraId id, std::string_view model_name,
                          const std::string& source) {
  const bool is_used = std::any_of(model.images.begin(), model.images.end(),
                                   [&](const auto& item) { return item.second.camera_id == id; });
  if (is_used || model.images.empty()) return false;
  spdlog::warn("{}: camera {} is left out: no image is of it, and {} is not supported", source,
               id.value(), model_name);
  return true;
}

/// Throws InputError unless the name can be used in both forms of the model, and as that of a file
/// to write.
inline void CheckImageName(std::string_view name, ImageId id, const std::string& source) {
  if (name.empty()) ThrowInputError("{}: image {} has no name", source, id.value());
  for (const char c : name) {
    if (c == '\n' || c == '\r' || c == '\0') {
      ThrowInputError("{}: the name of image {} has a line break or zero byte", source, id.value());
    }
  }
  if (!IsNameWithin(name)) {
    ThrowInputError("{}: the name of image {} leaves the folder of the images: {}", source,
                    id.value(), name);
  }
}

}  // namespace s3lam::internal
