#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/slam/features.h"

namespace s3lam {

struct VocabularyOptions {
  int branching = 10;
  int depth = 4;
  int max_training_descriptors = 60000;
  uint64_t seed = 0;  // Of the samples drawn; from the command line.

  void Visit(OptionVisitor& v);
};

/// What an image shows, as weighted words: (word, weight), ascending words, unit length.
using BagOfWords = std::vector<std::pair<uint32_t, float>>;

/// A tree of binary descriptors (Galvez-Lopez and Tardos 2012) trained on the sequence itself:
/// being offline, all its images are known before the first is to be recognised.
class Vocabulary {
 public:
  /// Clusters descriptors of frames spread over the sequence, level by level (k-majority: centres
  /// are the bitwise majorities of their members).
  Vocabulary(const VocabularyOptions& options, const std::vector<FrameFeatures>& frames);

  /// Words weighted by their rarity over the training frames (tf-idf).
  [[nodiscard]] BagOfWords Describe(const FrameFeatures& features) const;
  [[nodiscard]] size_t num_words() const { return weight_of_word_.size(); }

 private:
  struct Node {
    BinaryDescriptor center{};
    int first_child = -1;  // Children are contiguous; leaves have none.
    int num_children = 0;
    uint32_t word = 0;
  };

  [[nodiscard]] uint32_t WordOf(const BinaryDescriptor& descriptor) const;

  std::vector<Node> nodes_;  // The root first.
  std::vector<float> weight_of_word_;
};

/// Which of a set of images look most like another one.
class PlaceIndex {
 public:
  explicit PlaceIndex(const Vocabulary& vocabulary) : files_(vocabulary.num_words()) {}

  /// `label` is what Rank returns for the image.
  void Add(int label, const BagOfWords& words);

  /// (similarity in (0, 1], label), most similar first, ties by label; those for which `skip` (may
  /// be empty) is set left out, `max_count` at the most.
  [[nodiscard]] std::vector<std::pair<float, int>> Rank(const BagOfWords& words, size_t max_count,
                                                        std::span<const uint8_t> skip = {}) const;

 private:
  struct Entry {
    int item = 0;
    float weight = 0.0F;
  };
  std::vector<std::vector<Entry>> files_;  // Per word: who has it.
  std::vector<int> labels_;                // Per item.
};

}  // namespace s3lam
