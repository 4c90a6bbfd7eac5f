#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <string>
#include <string_view>

namespace s3lam {

/// Throws InputError naming `source` unless `bytes` is a PNG file that is complete, that is whose
/// chunks lead to the end chunk. (Their checksums are the decoder's business.)
void CheckPngIsComplete(std::string_view bytes, const std::string& source);

/// The colours (three bytes each) that a PNG with a palette has; empty for any other.
std::string_view PngPalette(std::string_view bytes);

/// Decodes a PNG as it is stored: depth and channels unchanged (colour as BGR). Throws InputError
/// naming `source` if it is cut short or damaged.
cv::Mat DecodePngMask(std::string_view bytes, const std::string& source);

/// The same from a file, which may be missing as well.
cv::Mat ReadPngMask(const std::filesystem::path& path);

}  // namespace s3lam
