#include "s3lam/optim/block_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "s3lam/base/rng.h"

namespace s3lam {
namespace {

struct System {
  BlockMatrix matrix;
  Eigen::MatrixXd full;
  Eigen::VectorXd right;
};

/// Blocks of sizes 6, 3 and 1; each is tied to the next two and to the last one.
System MakeSystem(int num_blocks) {
  Rng rng(3);
  std::vector<int> sizes;
  std::vector<std::vector<int>> columns;
  for (int i = 0; i < num_blocks; ++i) {
    sizes.push_back(i % 5 == 3 ? 3 : i % 5 == 4 ? 1 : 6);
    columns.emplace_back();
    for (int j = i + 1; j < num_blocks; ++j) {
      if (j <= i + 2 || j == num_blocks - 1) columns.back().push_back(j);
    }
  }
  System system;
  system.matrix = BlockMatrix(sizes, columns);
  system.matrix.Allocate();
  const int rows = system.matrix.num_rows();
  system.full = Eigen::MatrixXd::Zero(rows, rows);
  system.right.resize(rows);
  for (int r = 0; r < rows; ++r) system.right[r] = rng.Gaussian();
  for (int i = 0; i < num_blocks; ++i) {
    auto panel = system.matrix.panel(i);
    for (Eigen::Index k = 0; k < panel.size(); ++k) panel.data()[k] = 0.1 * rng.Gaussian();
    for (int r = 0; r < sizes[i]; ++r) panel(r, r) = 10.0 + r;  // What is above it is garbage.
    for (size_t k = system.matrix.begin(i); k < system.matrix.end(i); ++k) {
      const int j = system.matrix.block(k);
      system.full.block(system.matrix.offset(j), system.matrix.offset(i), sizes[j], sizes[i]) =
          panel.middleRows(system.matrix.place(k), sizes[j]);
    }
  }
  system.full = system.full.selfadjointView<Eigen::Lower>().toDenseMatrix().eval();
  return system;
}

class BlockCholeskyTest : public ::testing::TestWithParam<int> {};

TEST_P(BlockCholeskyTest, BothKindsSolveTheSystem) {
  const System system = MakeSystem(GetParam());
  const Eigen::VectorXd expected = system.full.llt().solve(system.right);
  for (const auto& factor : {MakeDenseCholesky(system.matrix), MakeSparseCholesky(system.matrix)}) {
    Eigen::VectorXd x;
    ASSERT_TRUE(factor->Solve(system.matrix, system.right, x));
    EXPECT_LT((x - expected).norm(), 1e-12 * expected.norm());
    EXPECT_GT(factor->num_flops(), 0.0);
    EXPECT_GE(factor->num_entries(), system.matrix.num_rows());
  }
}

TEST_P(BlockCholeskyTest, TheSameFactorServesNewValues) {
  System system = MakeSystem(GetParam());
  const auto factor = MakeSparseCholesky(system.matrix);
  Eigen::VectorXd x;
  ASSERT_TRUE(factor->Solve(system.matrix, system.right, x));
  for (int i = 0; i < system.matrix.num_blocks(); ++i) system.matrix.panel(i) *= 4.0;
  Eigen::VectorXd quarter;
  ASSERT_TRUE(factor->Solve(system.matrix, system.right, quarter));
  EXPECT_LT((4.0 * quarter - x).norm(), 1e-12 * x.norm());
}

TEST_P(BlockCholeskyTest, AMatrixThatIsNotPositiveDefiniteIsRefused) {
  System system = MakeSystem(GetParam());
  system.matrix.panel(0)(0, 0) = -1.0;
  Eigen::VectorXd x;
  EXPECT_FALSE(MakeDenseCholesky(system.matrix)->Solve(system.matrix, system.right, x));
  EXPECT_FALSE(MakeSparseCholesky(system.matrix)->Solve(system.matrix, system.right, x));
}

INSTANTIATE_TEST_SUITE_P(Sizes, BlockCholeskyTest, ::testing::Values(1, 2, 40));

}  // namespace
}  // namespace s3lam
