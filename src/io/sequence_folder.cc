#include <algorithm>
#include <system_error>

#include "s3lam/base/error.h"
#include "s3lam/base/natural_order.h"
#include "s3lam/io/image_file.h"
#include "sequence_formats.h"

namespace s3lam::internal {
namespace fs = std::filesystem;
namespace {

bool IsHidden(const fs::path& path) { return path.filename().string().starts_with('.'); }

}  // namespace

std::vector<std::string> ListImages(const fs::path& directory, bool recursive) {
  std::vector<std::string> names;
  std::error_code error;
  fs::recursive_directory_iterator it(directory, error);
  while (!error && it != fs::recursive_directory_iterator()) {
    const fs::path path = it->path();
    std::error_code of_entry;  // What cannot be asked, such as a link to nothing, is no image.
    if (it->is_directory(of_entry) && (IsHidden(path) || !recursive)) {
      it.disable_recursion_pending();
    }
    if (!IsHidden(path) && HasImageExtension(path) && it->is_regular_file(of_entry)) {
      names.push_back(path.lexically_relative(directory).generic_string());
    }
    it.increment(error);
  }
  if (error) ThrowInputError("{}: cannot list: {}", directory.string(), error.message());
  std::sort(names.begin(), names.end(), NaturalLess);
  return names;
}

ImageSequence OpenFolder(const fs::path& path, double period_s) {
  ImageSequence sequence;
  sequence.format = SequenceFormat::kFolder;
  sequence.image_root = path;
  for (const std::string& name : ListImages(path, /*recursive=*/true)) {
    const auto number = static_cast<double>(sequence.frames.size());
    sequence.frames.push_back({number * period_s, name, path / name});
  }
  if (sequence.frames.empty()) ThrowInputError("{}: no images in this folder", path.string());
  return sequence;
}

}  // namespace s3lam::internal
