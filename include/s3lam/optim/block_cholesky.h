#pragma once

#include <Eigen/Core>
#include <memory>

#include "s3lam/optim/block_matrix.h"

namespace s3lam {

/// Cholesky factorisation of a BlockMatrix whose pattern stays the same while its values change:
/// the order of elimination is found once. The result does not depend on the number of threads it
/// is called with, since it takes none.
class BlockCholesky {
 public:
  virtual ~BlockCholesky() = default;
  /// Solves matrix * x = right; false if the matrix is not positive definite.
  virtual bool Solve(const BlockMatrix& matrix, const Eigen::VectorXd& right,
                     Eigen::VectorXd& x) = 0;
  /// Of one factorisation.
  [[nodiscard]] virtual double num_flops() const = 0;
  /// Entries of the factor.
  [[nodiscard]] virtual double num_entries() const = 0;
};

std::unique_ptr<BlockCholesky> MakeDenseCholesky(const BlockMatrix& pattern);

/// Minimum degree ordering of the blocks; CHOLMOD's supernodal factorisation where the project was
/// built with it, else Eigen's.
std::unique_ptr<BlockCholesky> MakeSparseCholesky(const BlockMatrix& pattern);

}  // namespace s3lam
