#include <algorithm>
#include <cmath>
#include <numeric>
#include <queue>
#include <utility>

#include "s3lam/semantics/instances.h"

namespace s3lam {
namespace {

/// A weight that goes with a segment, a row or a frame; lists of them are sorted by id.
struct Weighted {
  uint32_t id = 0;
  double weight = 0.0;
};
using WeightedList = std::vector<Weighted>;

WeightedList::iterator Find(WeightedList& list, uint32_t id) {
  const auto it =
      std::lower_bound(list.begin(), list.end(), id,
                       [](const Weighted& w, uint32_t wanted) { return w.id < wanted; });
  return it != list.end() && it->id == id ? it : list.end();
}

double WeightOf(WeightedList& list, uint32_t id) {
  const auto it = Find(list, id);
  return it == list.end() ? 0.0 : it->weight;
}

/// Who sees what, in both directions; border and void observations and crowds left out.
struct Votes {
  std::vector<WeightedList> segments_of_row;
  std::vector<WeightedList> rows_of_segment;
};

Votes CollectVotes(const MaskObservations& observations, const ConsensusOptions& options) {
  Votes votes;
  votes.segments_of_row.resize(observations.points.size());
  votes.rows_of_segment.resize(observations.segments.size());
  for (uint32_t row = 0; row < observations.points.size(); ++row) {
    for (const PointObservation& o : observations.ObservationsOf(row)) {
      if (o.segment == kVoidSegment || o.near_border) continue;
      const auto segment = static_cast<uint32_t>(o.segment);
      if (observations.segments[segment].label.is_crowd) continue;
      const double weight = o.predicted ? options.predicted_weight : 1.0;
      votes.segments_of_row[row].push_back({segment, weight});
      votes.rows_of_segment[segment].push_back({row, weight});
    }
  }
  return votes;
}

/// For every segment: the points it shares with each segment of the other frames.
std::vector<WeightedList> CountShared(const MaskObservations& observations, const Votes& votes) {
  const size_t num_segments = observations.segments.size();
  std::vector<WeightedList> shared(num_segments);
  std::vector<double> sums(num_segments, 0.0);
  std::vector<uint32_t> touched;
  for (uint32_t a = 0; a < num_segments; ++a) {
    touched.clear();
    for (const Weighted& row : votes.rows_of_segment[a]) {
      for (const Weighted& b : votes.segments_of_row[row.id]) {
        if (sums[b.id] == 0.0) touched.push_back(b.id);
        sums[b.id] += row.weight * b.weight;
      }
    }
    std::sort(touched.begin(), touched.end());
    for (const uint32_t b : touched) {
      const bool same_frame = observations.segments[a].frame == observations.segments[b].frame;
      if (!same_frame || a == b) shared[a].push_back({b, sums[b]});
      sums[b] = 0.0;
    }
  }
  return shared;
}

/// For every segment: the points of it that each frame sees, in whatever segment.
std::vector<WeightedList> CountVisible(const MaskObservations& observations,
                                       const std::vector<WeightedList>& shared) {
  std::vector<WeightedList> visible(shared.size());
  for (size_t a = 0; a < shared.size(); ++a) {
    for (const Weighted& b : shared[a]) {  // By segment, hence by frame.
      const uint32_t frame = observations.segments[b.id].frame;
      if (visible[a].empty() || visible[a].back().id != frame) visible[a].push_back({frame, 0.0});
      visible[a].back().weight += b.weight;
    }
  }
  return visible;
}

/// For every frame, the frames it is compared with (itself included): those that see its points, or
/// an even choice of max_partners among them, from the most points in common to the least.
std::vector<std::vector<bool>> ChoosePartners(const MaskObservations& observations,
                                              const std::vector<WeightedList>& visible,
                                              int max_partners) {
  const size_t num_frames = observations.frames.size();
  std::vector<std::vector<double>> common(num_frames, std::vector<double>(num_frames, 0.0));
  for (size_t a = 0; a < visible.size(); ++a) {
    for (const Weighted& frame : visible[a]) {
      common[observations.segments[a].frame][frame.id] += frame.weight;
    }
  }
  std::vector<std::vector<bool>> partners(num_frames, std::vector<bool>(num_frames, false));
  for (size_t f = 0; f < num_frames; ++f) {
    std::vector<size_t> others;
    for (size_t g = 0; g < num_frames; ++g) {
      if (g != f && common[f][g] > 0.0) others.push_back(g);
    }
    std::stable_sort(others.begin(), others.end(),
                     [&](size_t g, size_t h) { return common[f][g] > common[f][h]; });
    const auto limit = static_cast<size_t>(max_partners);
    const size_t count = std::min(others.size(), limit);
    for (size_t i = 0; i < count; ++i) {
      const size_t g = others[i * others.size() / count];
      partners[f][g] = partners[g][f] = true;
    }
    partners[f][f] = true;
  }
  return partners;
}

/// An undirected graph with signed weights, whose nodes can be contracted.
class SignedGraph {
 public:
  explicit SignedGraph(size_t num_nodes) : neighbors_(num_nodes), root_(num_nodes) {
    std::iota(root_.begin(), root_.end(), 0U);
  }

