#include "s3lam/semantics/point_rows.h"

#include <algorithm>

#include "s3lam/base/error.h"

namespace s3lam {

PointRows::PointRows(const Reconstruction& reconstruction) {
  constexpr size_t kMaxEntriesPerPoint = 8;
  ids_.reserve(reconstruction.points.size());
  for (const auto& [id, point] : reconstruction.points) ids_.push_back(id);
  if (ids_.empty() || ids_.back().value() / kMaxEntriesPerPoint >= ids_.size()) return;
  row_of_id_.resize(ids_.back().value() + 1);
  for (uint32_t row = 0; row < ids_.size(); ++row) row_of_id_[ids_[row].value()] = row;
}

uint32_t PointRows::RowOf(PointId id) const {
  const bool have_table = !row_of_id_.empty();
  const auto row =
      have_table
          ? (id.value() < row_of_id_.size() ? row_of_id_[id.value()] : size())
          : static_cast<size_t>(std::lower_bound(ids_.begin(), ids_.end(), id) - ids_.begin());
  S3LAM_CHECK(row < size() && ids_[row] == id);
  return static_cast<uint32_t>(row);
}

}  // namespace s3lam
