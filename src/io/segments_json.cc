#include "segments_json.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

using nlohmann::json;

/// What the sum of a distribution written with few digits may miss one by.
constexpr double kSumTolerance = 1e-2;

int64_t RequireInteger(const json& object, const char* key, const std::string& where) {
  const auto it = object.find(key);
  if (it == object.end() || !it->is_number_integer()) {
    ThrowInputError("{}: '{}' is missing or not an integer", where, key);
  }
  constexpr auto kMax = static_cast<uint64_t>(std::numeric_limits<int64_t>::max());
  if (it->is_number_unsigned() && it->get<uint64_t>() > kMax) {
    ThrowInputError("{}: '{}' is too large", where, key);
  }
  return it->get<int64_t>();
}

/// False without the key; true, false, 0 or 1.
bool ReadFlag(const json& info, const char* key, const std::string& where) {
  const auto it = info.find(key);
  if (it == info.end()) return false;
  return it->is_boolean() ? it->get<bool>() : RequireInteger(info, key, where) != 0;
}

double ReadScore(const json& info, const std::string& where) {
  const auto it = info.find("score");
  if (it == info.end()) return 1.0;
  const double score = it->is_number() ? it->get<double>() : std::nan("");
  if (!(score >= 0.0 && score <= 1.0)) {
    ThrowInputError("{}: score {} is not in [0, 1]", where, it->dump());
  }
  return score;
}

float ReadProbability(const json& value, const std::string& where) {
  const double p = value.is_number() ? value.get<double>() : std::nan("");
  if (!(p >= 0.0 && p <= 1.0)) {
    ThrowInputError("{}: probability {} is not in [0, 1]", where, value.dump());
  }
  return static_cast<float>(p);
}

int64_t ParseLabel(const std::string& text, const std::string& where) {
  int64_t label = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), label);
  if (error != std::errc() || end != text.data() + text.size()) {
    ThrowInputError("{}: '{}' in the distribution is not a label", where, text);
  }
  return label;
}

/// What a segment's "distribution" says.
struct Distribution {
  bool is_given = false;
  std::vector<float> of_classes;  // Scaled to one; empty if all of it is void.
  float of_void = 0.0F;
};

Distribution ReadDistribution(const json& info, const ClassResolver& classes,
                              const std::string& where) {
  const auto it = info.find("distribution");
  if (it == info.end()) return {};
  const auto num_classes = static_cast<size_t>(classes.table().size());
  std::vector<float> result(num_classes, 0.0F);
  double sum = 0.0;
  if (it->is_array()) {
    if (it->size() != num_classes) {
      ThrowInputError("{}: distribution over {} classes where the table '{}' has {}", where,
                      it->size(), classes.table().name, num_classes);
    }
    for (size_t i = 0; i < num_classes; ++i) {
      sum += result[i] = ReadProbability((*it)[i], where);
    }
  } else if (it->is_object()) {
    for (const auto& [label, value] : it->items()) {
      const float p = ReadProbability(value, where);
      sum += p;
      const auto index = classes.IndexOf(ParseLabel(label, where), where + ": distribution");
      if (index) result[static_cast<size_t>(*index)] += p;
    }
  } else {
    ThrowInputError("{}: 'distribution' is neither a list nor an object", where);
  }
  if (!(std::abs(sum - 1.0) <= kSumTolerance)) {
    ThrowInputError("{}: the distribution sums to {:.4g}, not to one", where, sum);
  }
  float rest = 0.0F;
  for (const float p : result) rest += p;
  const auto of_void = static_cast<float>(sum) - rest;
  if (!(rest > 0.0F)) return {true, {}, of_void};
  for (float& p : result) p /= rest;
  return {true, std::move(result), of_void};
}

/// Whether a segment says that it is a thing; empty if it says nothing.
std::optional<bool> ReadKind(const json& info, const std::string& where) {
  if (!info.contains("isthing")) return std::nullopt;
  return ReadFlag(info, "isthing", where);
}

/// Class of a segment: what it says, else the likeliest of its distribution; empty for void.
std::optional<int> ReadClass(const json& info, const Distribution& distribution,
                             const ClassResolver& classes, bool has_kinds,
                             const std::string& where) {
  const bool is_hugging_face = info.contains("label_id") && !info.contains("category_id");
  const char* key = is_hugging_face ? "label_id" : "category_id";
  if (!info.contains(key) && distribution.is_given) {
    const std::vector<float>& p = distribution.of_classes;
    const auto likeliest = std::max_element(p.begin(), p.end());
    const bool is_void =
        likeliest == p.end() || distribution.of_void > *likeliest * (1.0F - distribution.of_void);
    return is_void ? std::nullopt : std::optional(static_cast<int>(likeliest - p.begin()));
  }
  return classes.IndexOf(RequireInteger(info, key, where), where,
                         has_kinds ? ReadKind(info, where) : std::nullopt);
}

}  // namespace

SegmentTable ParseSegments(const json& list, const ClassResolver& classes,
                           const SegmentRules& rules, const std::string& where) {
  SegmentTable table;
  for (const json& info : list) {
    if (!info.is_object()) ThrowInputError("{}: entry of segments_info is not an object", where);
    const int64_t id = RequireInteger(info, "id", where + ": segment");
    const std::string name = fmt::format("{}: segment {}", where, id);
    if (id < rules.min_id || id > rules.max_id) {
      ThrowInputError("{}: id is not in [{}, {}]", name, rules.min_id, rules.max_id);
    }
    const auto key = static_cast<uint32_t>(id);
    PanopticSegment segment;
    Distribution distribution = ReadDistribution(info, classes, name);
    segment.score = ReadScore(info, name);
    segment.is_crowd = ReadFlag(info, "iscrowd", name);
    const auto class_index = ReadClass(info, distribution, classes, rules.has_kinds, name);
    if (table.segments.contains(key) || table.void_segments.contains(key)) {
      ThrowInputError("{}: is listed twice", name);
    }
    if (!class_index) {
      table.void_segments.insert(key);
      continue;
    }
    if (distribution.is_given && distribution.of_classes.empty()) {
      ThrowInputError("{}: the whole distribution is void", name);
    }
    segment.distribution = std::move(distribution.of_classes);
    segment.class_index = *class_index;
    segment.is_crowd |= classes.IsThing(*class_index) && ReadFlag(info, "was_fused", name);
    table.segments.emplace(key, std::move(segment));
  }
  return table;
}

}  // namespace s3lam
