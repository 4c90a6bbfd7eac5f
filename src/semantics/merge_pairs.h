#pragma once

#include <cstddef>
#include <vector>

#include "s3lam/semantics/clusters.h"

namespace s3lam {

/// Merges clusters of one class as long as two are one object by `same_object(a, b)`; `merged(a)`
/// is told which cluster grew. Returns the number of merges.
template <typename SameObject, typename Merged>
int MergePairs(std::vector<Cluster>& clusters, SameObject&& same_object, Merged&& merged) {
  int num_merges = 0;
  for (size_t a = 0; a < clusters.size(); ++a) {
    for (size_t b = a + 1; b < clusters.size();) {
      if (clusters[a].class_index != clusters[b].class_index ||
          !same_object(clusters[a], clusters[b])) {
        ++b;
        continue;
      }
      MergeInto(clusters[b], clusters[a]);
      clusters.erase(clusters.begin() + static_cast<std::ptrdiff_t>(b));
      merged(clusters[a]);
      ++num_merges;
      b = a + 1;  // The grown cluster may now match one passed over.
    }
  }
  return num_merges;
}

}  // namespace s3lam
