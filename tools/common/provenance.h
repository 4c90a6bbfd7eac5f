#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/program.h"

namespace s3lam::tools {

/// What a result was made of: program, version, seed, effective configuration and the SHA-256 of
/// every input. Goes into the stage's report.
class Provenance {
 public:
  Provenance(const std::string& program, const CommonArguments& common, nlohmann::json config);

  /// By its content, as sha256sum prints it. Does nothing if there is no such file. Throws
  /// InputError if it cannot be read.
  void AddFile(const std::string& input, const std::filesystem::path& path);
  /// Every file that there is of these names in a folder, each by its content.
  void AddFiles(const std::string& input, const std::filesystem::path& folder,
                const std::vector<std::string>& names);
  /// Many large files: by the lines "<size in bytes> <CRC-32, 8 hexadecimal digits> <name>\n", in
  /// the order given.
  void AddListing(const std::string& input, const std::filesystem::path& folder,
                  const std::vector<std::filesystem::path>& files);
  /// What was made of inputs, by its text.
  void AddText(const std::string& input, const std::string& text);
  /// Every file under a folder, sorted by name, as a listing.
  void AddListing(const std::string& input, const std::filesystem::path& folder);

  /// The SHA-256 of every input, whatever its path: {"camera": "...", ...}.
  [[nodiscard]] nlohmann::json Hashes() const;
  [[nodiscard]] const nlohmann::json& config() const { return config_; }
  /// Adds "program", "version", "seed", "config" and "inputs" to a report.
  void AddTo(nlohmann::json& report) const;

 private:
  std::string program_;
  uint64_t seed_;
  int num_threads_;
  nlohmann::json config_;
  nlohmann::json inputs_ = nlohmann::json::object();
};

/// The files of a COLMAP model and of what goes with it.
std::vector<std::string> ModelFiles();

}  // namespace s3lam::tools
