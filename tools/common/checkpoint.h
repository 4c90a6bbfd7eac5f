#pragma once

#include <boost/program_options.hpp>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "common/provenance.h"
#include "s3lam/base/step_store.h"

namespace s3lam::tools {

/// A folder in which a run keeps what its steps lead to: one file each, written whole or not at
/// all, and checkpoint.json that says which run they belong to.
class Checkpoint : public StepStore {
 public:
  /// Without `resume` the folder must be absent, empty, or, with `overwrite`, an earlier
  /// checkpoint, whose steps are dropped. With it, a checkpoint must be of the same program,
  /// version, seed, configuration and inputs; none at all is begun. Throws InputError naming what
  /// is different, or in the way.
  Checkpoint(std::filesystem::path directory, const Provenance& provenance, bool resume,
             bool overwrite);
  ~Checkpoint() override;
  Checkpoint(const Checkpoint&) = delete;
  Checkpoint& operator=(const Checkpoint&) = delete;

  /// Throws InputError if the file is damaged.
  std::optional<std::string> Recall(const std::string& step) override;
  void Keep(const std::string& step, std::string_view bytes) override;

  /// Once the result is in place: what is of the checkpoint goes, and the folder if nothing else is
  /// in it.
  void Remove();

 private:
  void Lock();
  void DropFiles(const std::function<bool(const std::filesystem::path&)>& is_dropped) const;
  [[nodiscard]] std::filesystem::path PathOf(const std::string& step) const;

  std::filesystem::path directory_;
  int lock_fd_ = -1;
};

/// Declares --checkpoint and --resume.
void AddCheckpointArguments(boost::program_options::options_description& arguments);

/// As --checkpoint and --resume say; null without them.
std::unique_ptr<Checkpoint> OpenCheckpoint(const boost::program_options::variables_map& arguments,
                                           const CommonArguments& common,
                                           const Provenance& provenance);

}  // namespace s3lam::tools
