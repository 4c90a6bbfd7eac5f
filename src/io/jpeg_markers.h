#pragma once

#include <opencv2/core/types.hpp>
#include <optional>
#include <string_view>

namespace s3lam::internal {

bool IsJpeg(std::string_view bytes);

/// True if the segments of a JPEG file lead to its end marker; whatever follows that (previews,
/// padding) is of no interest.
bool IsCompleteJpeg(std::string_view bytes);

/// Width and height [px] from the frame header; empty if there is none.
std::optional<cv::Size> JpegSize(std::string_view bytes);

/// The TIFF structure with the EXIF data; empty if there is none.
std::string_view ExifSegment(std::string_view bytes);

}  // namespace s3lam::internal
