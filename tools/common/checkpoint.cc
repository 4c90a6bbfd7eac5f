#include "common/checkpoint.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <string_view>
#include <system_error>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/output_file.h"
#include "s3lam/base/sha256.h"
#include "s3lam/base/signal_watch.h"
#include "s3lam/base/version.h"
#include "s3lam/io/file.h"

namespace s3lam::tools {
namespace fs = std::filesystem;
namespace po = boost::program_options;
using nlohmann::json;
namespace {

constexpr const char* kDescription = "checkpoint.json";
constexpr const char* kFormat = "s3lam checkpoint";
constexpr int kVersion = 3;
constexpr const char* kEnding = ".step";
constexpr size_t kHashDigits = 64;

/// What a run that was killed while it wrote has left of the files of a checkpoint.
bool IsUnfinished(const fs::path& name) {
  const std::string text = name.string();
  const size_t end = text.find(".tmp-");
  if (!text.starts_with('.') || end == std::string::npos) return false;
  const std::string target = text.substr(1, end - 1);
  return target == kDescription || target.ends_with(kEnding);
}

bool IsStep(const fs::path& name) { return name.extension() == kEnding; }

std::string HashOf(std::string_view bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.Finish();
}

/// Which runs may go on with a checkpoint.
json IdentityOf(const Provenance& provenance) {
  json identity;
  provenance.AddTo(identity);
  identity["inputs"] = provenance.Hashes();
  identity["format"] = kFormat;
  identity["format_version"] = kVersion;
  return identity;
}

/// Path and values of the first difference, for the reader; empty if there is none.
std::string FirstDifference(const json& was, const json& is) {
  for (const json& change : json::diff(was, is)) {
    const auto path = change["path"].get<std::string>();
    const auto value = [&](const json& from) {
      const json::json_pointer pointer(path);
      return from.contains(pointer) ? from[pointer].dump() : std::string("nothing");
    };
    return fmt::format("{} was {} and is {}", path.substr(1), value(was), value(is));
  }
  return {};
}

void CheckIdentity(const fs::path& directory, const json& identity) {
  const fs::path path = directory / kDescription;
  const json was = ReadJson(path);
  if (!was.is_object() || was.value("format", json()) != kFormat) {
    ThrowInputError("{}: not of a checkpoint", path.string());
  }
  for (const char* key : {"format_version", "program", "version", "seed", "inputs", "config"}) {
    const json kept = was.value(key, json());
    if (kept == identity[key]) continue;
    const std::string difference = FirstDifference({{key, kept}}, {{key, identity[key]}});
    ThrowInputError(
        "{}: the checkpoint is of another run ({}): give --overwrite instead of --resume to begin "
        "anew",
        directory.string(), difference);
  }
}

}  // namespace

Checkpoint::Checkpoint(fs::path directory, const Provenance& provenance, bool resume,
                       bool overwrite)
    : directory_(std::move(directory)) {
  std::error_code error;
  fs::create_directories(directory_, error);
  if (!fs::is_directory(directory_)) {
    ThrowInputError("{}: cannot make this folder for the checkpoint: {}", directory_.string(),
                    error ? error.message() : "something else has its name");
  }
  Lock();
  const json identity = IdentityOf(provenance);
  const bool is_there = fs::exists(directory_ / kDescription);
  const bool is_unused =
      std::all_of(fs::directory_iterator(directory_), fs::directory_iterator(),
                  [](const auto& entry) { return IsUnfinished(entry.path().filename()); });
  if (!is_there && !is_unused) {
    ThrowInputError("{}: neither empty nor a checkpoint: give another folder", directory_.string());
  }
  DropFiles(IsUnfinished);
  SignalWatch::SetAdvice(
      fmt::format("the same command with --resume goes on from {}", directory_.string()));
  if (is_there && resume) {
    CheckIdentity(directory_, identity);
    spdlog::info("going on from the checkpoint {}", directory_.string());
    return;
  }
  if (is_there && !overwrite) {
    ThrowInputError(
        "{}: holds a checkpoint: give --resume to go on from it, --overwrite to begin anew",
        directory_.string());
  }
  if (resume) spdlog::info("no checkpoint in {} yet: begun from the start", directory_.string());
  DropFiles(IsStep);
  OutputFile(directory_ / kDescription, true).Commit(identity.dump(2) + "\n");
}

Checkpoint::~Checkpoint() {
  SignalWatch::SetAdvice({});
  if (lock_fd_ >= 0) close(lock_fd_);
}

void Checkpoint::Lock() {
  lock_fd_ = open(directory_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  // Where there are no locks, nobody is kept out.
  if (lock_fd_ >= 0 && flock(lock_fd_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
    close(lock_fd_);
    ThrowInputError("{}: another run is using this checkpoint", directory_.string());
  }
}

fs::path Checkpoint::PathOf(const std::string& step) const { return directory_ / (step + kEnding); }

void Checkpoint::DropFiles(const std::function<bool(const fs::path&)>& is_dropped) const {
  std::vector<fs::path> dropped;
  for (const auto& entry : fs::directory_iterator(directory_)) {
    if (is_dropped(entry.path().filename())) dropped.push_back(entry.path());
  }
  for (const fs::path& path : dropped) fs::remove(path);
}

std::optional<std::string> Checkpoint::Recall(const std::string& step) {
  const fs::path path = PathOf(step);
  if (!fs::exists(path)) return std::nullopt;
  std::string bytes = ReadFile(path);
  const std::string_view all = bytes;
  if (all.size() < kHashDigits || HashOf(all.substr(kHashDigits)) != all.substr(0, kHashDigits)) {
    ThrowInputError("{}: damaged: give --overwrite instead of --resume to begin anew",
                    path.string());
  }
  bytes.erase(0, kHashDigits);  // In place: there may be no memory for a second one.
  return bytes;
}

void Checkpoint::Keep(const std::string& step, std::string_view bytes) {
  OutputFile file(PathOf(step), true);
  file.Write(HashOf(bytes));
  file.Commit(bytes);
}

void Checkpoint::Remove() {
  DropFiles(IsStep);
  fs::remove(directory_ / kDescription);
  std::error_code ignored;
  fs::remove(directory_, ignored);
}

void AddCheckpointArguments(po::options_description& arguments) {
  auto add = arguments.add_options();
  add("checkpoint", po::value<std::string>()->value_name("DIR"),
      "keep the state of the run in this folder, until the result is in place");
  add("resume", po::bool_switch(),
      "go on from the checkpoint, if there is one; the result is the same as without interruption");
}

std::unique_ptr<Checkpoint> OpenCheckpoint(const po::variables_map& arguments,
                                           const CommonArguments& common,
                                           const Provenance& provenance) {
  const bool resume = arguments["resume"].as<bool>();
  if (arguments.count("checkpoint") == 0) {
    if (resume) throw UsageError("--resume needs --checkpoint DIR");
    return nullptr;
  }
  return std::make_unique<Checkpoint>(Required(arguments, "checkpoint"), provenance, resume,
                                      common.overwrite);
}

}  // namespace s3lam::tools
