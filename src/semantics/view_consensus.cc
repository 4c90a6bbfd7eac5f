#include <algorithm>
#include <cstdint>
#include <map>
#include <numeric>
#include <queue>
#include <utility>

#include "s3lam/semantics/instances.h"

namespace s3lam {
namespace {

/// A weight that goes with a segment, a row or a frame; lists of them are sorted by id. There are
/// very many, so they are small.
struct Weighted {
  uint32_t id = 0;
  float weight = 0.0F;
};
using WeightedList = std::vector<Weighted>;

WeightedList::iterator Find(WeightedList& list, uint32_t id) {
  const auto it =
      std::lower_bound(list.begin(), list.end(), id,
                       [](const Weighted& w, uint32_t wanted) { return w.id < wanted; });
  return it != list.end() && it->id == id ? it : list.end();
}

float WeightOf(WeightedList& list, uint32_t id) {
  const auto it = Find(list, id);
  return it == list.end() ? 0.0F : it->weight;
}

/// Who sees what, in both directions; border and void observations and crowds left out.
struct Views {
  std::vector<WeightedList> segments_of_row;
  std::vector<WeightedList> rows_of_segment;
  std::vector<uint32_t> frame_of_segment;
  size_t num_frames = 0;
};

Views CollectViews(const MaskObservations& observations, const ConsensusOptions& options) {
  Views views;
  views.num_frames = observations.frames.size();
  views.segments_of_row.resize(observations.points.size());
  views.rows_of_segment.resize(observations.segments.size());
  for (const SegmentNode& s : observations.segments) views.frame_of_segment.push_back(s.frame);
  for (uint32_t row = 0; row < observations.points.size(); ++row) {
    for (const PointObservation& o : observations.ObservationsOf(row)) {
      if (o.segment == kVoidSegment || o.near_border) continue;
      const auto segment = static_cast<uint32_t>(o.segment);
      if (observations.segments[segment].label.is_crowd) continue;
      const float weight = o.predicted ? static_cast<float>(options.predicted_weight) : 1.0F;
      views.segments_of_row[row].push_back({segment, weight});
      views.rows_of_segment[segment].push_back({row, weight});
    }
    // Two keypoints of a frame may be in any order.
    std::stable_sort(views.segments_of_row[row].begin(), views.segments_of_row[row].end(),
                     [](const Weighted& a, const Weighted& b) { return a.id < b.id; });
  }
  return views;
}

using Flags = std::vector<char>;  // Faster to ask than bits.

/// Points that each pair of frames has in common; of every k-th point only where there are so many
/// that counting them all takes long.
std::vector<std::vector<float>> CountCommon(const Views& views) {
  constexpr size_t kMaxPairs = 20'000'000;
  size_t pairs = 0;
  for (const WeightedList& row : views.segments_of_row) pairs += row.size() * row.size();
  const size_t step = 1 + pairs / kMaxPairs;
  std::vector<std::vector<float>> common(views.num_frames, std::vector<float>(views.num_frames));
  for (size_t row = 0; row < views.segments_of_row.size(); row += step) {
    for (const Weighted& a : views.segments_of_row[row]) {
      std::vector<float>& of_frame = common[views.frame_of_segment[a.id]];
      for (const Weighted& b : views.segments_of_row[row]) {
        of_frame[views.frame_of_segment[b.id]] += a.weight * b.weight;
      }
    }
  }
  return common;
}

/// For every frame, the frames it is compared with (itself included): those that see its points, or
/// an even choice of max_partners among them, from the most points in common to the least.
std::vector<Flags> ChoosePartners(const Views& views, int max_partners) {
  const std::vector<std::vector<float>> common = CountCommon(views);
  std::vector<Flags> partners(views.num_frames, Flags(views.num_frames, 0));
  for (size_t f = 0; f < views.num_frames; ++f) {
    std::vector<size_t> others;
    for (size_t g = 0; g < views.num_frames; ++g) {
      if (g != f && common[f][g] > 0.0F) others.push_back(g);
    }
    std::stable_sort(others.begin(), others.end(),
                     [&](size_t g, size_t h) { return common[f][g] > common[f][h]; });
    const size_t count = std::min(others.size(), static_cast<size_t>(max_partners));
    for (size_t i = 0; i < count; ++i) {
      const size_t g = others[i * others.size() / count];
      partners[f][g] = partners[g][f] = 1;
    }
    partners[f][f] = 1;
  }
  return partners;
}

/// What the frames vote on pairs of segments.
class PairVotes {
 public:
  PairVotes(const MaskObservations& observations, const ConsensusOptions& options)
      : views_(CollectViews(observations, options)),
        disagreement_(static_cast<float>(options.disagreement)),
        partners_(ChoosePartners(views_, options.max_partners)),
        seen_by_frame_(views_.num_frames),
        shared_(num_segments(), 0.0F),
        seen_(views_.num_frames, 0.0F) {
    for (uint32_t a = 0; a < num_segments(); ++a) {
      visible_.push_back(CountVisible(a));
      for (const Weighted& frame : visible_.back()) {
        seen_by_frame_[frame.id].push_back({a, frame.weight});
      }
    }
  }

