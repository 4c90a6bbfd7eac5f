#include <array>
#include <map>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/io/panoptic_masks.h"

namespace s3lam {
namespace {

using Keys = std::map<std::string, std::vector<size_t>>;

/// How a name becomes a key: with or without its folders, with one or two extensions dropped.
struct KeyForm {
  bool with_folder;
  bool drop_second;
};

std::string DropExtension(const std::string& path) {
  const size_t dot = path.rfind('.');
  const size_t slash = path.rfind('/');
  const size_t name_begin = slash == std::string::npos ? 0 : slash + 1;
  return dot == std::string::npos || dot <= name_begin ? path : path.substr(0, dot);
}

std::string KeyOf(const std::string& name, const KeyForm& form) {
  std::string key = DropExtension(name);
  if (form.drop_second) key = DropExtension(key);
  if (!form.with_folder) key = key.substr(key.rfind('/') + 1);  // npos + 1 is 0.
  return key;
}

struct Rule {
  KeyForm image;
  KeyForm mask;
};
constexpr std::array<Rule, 6> kRules = {{
    {{true, false}, {true, false}},
    {{true, true}, {true, false}},
    {{true, false}, {true, true}},
    {{false, false}, {false, false}},
    {{false, true}, {false, false}},
    {{false, false}, {false, true}},
}};

Keys IndexMasks(const std::vector<std::string>& names, const KeyForm& form) {
  Keys keys;
  for (size_t i = 0; i < names.size(); ++i) keys[KeyOf(names[i], form)].push_back(i);
  return keys;
}

}  // namespace

std::vector<std::optional<size_t>> MatchMasksToImages(const std::vector<std::string>& image_names,
                                                      const std::vector<std::string>& mask_names) {
  std::vector<std::optional<size_t>> result(image_names.size());
  std::map<size_t, size_t> image_of_mask;
  for (const Rule& rule : kRules) {
    const Keys masks = IndexMasks(mask_names, rule.mask);
    for (size_t i = 0; i < image_names.size(); ++i) {
      if (result[i]) continue;
      const auto it = masks.find(KeyOf(image_names[i], rule.image));
      if (it == masks.end()) continue;
      if (it->second.size() > 1) {
        ThrowInputError("image {}: both masks {} and {} fit its name", image_names[i],
                        mask_names[it->second[0]], mask_names[it->second[1]]);
      }
      const size_t mask = it->second.front();
      const auto [owner, is_new] = image_of_mask.emplace(mask, i);
      if (!is_new) {
        ThrowInputError("mask {}: fits both images {} and {}", mask_names[mask],
                        image_names[owner->second], image_names[i]);
      }
      result[i] = mask;
    }
  }
  return result;
}

}  // namespace s3lam
