#include "view_votes.h"

#include <algorithm>
#include <limits>

#include "s3lam/base/parallel.h"

namespace s3lam {
namespace {

constexpr uint32_t kNone = std::numeric_limits<uint32_t>::max();

/// For every frame, the later ones it is compared with: those that see its points, or, of each of
/// the two, an even choice of max_partners among them, from the most points in common to the least.
std::vector<std::vector<uint32_t>> ChoosePartners(
    const std::vector<std::vector<CommonViews::Sighting>>& sightings,
    const std::vector<WeightedList>& frames_of_row, int max_partners, int num_threads) {
  const size_t num_frames = sightings.size();
  constexpr size_t kMaxPairs = 20'000'000;  // Where there are more, every k-th point is asked.
  size_t pairs = 0;
  for (const WeightedList& row : frames_of_row) pairs += row.size() * row.size();
  const size_t step = 1 + pairs / kMaxPairs;
  std::vector<std::vector<uint32_t>> chosen(num_frames);
  ParallelFor(num_frames, num_threads, [&](size_t f) {
    std::vector<float> common(num_frames, 0.0F);
    for (const CommonViews::Sighting& s : sightings[f]) {
      if (s.row % step != 0) continue;
      for (const Weighted& b : frames_of_row[s.row]) common[b.id] += s.weight * b.weight;
    }
    WeightedList others;
    for (uint32_t g = 0; g < num_frames; ++g) {
      if (g != f && common[g] > 0.0F) others.push_back({g, common[g]});
    }
    std::sort(others.begin(), others.end(), [](const Weighted& g, const Weighted& h) {
      return g.weight != h.weight ? g.weight > h.weight : g.id < h.id;
    });
    const size_t count = std::min(others.size(), static_cast<size_t>(max_partners));
    for (size_t i = 0; i < count; ++i) chosen[f].push_back(others[i * others.size() / count].id);
  });
  std::vector<std::vector<uint32_t>> partners(num_frames);
  for (uint32_t f = 0; f < num_frames; ++f) {
    for (const uint32_t g : chosen[f]) partners[std::min(f, g)].push_back(std::max(f, g));
  }
  for (std::vector<uint32_t>& later : partners) {
    std::sort(later.begin(), later.end());
    later.erase(std::unique(later.begin(), later.end()), later.end());
  }
  return partners;
}

}  // namespace

CommonViews::CommonViews(const MaskObservations& observations, const ConsensusOptions& options,
                         int num_threads)
    : num_rows_(observations.points.size()),
      sightings_(observations.frames.size()),
      first_segment_(observations.frames.size() + 1, 0),
      disagreement_(static_cast<float>(options.disagreement)),
      other_class_weight_(static_cast<float>(options.other_class_weight)) {
  for (const SegmentNode& s : observations.segments) {
    ++first_segment_[s.frame + 1];
    class_of_segment_.push_back(s.label.class_index);
  }
  for (size_t f = 1; f < first_segment_.size(); ++f) first_segment_[f] += first_segment_[f - 1];
  std::vector<WeightedList> frames_of_row(num_rows_);
  for (uint32_t row = 0; row < num_rows_; ++row) {
    for (const PointObservation& o : observations.ObservationsOf(row)) {
      if (o.segment == kVoidSegment || o.near_border) continue;
      const auto segment = static_cast<uint32_t>(o.segment);
      if (observations.segments[segment].label.is_crowd) continue;
      const float weight = o.predicted ? static_cast<float>(options.predicted_weight) : 1.0F;
      sightings_[o.frame].push_back({row, segment - first_segment_[o.frame], weight});
      frames_of_row[row].push_back({o.frame, weight});
    }
  }
  partners_ = ChoosePartners(sightings_, frames_of_row, options.max_partners, num_threads);
}

VoteCounter::VoteCounter(const CommonViews& views)
    : views_(views), first_sighting_(views.num_rows_, kNone) {}

std::vector<WeightedList> VoteCounter::Count(uint32_t frame, uint32_t begin, uint32_t end) {
  const auto& sightings = views_.sightings_[frame];
  std::vector<WeightedList> votes(views_.first_segment_[frame + 1] - views_.first_segment_[frame]);
  for (auto i = static_cast<uint32_t>(sightings.size()); i-- > 0;) {
    first_sighting_[sightings[i].row] = i;
  }
  if (begin <= frame) CountOwn(frame, votes);
  for (const uint32_t other : views_.partners_[frame]) {
    if (other >= end) break;
    if (other >= begin) CountPair(frame, other, votes);
  }
  for (const auto& s : sightings) first_sighting_[s.row] = kNone;
  return votes;
}

/// Two segments of one frame have no point in common and speak against each other with all of them.
void VoteCounter::CountOwn(uint32_t frame, std::vector<WeightedList>& votes) {
  const auto& sightings = views_.sightings_[frame];
  seen_.assign(votes.size(), 0.0F);
  for (const auto& b : sightings) {
    // A point may have several keypoints in a frame.
    for (uint32_t i = first_sighting_[b.row]; i < sightings.size() && sightings[i].row == b.row;
         ++i) {
      if (sightings[i].segment == b.segment) seen_[b.segment] += sightings[i].weight * b.weight;
    }
  }
  const uint32_t first = views_.first_segment_[frame];
  for (uint32_t a = 0; a < votes.size(); ++a) {
    if (seen_[a] == 0.0F) continue;
    for (uint32_t b = a + 1; b < votes.size(); ++b) {
      if (seen_[b] == 0.0F) continue;
      votes[a].push_back({first + b, -views_.disagreement_ * (seen_[a] + seen_[b])});
    }
  }
}

/// What two frames put into both segments speaks for one object, less so if they are of different
/// classes; what they see of either elsewhere, against it.
void VoteCounter::CountPair(uint32_t frame, uint32_t other, std::vector<WeightedList>& votes) {
  const auto& sightings = views_.sightings_[frame];
  const uint32_t own_first = views_.first_segment_[frame];
  const uint32_t first = views_.first_segment_[other];
  const uint32_t num_others = views_.first_segment_[other + 1] - first;
  const auto weight_of_common = [&](uint32_t a, uint32_t b) {
    const bool same_class =
        views_.class_of_segment_[own_first + a] == views_.class_of_segment_[first + b];
    return same_class ? 1.0F : views_.other_class_weight_;
  };
  common_.assign(votes.size() * num_others, 0.0F);
  seen_.assign(votes.size(), 0.0F);
  seen_of_other_.assign(num_others, 0.0F);
  for (const auto& b : views_.sightings_[other]) {
    for (uint32_t i = first_sighting_[b.row]; i < sightings.size() && sightings[i].row == b.row;
         ++i) {
      const auto& a = sightings[i];
      const float weight = a.weight * b.weight;
      common_[a.segment * num_others + b.segment] += weight;
      seen_[a.segment] += weight;
      seen_of_other_[b.segment] += weight;
    }
  }
  for (uint32_t a = 0; a < votes.size(); ++a) {
    if (seen_[a] == 0.0F) continue;
    for (uint32_t b = 0; b < num_others; ++b) {
      if (seen_of_other_[b] == 0.0F) continue;
      const float common = common_[a * num_others + b];
      const float apart = seen_[a] + seen_of_other_[b] - 2.0F * common;
      votes[a].push_back(
          {first + b, weight_of_common(a, b) * common - views_.disagreement_ * apart});
    }
  }
}

}  // namespace s3lam
