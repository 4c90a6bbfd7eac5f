#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// Numbers the points of a reconstruction from 0 by ascending id, so that what is known of them can
/// lie in arrays.
class PointRows {
 public:
  explicit PointRows(const Reconstruction& reconstruction);

  [[nodiscard]] size_t size() const { return ids_.size(); }
  [[nodiscard]] PointId IdOf(uint32_t row) const { return ids_[row]; }
  /// Of a point of the reconstruction.
  [[nodiscard]] uint32_t RowOf(PointId id) const;

 private:
  std::vector<PointId> ids_;         // Ascending.
  std::vector<uint32_t> row_of_id_;  // Empty if the ids are too sparse for a table.
};

}  // namespace s3lam
