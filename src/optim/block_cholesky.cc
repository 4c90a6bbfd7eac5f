#include "s3lam/optim/block_cholesky.h"

#include <Eigen/Cholesky>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>

#include "s3lam/base/error.h"
#include "single_thread_scope.h"

#ifdef S3LAM_WITH_CHOLMOD
#include <cholmod.h>
#endif

namespace s3lam {
namespace {

class DenseCholesky : public BlockCholesky {
 public:
  explicit DenseCholesky(const BlockMatrix& pattern) : rows_(pattern.num_rows()) {}

  bool Solve(const BlockMatrix& matrix, const Eigen::VectorXd& right, Eigen::VectorXd& x) override {
    full_.setZero(rows_, rows_);
    for (int i = 0; i < matrix.num_blocks(); ++i) {
      const auto panel = matrix.panel(i);
      for (size_t k = matrix.begin(i); k < matrix.end(i); ++k) {
        const int j = matrix.block(k);
        full_.block(matrix.offset(j), matrix.offset(i), matrix.size(j), matrix.size(i)) =
            panel.middleRows(matrix.place(k), matrix.size(j));
      }
    }
    const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(full_);  // In place, lower part.
    if (factor.info() != Eigen::Success) return false;
    x = factor.solve(right);
    return x.allFinite();
  }
  [[nodiscard]] double num_flops() const override {
    return static_cast<double>(rows_) * rows_ * rows_ / 3.0;
  }
  [[nodiscard]] double num_entries() const override { return static_cast<double>(rows_) * rows_; }

 private:
  int rows_;
  Eigen::MatrixXd full_;
};

/// Scalar rows in the order of elimination: minimum degree on the graph of the blocks, which is 36
/// times smaller than that of the scalars.
std::vector<int> OrderOfElimination(const BlockMatrix& pattern) {
  const int n = pattern.num_blocks();
  Eigen::SparseMatrix<char> graph(n, n);
  std::vector<Eigen::Triplet<char>> edges;
  for (int i = 0; i < n; ++i) {
    for (size_t k = pattern.begin(i); k < pattern.end(i); ++k) {
      edges.emplace_back(pattern.block(k), i, char{1});
    }
  }
  graph.setFromTriplets(edges.begin(), edges.end());
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> permutation;
  Eigen::AMDOrdering<int>()(graph.selfadjointView<Eigen::Lower>(), permutation);
  std::vector<int> order;
  order.reserve(static_cast<size_t>(pattern.num_rows()));
  for (int k = 0; k < n; ++k) {
    const int i = permutation.indices()[k];
    for (int row = pattern.offset(i); row < pattern.offset(i + 1); ++row) order.push_back(row);
  }
  return order;
}

/// Begin of each scalar column's entries, and their rows.
void CompressedColumns(const BlockMatrix& pattern, std::vector<int>& begin,
                       std::vector<int>& rows) {
  begin.assign(1, 0);
  rows.clear();
  rows.reserve(pattern.num_values());
  for (int i = 0; i < pattern.num_blocks(); ++i) {
    for (int column = 0; column < pattern.size(i); ++column) {
      for (size_t k = pattern.begin(i); k < pattern.end(i); ++k) {
        const int j = pattern.block(k);
        for (int row = pattern.offset(j); row < pattern.offset(j + 1); ++row) rows.push_back(row);
      }
      begin.push_back(static_cast<int>(rows.size()));
    }
  }
}

#ifdef S3LAM_WITH_CHOLMOD

class SparseCholesky : public BlockCholesky {
 public:
  explicit SparseCholesky(const BlockMatrix& pattern) {
    CompressedColumns(pattern, begin_, rows_);
    cholmod_start(&common_);
    common_.print = 0;
    common_.supernodal = CHOLMOD_AUTO;
    common_.nmethods = 1;
    common_.method[0].ordering = CHOLMOD_GIVEN;
    common_.postorder = 1;
    common_.final_ll = 1;  // Not L D L^T, which takes indefinite matrices too.
    const internal::SingleThreadScope single_thread;
    cholmod_sparse matrix = View(pattern);
    std::vector<int> order = OrderOfElimination(pattern);
    factor_ = cholmod_analyze_p(&matrix, order.data(), nullptr, 0, &common_);
    S3LAM_CHECK(factor_ != nullptr);
    num_flops_ = common_.fl;
    num_entries_ = common_.lnz;
  }
  SparseCholesky(const SparseCholesky&) = delete;
  SparseCholesky& operator=(const SparseCholesky&) = delete;
  ~SparseCholesky() override {
    cholmod_free_factor(&factor_, &common_);
    cholmod_finish(&common_);
  }