  [[nodiscard]] size_t num_segments() const { return views_.frame_of_segment.size(); }

  /// Calls visit(b, weight) for every segment a < b < end on which frames vote together with a, by
  /// ascending b. The weight is positive where they find the two to be one object.
  template <typename Visit>
  void ForEachPair(uint32_t a, uint32_t end, const Visit& visit) {
    const uint32_t frame_a = views_.frame_of_segment[a];
    const Flags& partners = partners_[frame_a];
    for (const Weighted& frame : visible_[a]) seen_[frame.id] = frame.weight;
    touched_.clear();
    for (const Weighted& row : views_.rows_of_segment[a]) {
      const WeightedList& segments = views_.segments_of_row[row.id];
      auto b = std::upper_bound(segments.begin(), segments.end(), a,
                                [](uint32_t id, const Weighted& w) { return id < w.id; });
      for (; b != segments.end() && b->id < end; ++b) {
        if (partners[views_.frame_of_segment[b->id]] == 0) continue;
        touched_.push_back(b->id);
        shared_[b->id] += row.weight * b->weight;
      }
    }
    for (const Weighted& b : seen_by_frame_[frame_a]) {
      if (b.id <= a) continue;
      if (b.id >= end) break;
      const uint32_t frame_b = views_.frame_of_segment[b.id];
      if (seen_[frame_b] == 0.0F) continue;
      const float common = frame_b == frame_a ? 0.0F : shared_[b.id];
      const float apart = seen_[frame_b] + b.weight - 2.0F * common;
      visit(b.id, common - disagreement_ * apart);
    }
    for (const uint32_t b : touched_) shared_[b] = 0.0F;
    for (const Weighted& frame : visible_[a]) seen_[frame.id] = 0.0F;
  }

 private:
  /// The points of a segment that each partner of its frame sees, in whatever segment.
  [[nodiscard]] WeightedList CountVisible(uint32_t a) {
    const uint32_t frame_a = views_.frame_of_segment[a];
    const Flags& partners = partners_[frame_a];
    touched_.clear();
    for (const Weighted& row : views_.rows_of_segment[a]) {
      for (const Weighted& b : views_.segments_of_row[row.id]) {
        const uint32_t frame_b = views_.frame_of_segment[b.id];
        if (partners[frame_b] == 0 || (frame_b == frame_a && b.id != a)) continue;
        if (seen_[frame_b] == 0.0F) touched_.push_back(frame_b);
        seen_[frame_b] += row.weight * b.weight;
      }
    }
    std::sort(touched_.begin(), touched_.end());
    WeightedList visible;
    for (const uint32_t frame : touched_) {
      visible.push_back({frame, seen_[frame]});
      seen_[frame] = 0.0F;
    }
    visible.shrink_to_fit();
    return visible;
  }

  Views views_;
  float disagreement_;
  std::vector<Flags> partners_;
  std::vector<WeightedList> visible_;        // Of each segment: the partners that see its points.
  std::vector<WeightedList> seen_by_frame_;  // The same by frame.
  // Scratch, zero between calls.
  std::vector<float> shared_;  // By segment.
  std::vector<float> seen_;    // By frame.
  std::vector<uint32_t> touched_;
};

/// An undirected graph with signed weights, whose nodes can be contracted.
class SignedGraph {
 public:
  explicit SignedGraph(size_t num_nodes) : neighbors_(num_nodes), root_(num_nodes) {
    std::iota(root_.begin(), root_.end(), 0U);
  }

