#include <algorithm>
#include <cstdint>
#include <numeric>
#include <queue>
#include <utility>

#include "s3lam/base/parallel.h"
#include "s3lam/semantics/instances.h"
#include "view_votes.h"

namespace s3lam {
namespace {

/// An undirected graph with signed weights, whose nodes can be contracted.
class SignedGraph {
 public:
  explicit SignedGraph(size_t num_nodes)
      : neighbors_(num_nodes), root_(num_nodes), sum_(num_nodes, 0.0F), is_touched_(num_nodes, 0) {
    std::iota(root_.begin(), root_.end(), 0U);
  }

  /// At most once for a pair.
  void AddEdge(uint32_t a, uint32_t b, float weight) {
    neighbors_[a].push_back({b, weight});
    neighbors_[b].push_back({a, weight});
  }

  [[nodiscard]] size_t size() const { return root_.size(); }
  [[nodiscard]] bool IsAlive(uint32_t node) const { return root_[node] == node; }

  /// The node that holds this one now.
  uint32_t Root(uint32_t node) {
    while (root_[node] != node) node = root_[node] = root_[root_[node]];
    return node;
  }

  /// Puts b and its edges into a; the weights to a common neighbour add up.
  void Contract(uint32_t a, uint32_t b) {
    root_[b] = a;
    neighbors_[a].insert(neighbors_[a].end(), neighbors_[b].begin(), neighbors_[b].end());
    neighbors_[b] = {};
  }

  /// The nodes alive that a living one has edges to, each once.
  const WeightedList& Neighbors(uint32_t node) {
    WeightedList& list = neighbors_[node];
    size_t count = 0;
    for (const Weighted& edge : list) {
      const uint32_t other = Root(edge.id);
      if (other == node) continue;
      if (is_touched_[other] == 0) list[count++].id = other;  // Not ahead of what is read.
      is_touched_[other] = 1;
      sum_[other] += edge.weight;
    }
    list.resize(count);
    for (Weighted& edge : list) {
      edge.weight = std::exchange(sum_[edge.id], 0.0F);
      is_touched_[edge.id] = 0;
    }
    return list;
  }

 private:
  std::vector<WeightedList> neighbors_;  // By ids that may be contracted since.
  std::vector<uint32_t> root_;
  std::vector<float> sum_;           // Zero between calls.
  std::vector<uint8_t> is_touched_;  // Zero between calls.
};

/// The heaviest edge of a node, as it was when both ends had had so many contractions.
struct HeaviestEdge {
  float weight = 0.0F;
  uint32_t node = 0;
  uint32_t other = 0;
  uint32_t version_of_node = 0;
  uint32_t version_of_other = 0;

