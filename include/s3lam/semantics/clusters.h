#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/scene/descriptor.h"
#include "s3lam/scene/semantic_map.h"
#include "s3lam/semantics/instances.h"
#include "s3lam/semantics/label_fusion.h"
#include "s3lam/semantics/mask_observations.h"

namespace s3lam {

/// How clusters that show one object twice are recognised: both are the paper's.
enum class MergeMethod { kDescriptors, kReprojection };

struct ClusterOptions {
  int min_points = 5;
  MergeMethod merge = MergeMethod::kDescriptors;
  double merge_distance = 0.1;
  double min_matched_descriptors = 0.8;
  int max_descriptor_distance = 50;
  double min_reprojected = 0.8;
  double min_in_space = 0.5;

  void Visit(OptionVisitor& v);
};

/// Groups the points by class and instance (the paper): a point's class is the most likely one of
/// its distribution, its instance the one most of its observations of that class vote for.
std::vector<Cluster> ClusterByClassAndInstance(const MaskObservations& observations,
                                               const InstanceAssignment& instances,
                                               const ClassDistributions& distributions);

/// Groups the points by instance alone: the one most of a point's observations vote for. A
/// cluster's class is the one its points' distributions agree on (greatest mean), whatever a single
/// point says. Instances of one class of stuff make one cluster.
std::vector<Cluster> ClusterByInstance(const MaskObservations& observations,
                                       const InstanceAssignment& instances,
                                       const ClassDistributions& distributions,
                                       const ClassTable& class_table);

/// Merges clusters of one class that show one object twice (the paper): their centroids are closer
/// than merge_distance * `median_depth`, and more than min_matched_descriptors of the smaller one's
/// descriptors have a like in the other. Returns the number of merges.
int MergeClusters(const Reconstruction& reconstruction, const PointDescriptors& descriptors,
                  double median_depth, const ClusterOptions& options,
                  std::vector<Cluster>& clusters);

/// The same by where the points of one cluster fall in the frames that show the other: more than
/// min_reprojected of their pixels (predicted ones included, see VisibilityPredictor) lie in its
/// segments.
int MergeByReprojection(const MaskObservations& observations, const ClusterOptions& options,
                        std::vector<Cluster>& clusters);

/// Merges clusters of one class of things that no image shows both of and of which more than
/// min_in_space of the points of one lie in the space of the other: an object that was seen from
/// two sides, with nothing in between, has no point in common for anything else to go by.
int MergeSeenApart(const Reconstruction& reconstruction, const ClassTable& class_table,
                   const ClusterOptions& options, std::vector<Cluster>& clusters);

/// Adds points and segments of one cluster to another.
void MergeInto(const Cluster& from, Cluster& into);

/// Drops clusters below min_points, computes centroids, numbers the rest from 0 and enters them
/// into the map (points and distributions of which are already there).
void AddClusters(const Reconstruction& reconstruction, std::vector<Cluster> clusters,
                 const ClusterOptions& options, SemanticMap& map);

}  // namespace s3lam
