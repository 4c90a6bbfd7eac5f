#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace s3lam {

/// A network's class probabilities for every pixel of an image, as they lie in their file:
/// channels x rows x columns.
struct ProbabilityVolume {
  enum class Type { kFloat32, kFloat16, kUint8 };  // uint8: 255 stands for one.

  Type type = Type::kFloat32;
  int channels = 0;
  int rows = 0;
  int cols = 0;
  std::string bytes;  // The items begin at `offset`.
  size_t offset = 0;
  /// Class index of each channel; negative for one that is void (background).
  std::vector<int> class_of_channel;

  [[nodiscard]] float At(int channel, Eigen::Index row, Eigen::Index col) const;

  /// What the pixel's channels say of the classes, summing to one; all equal for a pixel that is
  /// wholly void.
  [[nodiscard]] std::vector<float> ClassDistribution(Eigen::Index row, Eigen::Index col,
                                                     int num_classes) const;
};

using ChannelImage = Eigen::Matrix<int32_t, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The most likely channel of each pixel, the lower one of equals. Throws InputError naming
/// `source` and the pixel for probabilities that are negative, NaN or do not sum to one (as nearly
/// as the type allows).
ChannelImage MostLikelyChannels(const ProbabilityVolume& volume, const std::string& source);

}  // namespace s3lam