  /// The heavier first, then the lower ids.
  bool operator<(const HeaviestEdge& than) const {
    if (weight != than.weight) return weight < than.weight;
    return std::minmax(node, other) > std::minmax(than.node, than.other);
  }
};

/// Contracts the heaviest edge as long as one is heavier than `min_weight` (Keuper et al., ICCV
/// 2015: greedy additive edge contraction for correlation clustering). An edge changes only when
/// something is contracted into one of its ends, whose heaviest edge is queued anew then; so no
/// edge is heavier than what is queued of both its ends.
void ContractGreedily(float min_weight, SignedGraph& graph) {
  std::priority_queue<HeaviestEdge> queue;
  std::vector<uint32_t> version(graph.size(), 0);  // Counts the contractions into a node.
  const auto enqueue = [&](uint32_t node) {
    HeaviestEdge best{min_weight, node, node, version[node], 0};
    for (const Weighted& edge : graph.Neighbors(node)) {
      if (edge.weight > best.weight ||
          (edge.weight == best.weight && best.other != node && edge.id < best.other)) {
        best.weight = edge.weight;
        best.other = edge.id;
      }
    }
    if (best.other == node) return;
    best.version_of_other = version[best.other];
    queue.push(best);
  };
  for (uint32_t node = 0; node < graph.size(); ++node) enqueue(node);
  while (!queue.empty()) {
    const HeaviestEdge best = queue.top();
    queue.pop();
    if (!graph.IsAlive(best.node) || version[best.node] != best.version_of_node) continue;
    if (!graph.IsAlive(best.other) || version[best.other] != best.version_of_other) {
      enqueue(best.node);
      continue;
    }
    const auto [a, b] = std::minmax(best.node, best.other);
    graph.Contract(a, b);
    ++version[a];
    enqueue(a);
  }
}

/// Which segment stands for the object of each one.
using Roots = std::vector<uint32_t>;

/// Frames whose votes are counted in a row by one thread.
constexpr uint32_t kFramesOfBatch = 16;

/// Calls body(batch, first, last) for batches 0, 1, ... of the frames from begin to end.
template <typename Body>
void ForEachBatch(uint32_t begin, uint32_t end, int num_threads, const Body& body) {
  const size_t num_batches = (end - begin + kFramesOfBatch - 1) / kFramesOfBatch;
  ParallelFor(num_batches, num_threads, [&](size_t batch) {
    const uint32_t first = begin + static_cast<uint32_t>(batch) * kFramesOfBatch;
    body(batch, first, std::min(end, first + kFramesOfBatch));
  });
}

/// A vote on a pair of objects, the lower one first.
struct ObjectVote {
  std::pair<uint32_t, uint32_t> objects;
  float weight = 0.0F;
};
using ObjectVotes = std::vector<ObjectVote>;

/// Makes one vote, by ascending objects, of those on the same pair.
void SumByPair(ObjectVotes& votes) {
  std::stable_sort(votes.begin(), votes.end(),
                   [](const ObjectVote& a, const ObjectVote& b) { return a.objects < b.objects; });
  size_t count = 0;
  for (const ObjectVote& vote : votes) {
    if (count > 0 && votes[count - 1].objects == vote.objects) {
      votes[count - 1].weight += vote.weight;
    } else {
      votes[count++] = vote;
    }
  }
  votes.resize(count);
}

/// Contracts the segments of a run of frames by themselves: the graph of all of them would not fit
/// into memory. Returns what these frames say of the pairs that are left.
ObjectVotes ContractWindow(const CommonViews& views, uint32_t begin, uint32_t end, float min_weight,
                           int num_threads, Roots& roots) {
  std::vector<std::vector<WeightedList>> votes(end - begin);
  ForEachBatch(begin, end, num_threads, [&](size_t /*batch*/, uint32_t first, uint32_t last) {
    VoteCounter counter(views);
    for (uint32_t f = first; f < last; ++f) votes[f - begin] = counter.Count(f, begin, end);
  });
  const uint32_t base = views.FirstSegmentOf(begin);
  SignedGraph graph(views.FirstSegmentOf(end) - base);
  uint32_t a = 0;
  for (std::vector<WeightedList>& of_frame : votes) {
    for (const WeightedList& of_segment : of_frame) {
      for (const Weighted& b : of_segment) graph.AddEdge(a, b.id - base, b.weight);
      ++a;
    }
    of_frame = {};
  }
  ContractGreedily(min_weight, graph);
  ObjectVotes left;
  for (a = 0; a < graph.size(); ++a) {
    roots[base + a] = base + graph.Root(a);
    if (!graph.IsAlive(a)) continue;
    for (const Weighted& b : graph.Neighbors(a)) {
      if (b.id > a) left.push_back({{base + a, base + b.id}, b.weight});
    }
  }
  return left;
}

/// The votes of some frames, and those behind their window, on pairs of windows' objects, those of
/// the objects' segments taken together.
ObjectVotes VotesAcrossWindows(const CommonViews& views, const Roots& roots, uint32_t window,
                               uint32_t first, uint32_t last) {
  ObjectVotes votes;
  VoteCounter counter(views);
  std::vector<float> with(roots.size(), 0.0F);  // Of one segment with each object.
  std::vector<uint32_t> touched;
  uint32_t a = views.FirstSegmentOf(first);
  for (uint32_t f = first; f < last; ++f) {
    const uint32_t end_of_window = (f / window + 1) * window;
    for (const WeightedList& of_segment : counter.Count(f, end_of_window, views.num_frames())) {
      for (const Weighted& b : of_segment) {
        const uint32_t object = roots[b.id];
        if (with[object] == 0.0F) touched.push_back(object);
        with[object] += b.weight;
      }
      const uint32_t own = roots[a++];
      for (const uint32_t object : touched) {
        if (with[object] != 0.0F) votes.push_back({std::minmax(own, object), with[object]});
        with[object] = 0.0F;
      }
      touched.clear();
    }
  }
  SumByPair(votes);
  return votes;
}

/// Contracts what the windows left, by the votes of all frames; `votes` are those within windows.
void ContractAcrossWindows(const CommonViews& views, uint32_t window, float min_weight,
                           int num_threads, ObjectVotes votes, Roots& roots) {
  const uint32_t num_frames = views.num_frames();
  std::vector<ObjectVotes> across((num_frames + kFramesOfBatch - 1) / kFramesOfBatch);
  ForEachBatch(0, num_frames, num_threads, [&](size_t batch, uint32_t first, uint32_t last) {
    across[batch] = VotesAcrossWindows(views, roots, window, first, last);
  });
  for (ObjectVotes& of_batch : across) {
    votes.insert(votes.end(), of_batch.begin(), of_batch.end());
    of_batch = {};
  }
  SumByPair(votes);
  SignedGraph graph(roots.size());
  for (const auto& [objects, weight] : votes) {
    graph.AddEdge(objects.first, objects.second, weight);
  }
  ContractGreedily(min_weight, graph);
  for (uint32_t& root : roots) root = graph.Root(root);
}

}  // namespace

void ConsensusOptions::Visit(OptionVisitor& v) {
  v.Value("disagreement", disagreement,
          "What a point that two frames put into different segments counts against one they put "
          "into the same.",
          0.0);
  v.Value("predicted_weight", predicted_weight,
          "What a predicted observation counts against a real one (see lookup.visibility).", 0.0,
          1.0);
  v.Value("other_class_weight", other_class_weight,
          "What a point in two segments of different classes counts in their favour against one in "
          "segments of the same class.",
          0.0, 1.0);
  v.Value("min_agreement", min_agreement,
          "Objects are joined while the points in favour outweigh those against by this.", 0.0);
  v.Value("max_partners", max_partners, "Frames that each frame is compared with at most.", 1);
  v.Value("window", window,
          "Frames whose segments are joined among themselves first, to save memory; fewer frames "
          "than this are joined all at once.",
          1);
}

InstanceAssignment ClusterByConsensus(const MaskObservations& observations,
                                      const ConsensusOptions& options, int num_threads) {
  const auto window = static_cast<uint32_t>(options.window);
  const auto min_weight = static_cast<float>(options.min_agreement);
  const CommonViews views(observations, options, num_threads);
  const uint32_t num_frames = views.num_frames();
  Roots roots(views.num_segments());
  ObjectVotes votes;
  for (uint32_t begin = 0; begin < num_frames; begin += window) {
    const uint32_t end = begin + std::min(window, num_frames - begin);
    const ObjectVotes left = ContractWindow(views, begin, end, min_weight, num_threads, roots);
    votes.insert(votes.end(), left.begin(), left.end());
  }
  if (num_frames > window) {
    ContractAcrossWindows(views, window, min_weight, num_threads, std::move(votes), roots);
  }
  InstanceAssignment result;
  result.instance_of_segment.assign(roots.size(), kNoInstance);
  std::vector<int32_t> instance_of_root(roots.size(), kNoInstance);
  for (uint32_t s = 0; s < roots.size(); ++s) {
    const SegmentNode& segment = observations.segments[s];
    if (segment.points.empty() || segment.label.is_crowd) continue;
    int32_t& instance = instance_of_root[roots[s]];
    if (instance == kNoInstance) instance = result.num_instances++;
    result.instance_of_segment[s] = instance;
  }
  return result;
}

}  // namespace s3lam
