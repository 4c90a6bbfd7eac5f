#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "merge_pairs.h"
#include "s3lam/semantics/clusters.h"

namespace s3lam {
namespace {

/// Where the points of clusters fall in the frames of others.
class Reprojections {
 public:
  Reprojections(const MaskObservations& observations, const std::vector<Cluster>& clusters)
      : observations_(observations) {
    for (uint32_t s = 0; s < observations.segments.size(); ++s) {
      segment_of_ref_[observations.segments[s].ref] = s;
    }
    for (const Cluster& cluster : clusters) AddFrames(cluster);
  }

  void AddFrames(const Cluster& cluster) {
    std::set<uint32_t>& frames = frames_of_[cluster.segments];
    for (const SegmentRef& ref : cluster.segments) {
      frames.insert(observations_.segments[segment_of_ref_.at(ref)].frame);
    }
  }

  /// Share of the pixels of a cluster's points, in the frames that show another cluster, that lie
  /// in that one's segments; 0 if fewer than `min_points` points have any.
  [[nodiscard]] double ShareInside(const Cluster& points_of, const Cluster& segments_of,
                                   int min_points) const {
    const std::set<uint32_t>& frames = frames_of_.at(segments_of.segments);
    int num_points = 0;
    size_t seen = 0;
    size_t inside = 0;
    for (const PointId id : points_of.points) {
      const auto row =
          std::lower_bound(observations_.points.begin(), observations_.points.end(), id);
      const size_t seen_before = seen;
      for (const PointObservation& o :
           observations_.ObservationsOf(static_cast<size_t>(row - observations_.points.begin()))) {
        if (o.segment == kVoidSegment || o.near_border || !frames.contains(o.frame)) continue;
        const SegmentRef& ref = observations_.segments[static_cast<size_t>(o.segment)].ref;
        ++seen;
        inside += std::binary_search(segments_of.segments.begin(), segments_of.segments.end(), ref)
                      ? 1
                      : 0;
      }
      num_points += seen > seen_before ? 1 : 0;
    }
    return num_points >= min_points ? static_cast<double>(inside) / static_cast<double>(seen) : 0.0;
  }

 private:
  const MaskObservations& observations_;
  std::map<SegmentRef, uint32_t> segment_of_ref_;
  std::map<std::vector<SegmentRef>, std::set<uint32_t>> frames_of_;  // By the cluster's segments.
};

}  // namespace

int MergeByReprojection(const MaskObservations& observations, const ClusterOptions& options,
                        std::vector<Cluster>& clusters) {
  Reprojections reprojections(observations, clusters);
  const auto same_object = [&](const Cluster& a, const Cluster& b) {
    return std::max(reprojections.ShareInside(a, b, options.min_points),
                    reprojections.ShareInside(b, a, options.min_points)) > options.min_reprojected;
  };
  return MergePairs(clusters, same_object,
                    [&](const Cluster& grown) { reprojections.AddFrames(grown); });
}

}  // namespace s3lam
