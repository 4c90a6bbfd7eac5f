#include "s3lam/slam/place_recognition.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "s3lam/base/rng.h"

namespace s3lam {
namespace {

constexpr int kClusterRounds = 5;
constexpr uint64_t kSeed = 20;

using Members = std::vector<const BinaryDescriptor*>;

size_t Nearest(const BinaryDescriptor& descriptor, std::span<const BinaryDescriptor> centers) {
  size_t best = 0;
  int best_distance = std::numeric_limits<int>::max();
  for (size_t c = 0; c < centers.size(); ++c) {
    const int distance = HammingDistance(descriptor, centers[c]);
    if (distance < best_distance) {
      best_distance = distance;
      best = c;
    }
  }
  return best;
}

/// Every bit as most members have it.
BinaryDescriptor Majority(const Members& members) {
  std::array<int, 256> counts{};
  for (const BinaryDescriptor* member : members) {
    for (size_t bit = 0; bit < counts.size(); ++bit) {
      counts[bit] += ((*member)[bit / 8] >> (bit % 8)) & 1;
    }
  }
  BinaryDescriptor majority{};
  for (size_t bit = 0; bit < counts.size(); ++bit) {
    if (2 * counts[bit] > static_cast<int>(members.size())) {
      majority[bit / 8] = static_cast<uint8_t>(majority[bit / 8] | (1U << (bit % 8)));
    }
  }
  return majority;
}

struct Clusters {
  std::vector<BinaryDescriptor> centers;
  std::vector<Members> members;
};

Clusters Cluster(const Members& members, size_t count, Rng& rng) {
  Clusters clusters;
  for (const size_t i : rng.Sample(members.size(), std::min(count, members.size()))) {
    clusters.centers.push_back(*members[i]);
  }
  for (int round = 0; round < kClusterRounds; ++round) {
    clusters.members.assign(clusters.centers.size(), {});
    for (const BinaryDescriptor* member : members) {
      clusters.members[Nearest(*member, clusters.centers)].push_back(member);
    }
    if (round + 1 == kClusterRounds) break;
    for (size_t c = 0; c < clusters.centers.size(); ++c) {
      if (!clusters.members[c].empty()) clusters.centers[c] = Majority(clusters.members[c]);
    }
  }
  return clusters;
}

/// Frames spread evenly, as many as give about the wanted number of descriptors.
std::vector<size_t> TrainingFrames(const VocabularyOptions& options,
                                   const std::vector<FrameFeatures>& frames) {
  size_t total = 0;
  for (const FrameFeatures& frame : frames) total += static_cast<size_t>(frame.size());
  const size_t stride = total / static_cast<size_t>(options.max_training_descriptors) + 1;
  std::vector<size_t> chosen;
  for (size_t i = 0; i < frames.size(); i += stride) chosen.push_back(i);
  return chosen;
}

}  // namespace

void VocabularyOptions::Visit(OptionVisitor& v) {
  v.Value("branching", branching, "children of a node of the tree of words", 2, 100);
  v.Value("depth", depth, "levels of the tree", 1, 8);
  v.Value("max_training_descriptors", max_training_descriptors,
          "descriptors of the sequence that the words are learnt from, about", 100, 10000000);
}

Vocabulary::Vocabulary(const VocabularyOptions& options, const std::vector<FrameFeatures>& frames) {
  const std::vector<size_t> training = TrainingFrames(options, frames);
  Members all;
  for (const size_t frame : training) {
    for (int i = 0; i < frames[frame].size(); ++i) all.push_back(&frames[frame].descriptor(i));
  }
  nodes_.emplace_back();
  Rng rng(kSeed + options.seed);
  std::vector<Members> members_of_node{all};  // Of the nodes of one level.
  size_t level_begin = 0;
  for (int level = 0; level < options.depth; ++level) {
    const size_t level_end = nodes_.size();
    std::vector<Members> next;
    for (size_t n = level_begin; n < level_end; ++n) {
      const Members& members = members_of_node[n - level_begin];
      if (members.size() < 2) continue;
      Clusters clusters = Cluster(members, static_cast<size_t>(options.branching), rng);
      nodes_[n].first_child = static_cast<int>(nodes_.size());
      nodes_[n].num_children = static_cast<int>(clusters.centers.size());
      for (size_t c = 0; c < clusters.centers.size(); ++c) {
        nodes_.push_back({.center = clusters.centers[c]});
        next.push_back(std::move(clusters.members[c]));
      }
    }
    members_of_node.swap(next);
    level_begin = level_end;
  }
  for (Node& node : nodes_) {
    if (node.num_children > 0) continue;
    node.word = static_cast<uint32_t>(weight_of_word_.size());
    weight_of_word_.push_back(1.0F);
  }
  std::vector<int> frames_with(num_words(), 0);
  for (const size_t frame : training) {
    for (const auto& [word, weight] : Describe(frames[frame])) ++frames_with[word];
  }
  for (size_t word = 0; word < num_words(); ++word) {
    weight_of_word_[word] = static_cast<float>(
        std::log(static_cast<double>(training.size() + 1) / (frames_with[word] + 1.0)));
  }
}

uint32_t Vocabulary::WordOf(const BinaryDescriptor& descriptor) const {
  const Node* node = &nodes_.front();
  while (node->num_children > 0) {
    const Node* best = nullptr;
    int best_distance = std::numeric_limits<int>::max();
    for (int c = 0; c < node->num_children; ++c) {
      const Node& child = nodes_[node->first_child + c];
      const int distance = HammingDistance(descriptor, child.center);
      if (distance < best_distance) {
        best_distance = distance;
        best = &child;
      }
    }
    node = best;
  }
  return node->word;
}

BagOfWords Vocabulary::Describe(const FrameFeatures& features) const {
  std::vector<uint32_t> words;
  words.reserve(static_cast<size_t>(features.size()));
  for (int i = 0; i < features.size(); ++i) words.push_back(WordOf(features.descriptor(i)));
  std::sort(words.begin(), words.end());
  BagOfWords bag;
  for (const uint32_t word : words) {
    if (weight_of_word_[word] <= 0.0F) continue;  // Every image has it.
    if (bag.empty() || bag.back().first != word) bag.emplace_back(word, 0.0F);
    bag.back().second += weight_of_word_[word];
  }
  double squared = 0.0;
  for (const auto& [word, weight] : bag) squared += static_cast<double>(weight) * weight;
  for (auto& [word, weight] : bag) weight = static_cast<float>(weight / std::sqrt(squared));
  return bag;
}

void PlaceIndex::Add(int label, const BagOfWords& words) {
  const int item = static_cast<int>(labels_.size());
  labels_.push_back(label);
  for (const auto& [word, weight] : words) files_[word].push_back({item, weight});
}

std::vector<std::pair<float, int>> PlaceIndex::Rank(const BagOfWords& words, size_t max_count,
                                                    std::span<const uint8_t> skip) const {
  std::vector<float> similarity(labels_.size(), 0.0F);
  for (const auto& [word, weight] : words) {
    for (const Entry& entry : files_[word]) similarity[entry.item] += weight * entry.weight;
  }
  std::vector<std::pair<float, int>> ranked;
  for (size_t i = 0; i < labels_.size(); ++i) {
    const int label = labels_[i];
    if (similarity[i] <= 0.0F || (!skip.empty() && skip[label] != 0)) continue;
    ranked.emplace_back(similarity[i], label);
  }
  std::sort(ranked.begin(), ranked.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : a.second < b.second;
  });
  ranked.resize(std::min(ranked.size(), max_count));
  return ranked;
}

}  // namespace s3lam
