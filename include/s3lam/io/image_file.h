#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>

namespace s3lam {

/// Sets up OpenCV's decoders. It would happen at the first image, in the thread that reads it; but
/// the libraries behind them write to stderr when memory ends then, and threads take theirs in
/// large pieces. So: before there are threads. Throws std::bad_alloc if memory does not suffice.
void PrepareImageDecoders();

/// Decodes an image file with OpenCV's imread flags. The EXIF orientation is never applied: pixels
/// stay where COLMAP and masks have them. Throws InputError naming the file if it is missing, not
/// an image, damaged or cut short (which OpenCV itself lets pass for JPEG).
cv::Mat ReadImageFile(const std::filesystem::path& path, int imread_flags);

/// Width and height [px], from the header alone for PNG and JPEG. Throws as above.
cv::Size ReadImageSize(const std::filesystem::path& path);

/// True for the names of still images that ReadImageFile is meant for (.jpg, .png, ...), in upper
/// or lower case.
bool HasImageExtension(const std::filesystem::path& path);

}  // namespace s3lam