  bool Solve(const BlockMatrix& matrix, const Eigen::VectorXd& right, Eigen::VectorXd& x) override {
    const internal::SingleThreadScope single_thread;
    cholmod_sparse view = View(matrix);
    if (cholmod_factorize(&view, factor_, &common_) == 0) return false;
    if (common_.status != CHOLMOD_OK || factor_->minor < factor_->n) return false;
    Eigen::VectorXd copy = right;
    cholmod_dense b{};
    b.nrow = b.d = b.nzmax = static_cast<size_t>(copy.size());
    b.ncol = 1;
    b.x = copy.data();
    b.xtype = CHOLMOD_REAL;
    b.dtype = CHOLMOD_DOUBLE;
    cholmod_dense* solution = cholmod_solve(CHOLMOD_A, factor_, &b, &common_);
    if (solution == nullptr) return false;
    x = Eigen::Map<const Eigen::VectorXd>(static_cast<const double*>(solution->x), right.size());
    cholmod_free_dense(&solution, &common_);
    return x.allFinite();
  }
  [[nodiscard]] double num_flops() const override { return num_flops_; }
  [[nodiscard]] double num_entries() const override { return num_entries_; }

 private:
  cholmod_sparse View(const BlockMatrix& matrix) {
    cholmod_sparse view{};
    view.nrow = view.ncol = static_cast<size_t>(matrix.num_rows());
    view.nzmax = rows_.size();
    view.p = begin_.data();
    view.i = rows_.data();
    view.x = const_cast<double*>(matrix.values());  // CHOLMOD's interface; it only reads.
    view.stype = -1;                                // The lower part of a symmetric matrix.
    view.itype = CHOLMOD_INT;
    view.xtype = matrix.values() == nullptr ? CHOLMOD_PATTERN : CHOLMOD_REAL;
    view.dtype = CHOLMOD_DOUBLE;
    view.sorted = view.packed = 1;
    return view;
  }

  std::vector<int> begin_;
  std::vector<int> rows_;
  cholmod_common common_{};
  cholmod_factor* factor_ = nullptr;
  double num_flops_ = 0.0;
  double num_entries_ = 0.0;
};

#else

class SparseCholesky : public BlockCholesky {
 public:
  explicit SparseCholesky(const BlockMatrix& pattern) {
    CompressedColumns(pattern, begin_, rows_);
    const std::vector<int> order = OrderOfElimination(pattern);
    place_.resize(pattern.num_rows());
    for (int k = 0; k < pattern.num_rows(); ++k) place_.indices()[order[k]] = k;
    std::vector<double> ones(rows_.size(), 1.0);
    factor_.analyzePattern(Permuted(ones.data()));
    // Only the pattern is known: the entries per column give the work.
    const auto& lower = factor_.matrixL().nestedExpression();
    for (int column = 0; column < pattern.num_rows(); ++column) {
      const double entries = lower.outerIndexPtr()[column + 1] - lower.outerIndexPtr()[column];
      num_entries_ += entries;
      num_flops_ += entries * entries;
    }
  }

  bool Solve(const BlockMatrix& matrix, const Eigen::VectorXd& right, Eigen::VectorXd& x) override {
    factor_.factorize(Permuted(matrix.values()));
    if (factor_.info() != Eigen::Success) return false;
    x = place_.transpose() * factor_.solve(place_ * right).eval();
    return x.allFinite();
  }
  [[nodiscard]] double num_flops() const override { return num_flops_; }
  [[nodiscard]] double num_entries() const override { return num_entries_; }

 private:
  [[nodiscard]] Eigen::SparseMatrix<double> Permuted(const double* values) const {
    const int n = static_cast<int>(begin_.size()) - 1;
    const Eigen::Map<const Eigen::SparseMatrix<double>> matrix(n, n, static_cast<int>(rows_.size()),
                                                               begin_.data(), rows_.data(), values);
    Eigen::SparseMatrix<double> permuted(n, n);
    permuted.selfadjointView<Eigen::Lower>() =
        matrix.selfadjointView<Eigen::Lower>().twistedBy(place_);
    return permuted;
  }

  std::vector<int> begin_;
  std::vector<int> rows_;
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> place_;
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>, Eigen::Lower, Eigen::NaturalOrdering<int>>
      factor_;
  double num_flops_ = 0.0;
  double num_entries_ = 0.0;
};

#endif

}  // namespace

std::unique_ptr<BlockCholesky> MakeDenseCholesky(const BlockMatrix& pattern) {
  return std::make_unique<DenseCholesky>(pattern);
}

std::unique_ptr<BlockCholesky> MakeSparseCholesky(const BlockMatrix& pattern) {
  return std::make_unique<SparseCholesky>(pattern);
}

}  // namespace s3lam
