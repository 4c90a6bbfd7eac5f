#pragma once

#include <filesystem>
#include <iosfwd>
#include <optional>

#include "s3lam/scene/reconstruction.h"

namespace s3lam {

/// COLMAP's sparse model, three-file form: cameras, images, points3D in .bin or .txt. Pixels and
/// poses are taken over as they are (first pixel centre 0.5, cam_from_world, qw first in the file).

/// True if the folder holds a complete binary or text model.
bool IsColmapModel(const std::filesystem::path& directory);

/// Reads the binary files if all three are there, else the text files (COLMAP's own rule). Throws
/// InputError naming the file and the reason: missing, cut short, counts that do not fit the file's
/// size, unsupported camera model, values that are not finite, references that do not hold. A
/// camera of such a model that no image is of is left out with a warning.
Reconstruction ReadColmapModel(const std::filesystem::path& directory);

/// Writes cameras.bin, images.bin, points3D.bin into an existing folder.
void WriteColmapModel(const Reconstruction& reconstruction, const std::filesystem::path& directory);

/// Writes cameras.txt, images.txt, points3D.txt at full precision.
void WriteColmapModelText(const Reconstruction& reconstruction,
                          const std::filesystem::path& directory);

/// Writes the project.ini that lets the COLMAP GUI find the images.
void WriteColmapProject(const std::filesystem::path& image_directory,
                        const std::filesystem::path& path);
/// The folder of images that a project.ini names, seen from the working directory or, if there is
/// none, from the file's folder; empty without the file or the name.
std::optional<std::filesystem::path> ReadColmapProject(const std::filesystem::path& path);

/// Stream forms. `source` is the file's name for messages; readers do not check references. Those
/// of cameras leave out what ReadColmapModel does only if `model` has its images already.
void ReadCamerasBinary(std::istream& stream, const std::string& source, Reconstruction& model);
void ReadImagesBinary(std::istream& stream, const std::string& source, Reconstruction& model);
void ReadPointsBinary(std::istream& stream, const std::string& source, Reconstruction& model);
void ReadCamerasText(std::istream& stream, const std::string& source, Reconstruction& model);
void ReadImagesText(std::istream& stream, const std::string& source, Reconstruction& model);
void ReadPointsText(std::istream& stream, const std::string& source, Reconstruction& model);
void WriteCamerasBinary(const Reconstruction& model, std::ostream& stream);
void WriteImagesBinary(const Reconstruction& model, std::ostream& stream);
void WritePointsBinary(const Reconstruction& model, std::ostream& stream);
void WriteCamerasText(const Reconstruction& model, std::ostream& stream);
void WriteImagesText(const Reconstruction& model, std::ostream& stream);
void WritePointsText(const Reconstruction& model, std::ostream& stream);

}  // namespace s3lam
