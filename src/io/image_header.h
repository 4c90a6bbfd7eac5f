#pragma once

#include <cstdint>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string_view>

namespace s3lam::internal {

/// Width and height [px] that the header of an image file claims, for the formats that are read
/// here. A side is 0 where it is missing, and the largest int where it is above that.
std::optional<cv::Size> ClaimedSize(std::string_view bytes);

/// The least that a file with this header and this many pixels has to have [bytes].
uint64_t LeastFileSize(std::string_view bytes, uint64_t num_pixels);

}  // namespace s3lam::internal
