#include <algorithm>
#include <bit>
#include <map>
#include <numeric>
#include <utility>

#include "s3lam/semantics/instances.h"

namespace s3lam {
namespace {

constexpr int32_t kSplit = -1;  // Seen, but in several segments.

/// A view that observes a set of points, and the one segment of it that contains them.
struct View {
  uint32_t frame = 0;
  int32_t container = kSplit;
};

/// A set of segments taken for one object.
struct Node {
  std::vector<uint32_t> segments;  // Ascending.
  std::vector<uint32_t> points;    // Rows, ascending.
  std::vector<View> views;         // By frame.
  std::vector<uint64_t> observes;  // Bit per frame.
};

using Excluded = std::vector<bool>;  // Per segment.

/// Where the views see the node's points.
void ComputeViews(const MaskObservations& observations, const ConsensusOptions& options,
                  const Excluded& under_segmented, Node& node) {
  // One entry per seen point, in (frame, segment) order.
  std::vector<std::pair<uint32_t, int32_t>> seen;
  for (const uint32_t row : node.points) {
    for (const PointObservation& o : observations.ObservationsOf(row)) {
      if (o.segment != kVoidSegment) seen.emplace_back(o.frame, o.segment);
    }
  }
  std::sort(seen.begin(), seen.end());
  const auto wanted = std::max<double>(
      options.min_segment_points,
      std::min<double>(options.visible_points,
                       options.visible_ratio * static_cast<double>(node.points.size())));
  node.views.clear();
  node.observes.assign((observations.frames.size() + 63) / 64, 0);
  for (size_t begin = 0; begin < seen.size();) {
    const uint32_t frame = seen[begin].first;
    size_t end = begin;
    size_t most = 0;
    int32_t container = kSplit;
    while (end < seen.size() && seen[end].first == frame) {
      size_t run = end;
      while (run < seen.size() && seen[run] == seen[end]) ++run;
      if (run - end > most) {
        most = run - end;
        container = seen[end].second;
      }
      end = run;
    }
    const auto visible = static_cast<double>(end - begin);
    begin = end;
    if (visible < wanted || under_segmented[static_cast<size_t>(container)]) continue;
    const bool contained = static_cast<double>(most) >= options.containment * visible;
    node.views.push_back({frame, contained ? container : kSplit});
    node.observes[frame / 64] |= uint64_t{1} << frame % 64;
  }
}

/// Segments whose points most other views see in several segments, e.g. two books in one.
Excluded FindUnderSegmented(const MaskObservations& observations, const ConsensusOptions& options,
                            const std::vector<Node>& nodes) {
  Excluded excluded(observations.segments.size(), false);
  for (const Node& node : nodes) {
    size_t split = 0;
    for (const View& view : node.views) split += view.container == kSplit ? 1 : 0;
    if (static_cast<double>(split) >
        options.max_split_rate * static_cast<double>(node.views.size())) {
      excluded[node.segments.front()] = true;
    }
  }
  return excluded;
}

int CountCommon(const std::vector<uint64_t>& a, const std::vector<uint64_t>& b) {
  int count = 0;
  for (size_t i = 0; i < a.size(); ++i) count += std::popcount(a[i] & b[i]);
  return count;
}

/// Two nodes that at least one view supports.
struct Edge {
  uint32_t a = 0;
  uint32_t b = 0;
  int observers = 0;
  double consensus = 0.0;
};

std::vector<Edge> FindEdges(const std::vector<Node>& nodes, double min_consensus) {
  std::map<int32_t, std::vector<uint32_t>> nodes_in_segment;
  for (uint32_t i = 0; i < nodes.size(); ++i) {
    for (const View& view : nodes[i].views) {
      if (view.container != kSplit) nodes_in_segment[view.container].push_back(i);
    }
  }
  std::vector<Edge> edges;
  std::vector<int> supporters(nodes.size(), 0);
  std::vector<uint32_t> touched;
  for (uint32_t a = 0; a < nodes.size(); ++a) {
    touched.clear();
    for (const View& view : nodes[a].views) {
      if (view.container == kSplit) continue;
      const std::vector<uint32_t>& together = nodes_in_segment.at(view.container);
      for (auto it = std::upper_bound(together.begin(), together.end(), a); it != together.end();
           ++it) {
        if (supporters[*it]++ == 0) touched.push_back(*it);
      }
    }
    std::sort(touched.begin(), touched.end());
    for (const uint32_t b : touched) {
      const int observers = CountCommon(nodes[a].observes, nodes[b].observes);
      const double consensus = static_cast<double>(supporters[b]) / observers;
      if (consensus >= min_consensus) edges.push_back({a, b, observers, consensus});
      supporters[b] = 0;
    }
  }
  return edges;
}

class DisjointSets {
 public:
  explicit DisjointSets(size_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0U); }
  uint32_t Find(uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void Join(uint32_t i, uint32_t j) {
    i = Find(i);
    j = Find(j);
    parent_[std::max(i, j)] = std::min(i, j);
  }

 private:
  std::vector<uint32_t> parent_;
};

std::vector<uint32_t> SortedUnion(const std::vector<uint32_t>& a, const std::vector<uint32_t>& b) {
  std::vector<uint32_t> result;
  std::set_union(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(result));
  return result;
}

/// Joins the nodes that edges with enough observers connect; false if there are none.
bool MergeNodes(const MaskObservations& observations, const ConsensusOptions& options,
                const Excluded& under_segmented, const std::vector<Edge>& edges, int min_observers,
                std::vector<Node>& nodes) {
  DisjointSets sets(nodes.size());
  bool any = false;
  for (const Edge& edge : edges) {
    if (edge.observers < min_observers) continue;
    sets.Join(edge.a, edge.b);
    any = true;
  }
  if (!any) return false;
  std::map<uint32_t, Node> merged;
  for (uint32_t i = 0; i < nodes.size(); ++i) {
    Node& target = merged[sets.Find(i)];
    const bool is_alone = target.segments.empty();
    if (is_alone) {
      target = std::move(nodes[i]);
    } else {
      target.segments = SortedUnion(target.segments, nodes[i].segments);
      target.points = SortedUnion(target.points, nodes[i].points);
      target.views.clear();  // Marks it for recomputation.
    }
  }
  nodes.clear();
  for (auto& [root, node] : merged) {
    if (node.views.empty()) ComputeViews(observations, options, under_segmented, node);
    nodes.push_back(std::move(node));
  }
  return true;
}

std::vector<Node> InitialNodes(const MaskObservations& observations,
                               const ConsensusOptions& options, const Excluded& excluded) {
  std::vector<Node> nodes;
  for (uint32_t s = 0; s < observations.segments.size(); ++s) {
    const SegmentNode& segment = observations.segments[s];
    if (excluded[s] || segment.label.is_crowd ||
        segment.points.size() < static_cast<size_t>(options.min_segment_points)) {
      continue;
    }
    Node node{{s}, segment.points, {}, {}};
    ComputeViews(observations, options, excluded, node);
    nodes.push_back(std::move(node));
  }
  return nodes;
}

}  // namespace

void ConsensusOptions::Visit(OptionVisitor& v) {
  v.Value("min_segment_points", min_segment_points,
          "A segment with fewer points takes no part; nor does a view that sees fewer.", 1);
  v.Value("visible_ratio", visible_ratio, "A view observes a set if it sees this share of it ...",
          0.0, 1.0);
  v.Value("visible_points", visible_points, "... or so many of its points.", 1);
  v.Value("containment", containment,
          "A segment contains a set if this share of the points the view sees lies in it.", 0.5,
          1.0);
  v.Value("max_split_rate", max_split_rate,
          "A segment that more than this share of its observers split is under-segmented.", 0.0,
          1.0);
  v.Value("min_consensus", min_consensus,
          "Sets are merged if this share of their common observers supports it.", 0.0, 1.0);
  v.Value("min_observers", min_observers, "Fewest common observers of two sets to merge.", 1);
}

InstanceAssignment ClusterByConsensus(const MaskObservations& observations,
                                      const ConsensusOptions& options) {
  const Excluded none(observations.segments.size(), false);
  const Excluded under_segmented =
      FindUnderSegmented(observations, options, InitialNodes(observations, options, none));
  std::vector<Node> nodes = InitialNodes(observations, options, under_segmented);
  // The best observed pairs first: halve the number of observers asked for until none is left.
  int min_observers =
      static_cast<int>(std::bit_floor(std::max<size_t>(1, observations.frames.size())));
  std::vector<Edge> edges = FindEdges(nodes, options.min_consensus);
  for (; min_observers >= options.min_observers; min_observers /= 2) {
    while (MergeNodes(observations, options, under_segmented, edges, min_observers, nodes)) {
      edges = FindEdges(nodes, options.min_consensus);
    }
  }
  InstanceAssignment result;
  result.instance_of_segment.assign(observations.segments.size(), kNoInstance);
  for (const Node& node : nodes) {
    for (const uint32_t s : node.segments) result.instance_of_segment[s] = result.num_instances;
    ++result.num_instances;
  }
  return result;
}

}  // namespace s3lam
