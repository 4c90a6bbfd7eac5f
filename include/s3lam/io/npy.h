#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <iosfwd>

namespace s3lam {

using MatrixXfRow = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// NumPy .npy version 1.0, float32, C order, two dimensions.
void WriteNpy(const MatrixXfRow& matrix, std::ostream& stream);
void WriteNpy(const MatrixXfRow& matrix, const std::filesystem::path& path);
/// Throws InputError naming the source for another type or shape, or a file whose size does not
/// fit.
MatrixXfRow ReadNpy(std::istream& stream, const std::string& source);
MatrixXfRow ReadNpy(const std::filesystem::path& path);

}  // namespace s3lam
