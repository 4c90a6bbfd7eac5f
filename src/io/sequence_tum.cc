#include <fstream>
#include <sstream>

#include "line_parser.h"
#include "s3lam/base/error.h"
#include "s3lam/io/file.h"
#include "sequence_formats.h"

namespace s3lam::internal {
namespace fs = std::filesystem;

bool IsTumSequence(const fs::path& path) { return fs::is_regular_file(path / "rgb.txt"); }

ImageSequence OpenTum(const fs::path& path) {
  const std::string list = (path / "rgb.txt").string();
  std::istringstream stream(ReadFile(list));
  LineReader reader(stream, list);
  ImageSequence sequence;
  sequence.format = SequenceFormat::kTum;
  bool one_folder = true;
  while (reader.NextData()) {
    LineParser parser = reader.Parser();
    SequenceFrame frame;
    frame.time_s = parser.Real("timestamp");
    frame.name = parser.Rest();
    if (frame.name.empty()) parser.Fail("image path is missing");
    frame.path = path / frame.name;
    sequence.frames.push_back(std::move(frame));
    one_folder = one_folder &&
                 sequence.frames.back().path.parent_path() == sequence.frames[0].path.parent_path();
  }
  if (sequence.frames.empty()) ThrowInputError("{}: lists no images", list);
  // Names as COLMAP has them when it is given the folder of the images.
  sequence.image_root = one_folder ? sequence.frames[0].path.parent_path() : path;
  if (one_folder) {
    for (SequenceFrame& frame : sequence.frames) frame.name = frame.path.filename().string();
  }
  return sequence;
}

}  // namespace s3lam::internal
