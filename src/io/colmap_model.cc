#include "s3lam/io/colmap_model.h"

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <set>
#include <sstream>
#include <string_view>
#include <system_error>

#include "s3lam/base/error.h"
#include "s3lam/io/file.h"

namespace s3lam {
namespace fs = std::filesystem;
namespace {

using StreamReader = void (*)(std::istream&, const std::string&, Reconstruction&);
using StreamWriter = void (*)(const Reconstruction&, std::ostream&);

constexpr std::array<const char*, 3> kBinaryFiles = {"cameras.bin", "images.bin", "points3D.bin"};
constexpr std::array<const char*, 3> kTextFiles = {"cameras.txt", "images.txt", "points3D.txt"};
constexpr std::array<StreamReader, 3> kBinaryReaders = {ReadCamerasBinary, ReadImagesBinary,
                                                        ReadPointsBinary};
constexpr std::array<StreamReader, 3> kTextReaders = {ReadCamerasText, ReadImagesText,
                                                      ReadPointsText};
constexpr std::array<StreamWriter, 3> kBinaryWriters = {WriteCamerasBinary, WriteImagesBinary,
                                                        WritePointsBinary};
constexpr std::array<StreamWriter, 3> kTextWriters = {WriteCamerasText, WriteImagesText,
                                                      WritePointsText};

size_t NumFiles(const fs::path& directory, const std::array<const char*, 3>& names) {
  size_t count = 0;
  std::error_code unreadable;  // Counts as absent.
  for (const char* name : names) count += fs::is_regular_file(directory / name, unreadable);
  return count;
}

/// Says what is missing of a model, and where one might have been meant.
[[noreturn]] void FailIncomplete(const fs::path& directory) {
  if (!fs::exists(directory)) ThrowInputError("{}: no such directory", directory.string());
  if (!fs::is_directory(directory)) ThrowInputError("{}: not a directory", directory.string());
  const bool is_binary = NumFiles(directory, kBinaryFiles) > NumFiles(directory, kTextFiles);
  const auto& names = is_binary ? kBinaryFiles : kTextFiles;
  if (NumFiles(directory, names) > 0) {
    for (const char* name : names) {
      if (!fs::is_regular_file(directory / name)) {
        ThrowInputError("{}: {} is missing from the COLMAP model", directory.string(), name);
      }
    }
  }
  for (const char* nested : {"sparse/0", "0", "sparse"}) {
    if (IsColmapModel(directory / nested)) {
      ThrowInputError("{}: not a COLMAP model, but {} is", directory.string(),
                      (directory / nested).string());
    }
  }
  ThrowInputError("{}: not a COLMAP model (no cameras, images and points3D, .bin or .txt)",
                  directory.string());
}

void ReadModelFile(const fs::path& path, StreamReader read, Reconstruction& model) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) ThrowInputError("{}: cannot open: {}", path.string(), std::strerror(errno));
  read(stream, path.string(), model);
}

/// Masks and images are found by name, so two images of one name cannot be told apart.
void CheckNamesDiffer(const Reconstruction& model, const std::string& source) {
  std::set<std::string_view> names;
  for (const auto& [id, image] : model.images) {
    if (!names.insert(image.name).second) {
      ThrowInputError("{}: two images are called {}", source, image.name);
    }
  }
}

void WriteFiles(const Reconstruction& model, const fs::path& directory,
                const std::array<const char*, 3>& names,
                const std::array<StreamWriter, 3>& writers) {
  for (size_t i = 0; i < names.size(); ++i) {
    WriteFile(directory / names[i], [&](std::ostream& stream) { writers[i](model, stream); });
  }
}

}  // namespace

bool IsColmapModel(const fs::path& directory) {
  return NumFiles(directory, kBinaryFiles) == kBinaryFiles.size() ||
         NumFiles(directory, kTextFiles) == kTextFiles.size();
}

Reconstruction ReadColmapModel(const fs::path& directory) {
  if (!IsColmapModel(directory)) FailIncomplete(directory);
  const bool is_binary = NumFiles(directory, kBinaryFiles) == kBinaryFiles.size();
  const auto& names = is_binary ? kBinaryFiles : kTextFiles;
  const auto& readers = is_binary ? kBinaryReaders : kTextReaders;
  Reconstruction model;
  for (const size_t i : {1, 0, 2}) {  // The images tell which cameras are needed.
    ReadModelFile(directory / names[i], readers[i], model);
  }
  CheckReconstruction(model, directory.string());
  CheckNamesDiffer(model, directory.string());
  return model;
}

void WriteColmapModel(const Reconstruction& reconstruction, const fs::path& directory) {
  WriteFiles(reconstruction, directory, kBinaryFiles, kBinaryWriters);
}

void WriteColmapModelText(const Reconstruction& reconstruction, const fs::path& directory) {
  WriteFiles(reconstruction, directory, kTextFiles, kTextWriters);
}

void WriteColmapProject(const fs::path& image_directory, const fs::path& path) {
  // The GUI needs no database to show a model, but its parser demands the key.
  WriteFile(path, [&](std::ostream& stream) {
    stream << "database_path=\nimage_path=" << fs::absolute(image_directory).string() << "\n";
  });
}

std::optional<fs::path> ReadColmapProject(const fs::path& path) {
  constexpr std::string_view kKey = "image_path=";
  if (!fs::exists(path)) return std::nullopt;
  std::istringstream lines(ReadFile(path));
  for (std::string line; std::getline(lines, line);) {
    if (!line.starts_with(kKey)) continue;
    const fs::path images = line.substr(kKey.size());
    const fs::path from_file = path.parent_path() / images;  // The same if absolute.
    return !fs::exists(images) && fs::exists(from_file) ? from_file : images;
  }
  return std::nullopt;
}

}  // namespace s3lam
