#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "s3lam/geometry/camera.h"
#include "s3lam/io/image_sequence.h"

namespace s3lam {

/// Focal length [px] by the EXIF data of a JPEG file whose image is width x height px:
/// FocalLengthIn35mmFilm (by the diagonal), else FocalLength and FocalPlaneXResolution. Empty if
/// they are missing, damaged, or give a lens of less than 8 or more than 1000 mm on 35 mm film.
std::optional<double> ExifFocalLength(std::string_view jpeg, int width, int height);

/// A camera that nobody has calibrated.
struct CameraGuess {
  Camera camera;                // RADIAL without distortion, principal point in the centre.
  double relative_sigma = 0.0;  // Of the focal length's logarithm.
  std::string source;           // "EXIF" or "field of view"
};

/// For the size of the first frame: a focal length from its EXIF data, to within the cropping that
/// cameras do, else that of a 28 mm lens on 35 mm film, between those of action cameras and
/// standard lenses. Throws InputError if the frame cannot be read.
CameraGuess GuessCamera(const ImageSequence& sequence);

}  // namespace s3lam
