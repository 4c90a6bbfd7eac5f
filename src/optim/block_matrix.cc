#include "s3lam/optim/block_matrix.h"

#include <algorithm>

namespace s3lam {

BlockMatrix::BlockMatrix(const std::vector<int>& sizes,
                         const std::vector<std::vector<int>>& columns) {
  for (const int size : sizes) offset_.push_back(offset_.back() + size);
  column_begin_.push_back(0);
  for (size_t i = 0; i < sizes.size(); ++i) {
    block_.push_back(static_cast<int>(i));
    place_.push_back(0);
    int rows = sizes[i];
    for (const int j : columns[i]) {
      block_.push_back(j);
      place_.push_back(rows);
      rows += sizes[j];
    }
    column_begin_.push_back(block_.size());
    panel_rows_.push_back(rows);
    panel_begin_.push_back(panel_begin_.back() +
                           static_cast<size_t>(rows) * static_cast<size_t>(sizes[i]));
  }
}

int BlockMatrix::PlaceOf(int j, int i) const {
  const auto first = block_.begin() + static_cast<std::ptrdiff_t>(begin(i));
  const auto last = block_.begin() + static_cast<std::ptrdiff_t>(end(i));
  return place_[static_cast<size_t>(std::lower_bound(first, last, j) - block_.begin())];
}

}  // namespace s3lam
