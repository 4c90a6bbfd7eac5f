#include "common/provenance.h"

#include <fmt/format.h>

#include <libdeflate.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <functional>
#include <string_view>
#include <system_error>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/sha256.h"
#include "s3lam/base/version.h"

namespace s3lam::tools {
namespace fs = std::filesystem;
namespace {

/// Hands a file over block by block. Throws InputError if it cannot be read.
void ReadBlocks(const fs::path& path, const std::function<void(std::string_view)>& take) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) ThrowInputError("{}: cannot open: {}", path.string(), std::strerror(errno));
  std::vector<char> buffer(1 << 18);
  while (stream) {
    stream.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    take({buffer.data(), static_cast<size_t>(stream.gcount())});
  }
  if (!stream.eof()) ThrowInputError("{}: cannot read: {}", path.string(), std::strerror(errno));
}

std::string HashOfFile(const fs::path& path) {
  Sha256 hash;
  ReadBlocks(path, [&](std::string_view block) { hash.Update(block); });
  return hash.Finish();
}

/// Several times quicker than a hash, and enough to notice that a file was changed. Of nothing for
/// what cannot be read: whoever needs it says so.
uint32_t ChecksumOfFile(const fs::path& path) {
  uint32_t checksum = libdeflate_crc32(0, nullptr, 0);
  try {
    ReadBlocks(path, [&](std::string_view block) {
      checksum = libdeflate_crc32(checksum, block.data(), block.size());
    });
  } catch (const InputError&) {
    return libdeflate_crc32(0, nullptr, 0);
  }
  return checksum;
}

/// Zero for what has gone meanwhile: whoever needs it says so.
uintmax_t SizeOf(const fs::path& path) {
  std::error_code error;
  const uintmax_t size = fs::file_size(path, error);
  return error ? 0 : size;
}

}  // namespace

Provenance::Provenance(const std::string& program, const CommonArguments& common,
                       nlohmann::json config)
    : program_(program),
      seed_(common.seed),
      num_threads_(common.threads),
      config_(std::move(config)) {}

void Provenance::AddFile(const std::string& input, const fs::path& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return;
  inputs_[input] = {{"path", path.string()},
                    {"bytes", SizeOf(path)},
                    {"sha256", HashOfFile(path)},
                    {"sha256_of", "content"}};
}

void Provenance::AddFiles(const std::string& input, const fs::path& folder,
                          const std::vector<std::string>& names) {
  for (const std::string& name : names) AddFile(fmt::format("{}/{}", input, name), folder / name);
}

void Provenance::AddListing(const std::string& input, const fs::path& folder,
                            const std::vector<fs::path>& files) {
  std::vector<uint32_t> checksums(files.size());
  ParallelFor(files.size(), num_threads_,
              [&](size_t i) { checksums[i] = ChecksumOfFile(files[i]); });
  Sha256 hash;
  uintmax_t bytes = 0;
  for (size_t i = 0; i < files.size(); ++i) {
    const uintmax_t size = SizeOf(files[i]);
    bytes += size;
    hash.Update(fmt::format("{} {:08x} {}\n", size, checksums[i],
                            files[i].lexically_relative(folder).string()));
  }
  inputs_[input] = {{"path", folder.string()},
                    {"files", files.size()},
                    {"bytes", bytes},
                    {"sha256", hash.Finish()},
                    {"sha256_of", "sizes, CRC-32 and names"}};
}

void Provenance::AddListing(const std::string& input, const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error)) {
    if (it->is_regular_file(error)) files.push_back(it->path());
  }
  std::sort(files.begin(), files.end());
  AddListing(input, folder, files);
}

void Provenance::AddText(const std::string& input, const std::string& text) {
  Sha256 hash;
  hash.Update(text);
  inputs_[input] = {{"bytes", text.size()}, {"sha256", hash.Finish()}, {"sha256_of", "text"}};
}

nlohmann::json Provenance::Hashes() const {
  nlohmann::json hashes = nlohmann::json::object();
  for (const auto& [input, entry] : inputs_.items()) hashes[input] = entry["sha256"];
  return hashes;
}

void Provenance::AddTo(nlohmann::json& report) const {
  report["program"] = program_;
  report["version"] = Version();
  report["seed"] = seed_;
  report["config"] = config_;
  report["inputs"] = inputs_;
}

std::vector<std::string> ModelFiles() {
  return {"cameras.bin",     "images.bin",       "points3D.bin",       "cameras.txt",
          "images.txt",      "points3D.txt",     "keyframes.txt",      "frames.txt",
          "descriptors.bin", "observations.bin", "keypoint_sigmas.bin"};
}

}  // namespace s3lam::tools