  /// Edges must come by ascending (a, b), a < b.
  void AddEdge(uint32_t a, uint32_t b, double weight) {
    neighbors_[a].push_back({b, weight});
    neighbors_[b].push_back({a, weight});
  }

  [[nodiscard]] size_t size() const { return root_.size(); }
  [[nodiscard]] bool IsAlive(uint32_t node) const { return root_[node] == node; }
  [[nodiscard]] const WeightedList& NeighborsOf(uint32_t node) const { return neighbors_[node]; }
  /// Weight of an edge; 0 if there is none.
  [[nodiscard]] double Weight(uint32_t a, uint32_t b) { return WeightOf(neighbors_[a], b); }

  /// Contracts b into a; weights to common neighbours add up. Returns the edges that changed.
  WeightedList Contract(uint32_t a, uint32_t b) {
    root_[b] = a;
    WeightedList changed;
    WeightedList merged;
    auto x = neighbors_[a].begin();
    auto y = neighbors_[b].begin();
    while (x != neighbors_[a].end() || y != neighbors_[b].end()) {
      const bool from_a = y == neighbors_[b].end() || (x != neighbors_[a].end() && x->id <= y->id);
      const bool from_b = x == neighbors_[a].end() || (y != neighbors_[b].end() && y->id <= x->id);
      Weighted sum{from_a ? x->id : y->id, 0.0};
      if (from_a) sum.weight += (x++)->weight;
      if (from_b) sum.weight += (y++)->weight;
      if (sum.id == a || !IsAlive(sum.id)) continue;
      merged.push_back(sum);
      if (from_b) changed.push_back(sum);
    }
    for (const Weighted& c : changed) SetWeight(c.id, a, c.weight);
    neighbors_[a] = std::move(merged);
    neighbors_[b] = {};
    return changed;
  }

  /// The node that holds this one now.
  [[nodiscard]] uint32_t Root(uint32_t node) const {
    while (root_[node] != node) node = root_[node];
    return node;
  }

 private:
  /// The entry of a contracted neighbour stays in the list until the next contraction of `node`.
  void SetWeight(uint32_t node, uint32_t neighbor, double weight) {
    WeightedList& list = neighbors_[node];
    const auto it = std::lower_bound(list.begin(), list.end(), neighbor,
                                     [](const Weighted& w, uint32_t id) { return w.id < id; });
    if (it != list.end() && it->id == neighbor) {
      it->weight = weight;
    } else {
      list.insert(it, {neighbor, weight});
    }
  }

