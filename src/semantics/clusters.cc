#include "s3lam/semantics/clusters.h"

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "merge_pairs.h"

namespace s3lam {
namespace {

using Key = std::pair<int, int32_t>;  // Class index and instance.

constexpr std::array<std::string_view, 2> kMergeNames = {"descriptors", "reprojection"};

/// The instance with most votes; the lower one of equals; kNoInstance without any.
int32_t MostVoted(const std::map<int32_t, int>& votes) {
  int32_t best = kNoInstance;
  int most = 0;
  for (const auto& [instance, count] : votes) {
    if (count <= most) continue;
    most = count;
    best = instance;
  }
  return best;
}

/// Votes of a row's observations for instances; those near a border count only if there are no
/// others. A negative `class_index` admits all classes.
int32_t InstanceOfRow(const MaskObservations& observations, const InstanceAssignment& instances,
                      size_t row, int class_index) {
  std::map<int32_t, int> inside;
  std::map<int32_t, int> all;
  for (const PointObservation& o : observations.ObservationsOf(row)) {
    if (o.segment == kVoidSegment || o.predicted) continue;
    const auto s = static_cast<size_t>(o.segment);
    const int32_t instance = instances.instance_of_segment[s];
    if (instance == kNoInstance) continue;
    if (class_index >= 0 && observations.segments[s].label.class_index != class_index) continue;
    ++all[instance];
    if (!o.near_border) ++inside[instance];
  }
  return MostVoted(inside.empty() ? all : inside);
}

/// Clusters by key, each with its points and segments.
std::vector<Cluster> CollectClusters(const MaskObservations& observations,
                                     const std::vector<std::optional<Key>>& key_of_row,
                                     const std::vector<std::optional<Key>>& key_of_segment) {
  std::map<Key, Cluster> clusters;
  for (size_t row = 0; row < key_of_row.size(); ++row) {
    if (!key_of_row[row]) continue;
    Cluster& cluster = clusters[*key_of_row[row]];
    cluster.class_index = key_of_row[row]->first;
    cluster.points.push_back(observations.points[row]);
  }
  for (size_t s = 0; s < key_of_segment.size(); ++s) {
    if (!key_of_segment[s]) continue;
    const auto it = clusters.find(*key_of_segment[s]);
    if (it != clusters.end()) it->second.segments.push_back(observations.segments[s].ref);
  }
  std::vector<Cluster> result;
  for (auto& [key, cluster] : clusters) {
    std::sort(cluster.segments.begin(), cluster.segments.end());
    result.push_back(std::move(cluster));
  }
  return result;
}

/// The class of every instance, from the sum of its points' distributions. Stuff has no instances:
/// those of one such class share the lowest's key.
std::map<int32_t, Key> KeysOfInstances(const std::map<int32_t, Eigen::VectorXd>& sums,
                                       const ClassTable& class_table) {
  std::map<int32_t, Key> keys;
  std::map<int, int32_t> first_of_stuff;
  for (const auto& [instance, sum] : sums) {
    int class_index = 0;
    sum.maxCoeff(&class_index);
    const bool is_thing = class_table.classes[static_cast<size_t>(class_index)].is_thing;
    const int32_t first =
        is_thing ? instance : first_of_stuff.emplace(class_index, instance).first->second;
    keys[instance] = {class_index, first};
  }
  return keys;
}

Eigen::Vector3d Centroid(const Reconstruction& reconstruction, const std::vector<PointId>& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const PointId id : points) sum += reconstruction.points.at(id).xyz;
  return sum / static_cast<double>(points.size());
}

std::vector<const BinaryDescriptor*> DescriptorsOf(const Cluster& cluster,
                                                   const PointDescriptors& descriptors) {
  std::vector<const BinaryDescriptor*> result;
  for (const PointId id : cluster.points) {
    const auto it = descriptors.find(id);
    if (it != descriptors.end()) result.push_back(&it->second);
  }
  return result;
}

/// Share of the smaller cluster's descriptors that have a like in the other.
double MatchedShare(const Cluster& a, const Cluster& b, const PointDescriptors& descriptors,
                    int max_distance) {
  auto few = DescriptorsOf(a, descriptors);
  auto many = DescriptorsOf(b, descriptors);
  if (few.size() > many.size()) std::swap(few, many);
  if (few.empty()) return 0.0;
  const auto matched = std::count_if(few.begin(), few.end(), [&](const auto* d) {
    return std::any_of(many.begin(), many.end(), [&](const auto* other) {
      return HammingDistance(*d, *other) <= max_distance;
    });
  });
  return static_cast<double>(matched) / static_cast<double>(few.size());
}

template <typename T>
void MergeSorted(const std::vector<T>& from, std::vector<T>& into) {
  std::vector<T> all;
  std::set_union(into.begin(), into.end(), from.begin(), from.end(), std::back_inserter(all));
  into = std::move(all);
}

}  // namespace

