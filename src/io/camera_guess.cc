#include "s3lam/io/camera_guess.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "jpeg_markers.h"
#include "s3lam/io/file.h"
#include "tiff.h"

namespace s3lam {
namespace {

using internal::Tiff;

constexpr double kFilmWidth = 36.0;      // mm
constexpr double kFilmDiagonal = 43.27;  // mm
constexpr double kMinFilmFocal = 8.0;    // mm
constexpr double kMaxFilmFocal = 1000.0;
constexpr double kTypicalFilmFocal = 28.0;
constexpr double kExifSigma = 0.15;        // Images may be cropped, e.g. by stabilisation.
constexpr double kFieldOfViewSigma = 0.5;  // 17 to 46 mm.

/// Tags of TIFF 6.0 and Exif 2.3.
constexpr unsigned kTagExifDirectory = 0x8769;
constexpr unsigned kTagFocalLength = 0x920A;
constexpr unsigned kTagPixelXDimension = 0xA002;
constexpr unsigned kTagFocalPlaneXResolution = 0xA20E;
constexpr unsigned kTagFocalPlaneResolutionUnit = 0xA210;
constexpr unsigned kTagFocalLengthIn35mmFilm = 0xA405;

/// Millimetres per unit of the focal plane's resolution.
std::optional<double> UnitInMillimetres(double unit) {
  if (unit == 2.0) return 25.4;
  if (unit == 3.0) return 10.0;
  if (unit == 4.0) return 1.0;
  return std::nullopt;
}

/// From the size of the sensor's pixels; the image may have been resized since.
std::optional<double> FocalByResolution(const Tiff& tiff, size_t exif, int longer_side) {
  const auto focal_mm = tiff.Value(exif, kTagFocalLength);
  const auto resolution = tiff.Value(exif, kTagFocalPlaneXResolution);
  const auto unit = UnitInMillimetres(tiff.Value(exif, kTagFocalPlaneResolutionUnit).value_or(2.0));
  if (!focal_mm || !resolution || !unit) return std::nullopt;
  const auto exif_width = tiff.Value(exif, kTagPixelXDimension);
  const double resized = exif_width && *exif_width > 0.0 ? longer_side / *exif_width : 1.0;
  return *focal_mm * *resolution / *unit * resized;
}

std::optional<double> FocalByExif(std::string_view jpeg, int width, int height) {
  const Tiff tiff(internal::ExifSegment(jpeg));
  const auto first = tiff.IsTiff() ? tiff.FirstDirectory() : std::nullopt;
  if (!first) return std::nullopt;
  const auto exif = tiff.Value(*first, kTagExifDirectory);
  if (!exif) return std::nullopt;
  const auto directory = static_cast<size_t>(*exif);
  const auto film_focal = tiff.Value(directory, kTagFocalLengthIn35mmFilm);
  if (film_focal && *film_focal > 0.0) {  // 0: not known
    return *film_focal * std::hypot(width, height) / kFilmDiagonal;
  }
  return FocalByResolution(tiff, directory, std::max(width, height));
}

}  // namespace

std::optional<double> ExifFocalLength(std::string_view jpeg, int width, int height) {
  const auto focal = FocalByExif(jpeg, width, height);
  const double px_per_mm = std::hypot(width, height) / kFilmDiagonal;
  // Also refuses what is not a number.
  if (!focal || !(*focal >= kMinFilmFocal * px_per_mm) || !(*focal <= kMaxFilmFocal * px_per_mm)) {
    return std::nullopt;
  }
  return focal;
}

CameraGuess GuessCamera(const ImageSequence& sequence) {
  ImageSequence first = sequence;
  first.camera.reset();
  first.frames.resize(1);
  const cv::Mat image = FrameReader(first).ReadGray(0);
  std::optional<double> focal;
  const auto& path = first.frames.front().path;
  if (!path.empty()) focal = ExifFocalLength(ReadFile(path), image.cols, image.rows);
  CameraGuess guess;
  guess.source = focal ? "EXIF" : "field of view";
  guess.relative_sigma = focal ? kExifSigma : kFieldOfViewSigma;
  if (!focal) focal = kTypicalFilmFocal / kFilmWidth * std::max(image.cols, image.rows);
  guess.camera.id = CameraId(1);
  guess.camera.model = CameraModel::kRadial;
  guess.camera.width = image.cols;
  guess.camera.height = image.rows;
  guess.camera.params = {*focal, 0.5 * image.cols, 0.5 * image.rows, 0.0, 0.0};
  return guess;
}

}  // namespace s3lam
