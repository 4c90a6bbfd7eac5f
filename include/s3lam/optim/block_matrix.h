#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace s3lam {

/// Lower triangle of a symmetric matrix of small dense blocks. Block column i is one dense panel:
/// the blocks (j, i), j >= i ascending, one under the other, column-major. The scalar columns of
/// all panels one after the other are a compressed-column matrix, so what fills the panels has
/// filled the matrix that is factored. The diagonal blocks are stored whole; what is above the
/// diagonal is never read.
class BlockMatrix {
 public:
  BlockMatrix() = default;
  /// `sizes`: of the blocks. `columns[i]`: the j > i with a block (j, i), ascending.
  BlockMatrix(const std::vector<int>& sizes, const std::vector<std::vector<int>>& columns);

  [[nodiscard]] int num_blocks() const { return static_cast<int>(offset_.size()) - 1; }
  [[nodiscard]] int num_rows() const { return offset_.back(); }
  [[nodiscard]] size_t num_values() const { return panel_begin_.back(); }
  /// Scalar index of block i's first row, of all rows for i = num_blocks().
  [[nodiscard]] int offset(int i) const { return offset_[i]; }
  [[nodiscard]] int size(int i) const { return offset_[i + 1] - offset_[i]; }
  /// The blocks of panel i: their block rows, the first one i itself, and their first scalar row
  /// within the panel.
  [[nodiscard]] size_t begin(int i) const { return column_begin_[i]; }
  [[nodiscard]] size_t end(int i) const { return column_begin_[i + 1]; }
  [[nodiscard]] int block(size_t k) const { return block_[k]; }
  [[nodiscard]] int place(size_t k) const { return place_[k]; }
  /// Place of block (j, i) in panel i; it must be there.
  [[nodiscard]] int PlaceOf(int j, int i) const;

  using Panel = Eigen::Map<Eigen::MatrixXd>;
  using ConstPanel = Eigen::Map<const Eigen::MatrixXd>;
  [[nodiscard]] int panel_rows(int i) const { return panel_rows_[i]; }
  Panel panel(int i) { return {values_.data() + panel_begin_[i], panel_rows_[i], size(i)}; }
  [[nodiscard]] ConstPanel panel(int i) const {
    return {values_.data() + panel_begin_[i], panel_rows_[i], size(i)};
  }
  /// Allocates the values (zero).
  void Allocate() { values_.assign(num_values(), 0.0); }
  [[nodiscard]] const double* values() const { return values_.data(); }

 private:
  std::vector<int> offset_{0};
  std::vector<size_t> column_begin_;
  std::vector<int> block_;
  std::vector<int> place_;
  std::vector<int> panel_rows_;
  std::vector<size_t> panel_begin_{0};
  std::vector<double> values_;
};

}  // namespace s3lam