  std::vector<WeightedList> neighbors_;
  std::vector<uint32_t> root_;
};

/// For every frame: the segments of which it sees points, and how many.
std::vector<WeightedList> Transpose(const std::vector<WeightedList>& visible, size_t num_frames) {
  std::vector<WeightedList> segments_of_frame(num_frames);
  for (uint32_t s = 0; s < visible.size(); ++s) {
    for (const Weighted& frame : visible[s]) {
      segments_of_frame[frame.id].push_back({s, frame.weight});
    }
  }
  return segments_of_frame;
}

/// Sets the entries of a dense array that a list names, or clears them.
void Scatter(const WeightedList& list, bool clear, std::vector<double>& dense) {
  for (const Weighted& w : list) dense[w.id] = clear ? 0.0 : w.weight;
}

SignedGraph BuildGraph(const MaskObservations& observations, const ConsensusOptions& options) {
  const auto shared = CountShared(observations, CollectVotes(observations, options));
  const auto visible = CountVisible(observations, shared);
  const auto partners = ChoosePartners(observations, visible, options.max_partners);
  const size_t num_frames = observations.frames.size();
  const std::vector<WeightedList> seen_by_frame = Transpose(visible, num_frames);
  std::vector<double> shared_with(shared.size(), 0.0);  // By segment, of segment a.
  std::vector<double> seen_in(num_frames, 0.0);         // By frame, of segment a.
  SignedGraph graph(shared.size());
  for (uint32_t a = 0; a < shared.size(); ++a) {
    const uint32_t frame_a = observations.segments[a].frame;
    Scatter(shared[a], false, shared_with);
    Scatter(visible[a], false, seen_in);
    for (const Weighted& b : seen_by_frame[frame_a]) {
      if (b.id <= a) continue;
      const uint32_t frame_b = observations.segments[b.id].frame;
      if (seen_in[frame_b] == 0.0 || !partners[frame_a][frame_b]) continue;
      const double common = frame_b == frame_a ? 0.0 : shared_with[b.id];
      const double apart = seen_in[frame_b] + b.weight - 2.0 * common;
      graph.AddEdge(a, b.id, common - options.disagreement * apart);
    }
    Scatter(shared[a], true, shared_with);
    Scatter(visible[a], true, seen_in);
  }
  return graph;
}

struct Contraction {
  double weight = 0.0;
  uint32_t a = 0;
  uint32_t b = 0;

  /// The heavier first, then the lower ids.
  bool operator<(const Contraction& other) const {
    if (weight != other.weight) return weight < other.weight;
    return std::pair(a, b) > std::pair(other.a, other.b);
  }
};

/// Contracts the heaviest edge as long as one is heavier than `min_weight` (Keuper et al., ICCV
/// 2015: greedy additive edge contraction for correlation clustering).
void ContractGreedily(double min_weight, SignedGraph& graph) {
  std::priority_queue<Contraction> queue;
  for (uint32_t a = 0; a < graph.size(); ++a) {
    for (const Weighted& b : graph.NeighborsOf(a)) {
      if (b.id > a && b.weight > min_weight) queue.push({b.weight, a, b.id});
    }
  }
  while (!queue.empty()) {
    const Contraction best = queue.top();
    queue.pop();
    const bool is_current = graph.IsAlive(best.a) && graph.IsAlive(best.b) &&
                            graph.Weight(best.a, best.b) == best.weight;
    if (!is_current) continue;
    for (const Weighted& c : graph.Contract(best.a, best.b)) {
      if (c.weight > min_weight) {
        queue.push({c.weight, std::min(best.a, c.id), std::max(best.a, c.id)});
      }
    }
  }
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
  v.Value("min_agreement", min_agreement,
          "Objects are joined while the points in favour outweigh those against by this.", 0.0);
  v.Value("max_partners", max_partners, "Frames that each frame is compared with at most.", 1);
}

InstanceAssignment ClusterByConsensus(const MaskObservations& observations,
                                      const ConsensusOptions& options) {
  SignedGraph graph = BuildGraph(observations, options);
  ContractGreedily(options.min_agreement, graph);
  InstanceAssignment result;
  result.instance_of_segment.assign(graph.size(), kNoInstance);
  for (uint32_t s = 0; s < graph.size(); ++s) {
    const SegmentNode& segment = observations.segments[s];
    if (segment.points.empty() || segment.label.is_crowd) continue;
    int32_t& instance = result.instance_of_segment[graph.Root(s)];  // Roots come first.
    if (instance == kNoInstance) instance = result.num_instances++;
    result.instance_of_segment[s] = instance;
  }
  return result;
}

}  // namespace s3lam