  /// Edges must come by ascending (a, b), a < b.
  void AddEdge(uint32_t a, uint32_t b, float weight) {
    neighbors_[a].push_back({b, weight});
    neighbors_[b].push_back({a, weight});
  }

  [[nodiscard]] size_t size() const { return root_.size(); }
  [[nodiscard]] bool IsAlive(uint32_t node) const { return root_[node] == node; }
  [[nodiscard]] const WeightedList& NeighborsOf(uint32_t node) const { return neighbors_[node]; }
  /// Weight of an edge; 0 if there is none.
  [[nodiscard]] float Weight(uint32_t a, uint32_t b) { return WeightOf(neighbors_[a], b); }

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
      Weighted sum{from_a ? x->id : y->id, 0.0F};
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
  void SetWeight(uint32_t node, uint32_t neighbor, float weight) {
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

struct Contraction {
  float weight = 0.0F;
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
void ContractGreedily(float min_weight, SignedGraph& graph) {
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

/// Which segment stands for the object of each one.
using Roots = std::vector<uint32_t>;

/// Contracts the segments of each run of `window` frames by themselves: the graph of all of them
/// would not fit into memory.
Roots ContractWindows(const MaskObservations& observations, uint32_t window, float min_weight,
                      PairVotes& votes) {
  Roots roots(votes.num_segments());
  for (uint32_t begin = 0; begin < roots.size();) {
    const uint32_t last_frame = observations.segments[begin].frame + window;
    uint32_t end = begin;
    while (end < roots.size() && observations.segments[end].frame < last_frame) ++end;
    SignedGraph graph(end - begin);
    for (uint32_t a = begin; a < end; ++a) {
      votes.ForEachPair(a, end,
                        [&](uint32_t b, float w) { graph.AddEdge(a - begin, b - begin, w); });
    }
    ContractGreedily(min_weight, graph);
    for (uint32_t a = begin; a < end; ++a) roots[a] = begin + graph.Root(a - begin);
    begin = end;
  }
  return roots;
}

/// The votes on each pair of windows' objects, those of their segments taken together.
std::vector<std::map<uint32_t, float>> SumVotes(const Roots& roots, PairVotes& votes) {
  const auto end = static_cast<uint32_t>(roots.size());
  std::vector<std::vector<uint32_t>> members(roots.size());
  for (uint32_t a = 0; a < end; ++a) members[roots[a]].push_back(a);
  std::vector<std::map<uint32_t, float>> sums(roots.size());
  std::vector<float> with(roots.size(), 0.0F);  // Of one object with each; zero in between.
  std::vector<uint32_t> touched;
  for (uint32_t root = 0; root < end; ++root) {
    for (const uint32_t a : members[root]) {
      votes.ForEachPair(a, end, [&](uint32_t b, float weight) {
        if (with[roots[b]] == 0.0F) touched.push_back(roots[b]);
        with[roots[b]] += weight;
      });
    }
    for (const uint32_t other : touched) {
      if (other != root && with[other] != 0.0F) {
        sums[std::min(root, other)][std::max(root, other)] += with[other];
      }
      with[other] = 0.0F;
    }
    touched.clear();
  }
  return sums;
}

/// Contracts what the windows left, by the votes of all frames.
void ContractAcrossWindows(float min_weight, PairVotes& votes, Roots& roots) {
  std::vector<std::map<uint32_t, float>> sums = SumVotes(roots, votes);
  SignedGraph graph(roots.size());
  for (uint32_t a = 0; a < sums.size(); ++a) {
    for (const auto& [b, weight] : sums[a]) graph.AddEdge(a, b, weight);
    sums[a].clear();
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
  v.Value("min_agreement", min_agreement,
          "Objects are joined while the points in favour outweigh those against by this.", 0.0);
  v.Value("max_partners", max_partners, "Frames that each frame is compared with at most.", 1);
  v.Value("window", window,
          "Frames whose segments are joined among themselves first, to save memory; fewer frames "
          "than this are joined all at once.",
          1);
}

InstanceAssignment ClusterByConsensus(const MaskObservations& observations,
                                      const ConsensusOptions& options) {
  const auto window = static_cast<uint32_t>(options.window);
  const auto min_weight = static_cast<float>(options.min_agreement);
  PairVotes votes(observations, options);
  Roots roots = ContractWindows(observations, window, min_weight, votes);
  if (observations.frames.size() > window) ContractAcrossWindows(min_weight, votes, roots);
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