void ClusterOptions::Visit(OptionVisitor& v) {
  v.Value("min_points", min_points, "Smaller clusters are dropped.", 1);
  v.Choice("merge", merge, kMergeNames,
           "How clusters that show one object twice are recognised: by the descriptors of their "
           "points, or by the segments their points fall into.");
  v.Value("merge_distance", merge_distance,
          "Clusters of one object have centroids closer than this [median depths].", 0.0);
  v.Value("min_matched_descriptors", min_matched_descriptors,
          "... and more than this share of their descriptors in common.", 0.0, 1.0);
  v.Value("max_descriptor_distance", max_descriptor_distance,
          "Largest Hamming distance of matching descriptors [bits].", 0, 256);
  v.Value("min_reprojected", min_reprojected,
          "With merge = reprojection, more than this share of the points of one cluster fall into "
          "segments of the other.",
          0.0, 1.0);
  v.Value("min_in_space", min_in_space,
          "With instances = consensus, objects of one class that no image shows both of are one "
          "where more than this share of the points of one lie within the other; 1: never.",
          0.0, 1.0);
}

std::vector<Cluster> ClusterByClassAndInstance(const MaskObservations& observations,
                                               const InstanceAssignment& instances,
                                               const ClassDistributions& distributions) {
  std::vector<std::optional<Key>> key_of_row(observations.points.size());
  for (size_t row = 0; row < key_of_row.size(); ++row) {
    const int class_index = MostLikelyClass(distributions, row);
    const int32_t instance = InstanceOfRow(observations, instances, row, class_index);
    if (instance != kNoInstance) key_of_row[row] = Key{class_index, instance};
  }
  std::vector<std::optional<Key>> key_of_segment(observations.segments.size());
  for (size_t s = 0; s < key_of_segment.size(); ++s) {
    const int32_t instance = instances.instance_of_segment[s];
    if (instance == kNoInstance) continue;
    key_of_segment[s] = Key{observations.segments[s].label.class_index, instance};
  }
  return CollectClusters(observations, key_of_row, key_of_segment);
}

std::vector<Cluster> ClusterByInstance(const MaskObservations& observations,
                                       const InstanceAssignment& instances,
                                       const ClassDistributions& distributions,
                                       const ClassTable& class_table) {
  std::vector<int32_t> instance_of_row(observations.points.size());
  std::map<int32_t, Eigen::VectorXd> sums;
  for (size_t row = 0; row < instance_of_row.size(); ++row) {
    const int32_t instance = InstanceOfRow(observations, instances, row, -1);
    instance_of_row[row] = instance;
    if (instance == kNoInstance) continue;
    const Eigen::VectorXd p =
        distributions.row(static_cast<Eigen::Index>(row)).cast<double>().transpose();
    const auto [it, is_new] = sums.emplace(instance, p);
    if (!is_new) it->second += p;
  }
  const std::map<int32_t, Key> keys = KeysOfInstances(sums, class_table);
  std::vector<std::optional<Key>> key_of_row(observations.points.size());
  for (size_t row = 0; row < key_of_row.size(); ++row) {
    if (instance_of_row[row] != kNoInstance) key_of_row[row] = keys.at(instance_of_row[row]);
  }
  std::vector<std::optional<Key>> key_of_segment(observations.segments.size());
  for (size_t s = 0; s < key_of_segment.size(); ++s) {
    const auto it = keys.find(instances.instance_of_segment[s]);
    if (it != keys.end()) key_of_segment[s] = it->second;
  }
  return CollectClusters(observations, key_of_row, key_of_segment);
}

void MergeInto(const Cluster& from, Cluster& into) {
  MergeSorted(from.points, into.points);
  MergeSorted(from.segments, into.segments);
}

int MergeClusters(const Reconstruction& reconstruction, const PointDescriptors& descriptors,
                  double median_depth, const ClusterOptions& options,
                  std::vector<Cluster>& clusters) {
  const double max_distance = options.merge_distance * median_depth;
  const auto find_centroid = [&](Cluster& cluster) {
    cluster.centroid_in_world = Centroid(reconstruction, cluster.points);
  };
  for (Cluster& cluster : clusters) find_centroid(cluster);
  const auto same_object = [&](const Cluster& a, const Cluster& b) {
    return (a.centroid_in_world - b.centroid_in_world).norm() < max_distance &&
           MatchedShare(a, b, descriptors, options.max_descriptor_distance) >
               options.min_matched_descriptors;
  };
  return MergePairs(clusters, same_object, find_centroid);
}

void AddClusters(const Reconstruction& reconstruction, std::vector<Cluster> clusters,
                 const ClusterOptions& options, SemanticMap& map) {
  map.cluster_of_point.assign(map.points.size(), kInvalidClusterId);
  for (Cluster& cluster : clusters) {
    if (cluster.points.size() < static_cast<size_t>(options.min_points)) continue;
    cluster.id = ClusterId(static_cast<uint32_t>(map.clusters.size()));
    cluster.centroid_in_world = Centroid(reconstruction, cluster.points);
    for (const PointId id : cluster.points) {
      const auto row = std::lower_bound(map.points.begin(), map.points.end(), id);
      map.cluster_of_point[static_cast<size_t>(row - map.points.begin())] = cluster.id;
    }
    map.clusters.emplace(cluster.id, std::move(cluster));
  }
}

}  // namespace s3lam
