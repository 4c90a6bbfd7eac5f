#pragma once

#include <filesystem>
#include <string>

namespace s3lam::tools {

/// The file that an argument such as --classes means: a path, or the bare name of a file that comes
/// with the project ("coco" for configs/classes/coco.json, `kind` being "classes"). Throws
/// InputError for a name that is neither, saying where it was looked for; a path comes back as it
/// is.
std::filesystem::path FindConfigFile(const std::string& argument, const std::string& kind);

/// Folder of the files that come with the project: beside the installed program
/// (<prefix>/share/s3lam/configs), or in the source tree it was built in. Empty if neither is
/// there.
std::filesystem::path ConfigDirectory();

}  // namespace s3lam::tools
