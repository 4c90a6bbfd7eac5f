#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/io/panoptic_masks.h"

namespace s3lam {
namespace {

using Keys = std::map<std::string, std::vector<size_t>>;

enum class Folders { kAll, kLast, kNone };

/// How names become keys: which of their folders count, and whether a second extension is dropped.
struct Rule {
  Folders folders;
  bool drop_second_of_image;
  bool drop_second_of_mask;
};
constexpr std::array<Rule, 9> kRules = {{
    {Folders::kAll, false, false},
    {Folders::kAll, true, false},
    {Folders::kAll, false, true},
    {Folders::kLast, false, false},
    {Folders::kLast, true, false},
    {Folders::kLast, false, true},
    {Folders::kNone, false, false},
    {Folders::kNone, true, false},
    {Folders::kNone, false, true},
}};

constexpr std::array<std::string_view, 4> kDataSetEndings = {
    "_leftImg8bit", "_gtFine_instanceIds", "_gtCoarse_instanceIds", "_instanceIds"};
constexpr std::array<std::string_view, 2> kLabelFolders = {"label-filt/", "label/"};

/// Folder of a path with the slash, empty for none.
std::string FolderOf(const std::string& path) { return path.substr(0, path.rfind('/') + 1); }

std::string DropExtension(const std::string& path) {
  const size_t dot = path.rfind('.');
  const size_t name_begin = path.rfind('/') + 1;  // npos + 1 is 0.
  return dot == std::string::npos || dot <= name_begin ? path : path.substr(0, dot);
}

std::string KeyOf(const std::string& name, Folders folders, bool drop_second) {
  std::string key = DropExtension(name);
  for (const std::string_view ending : kDataSetEndings) {
    if (key.ends_with(ending)) key.resize(key.size() - ending.size());
  }
  if (drop_second) key = DropExtension(key);
  if (folders == Folders::kAll) return key;
  const size_t slash = key.rfind('/');
  if (folders == Folders::kNone || slash == std::string::npos) return key.substr(slash + 1);
  return slash == 0 ? key : key.substr(key.rfind('/', slash - 1) + 1);
}

std::string WithoutLabelFolder(const std::string& name) {
  for (const std::string_view folder : kLabelFolders) {
    if (name.starts_with(folder)) return name.substr(folder.size());
  }
  return name;
}

class Matcher {
 public:
  Matcher(const std::vector<std::string>& images, const std::vector<std::string>& masks)
      : images_(images), masks_(masks), result_(images.size()) {
    for (const std::string& name : images) image_folders_.insert(LastFolder(name));
    for (const std::string& name : masks) mask_keys_.push_back(WithoutLabelFolder(name));
  }

  void Apply(const Rule& rule) {
    const Keys candidates = IndexMasks(rule);
    std::map<size_t, size_t> image_of_mask;
    for (size_t i = 0; i < images_.size(); ++i) {
      if (result_[i]) continue;
      const auto it = candidates.find(KeyOf(images_[i], rule.folders, rule.drop_second_of_image));
      if (it == candidates.end()) continue;
      if (it->second.size() > 1) {
        ThrowInputError("image {}: both masks {} and {} fit its name", images_[i],
                        masks_[it->second[0]], masks_[it->second[1]]);
      }
      const size_t mask = it->second.front();
      const auto [owner, is_new] = image_of_mask.emplace(mask, i);
      if (!is_new) {
        ThrowInputError("mask {}: fits both images {} and {}", masks_[mask], images_[owner->second],
                        images_[i]);
      }
      result_[i] = mask;
      taken_.insert(mask);
      if (rule.folders == Folders::kAll) {
        const std::string folder = FolderOf(mask_keys_[mask]);
        if (!folder.empty()) folders_by_path_.insert(folder);
        ++num_by_path_;
      } else if (num_by_less_++ == 0) {
        example_by_less_ = fmt::format("mask {} for image {}", masks_[mask], images_[i]);
      }
    }
  }

  /// Some masks lie as the images do; those that do not may be of other images.
  void WarnIfMixed() const {
    if (num_by_path_ == 0 || num_by_less_ == 0) return;
    spdlog::warn("masks: {} found by the paths of their images, {} by no more than a name: {}",
                 num_by_path_, num_by_less_, example_by_less_);
  }

  [[nodiscard]] std::vector<std::optional<size_t>> Take() { return std::move(result_); }

 private:
  static std::string LastFolder(const std::string& name) {
    std::string folder = FolderOf(name);
    if (folder.empty()) return folder;
    folder.pop_back();
    return folder.substr(folder.rfind('/') + 1);
  }

  /// True if folders of masks are named as those of images, but not the one this mask lies in.
  [[nodiscard]] bool IsOfOtherImages(size_t mask) const {
    const std::string folder = FolderOf(mask_keys_[mask]);
    return !folders_by_path_.empty() && !folder.empty() && !folders_by_path_.contains(folder);
  }

  [[nodiscard]] Keys IndexMasks(const Rule& rule) const {
    Keys keys;
    for (size_t i = 0; i < mask_keys_.size(); ++i) {
      if (taken_.contains(i) || (rule.folders != Folders::kAll && IsOfOtherImages(i))) continue;
      const std::string folder = LastFolder(mask_keys_[i]);
      const bool belongs_elsewhere =
          rule.folders == Folders::kNone && !folder.empty() && image_folders_.contains(folder);
      if (belongs_elsewhere) continue;
      keys[KeyOf(mask_keys_[i], rule.folders, rule.drop_second_of_mask)].push_back(i);
    }
    return keys;
  }

  const std::vector<std::string>& images_;
  const std::vector<std::string>& masks_;
  std::vector<std::string> mask_keys_;
  std::set<std::string> image_folders_;
  std::set<size_t> taken_;
  std::set<std::string> folders_by_path_;  // Of the masks found by path.
  size_t num_by_path_ = 0;
  size_t num_by_less_ = 0;
  std::string example_by_less_;
  std::vector<std::optional<size_t>> result_;
};

}  // namespace

std::vector<std::optional<size_t>> MatchMasksToImages(const std::vector<std::string>& image_names,
                                                      const std::vector<std::string>& mask_names) {
  Matcher matcher(image_names, mask_names);
  for (const Rule& rule : kRules) matcher.Apply(rule);
  matcher.WarnIfMixed();
  return matcher.Take();
}

}  // namespace s3lam
