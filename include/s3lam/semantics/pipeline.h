#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "s3lam/base/options.h"
#include "s3lam/base/timer.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"
#include "s3lam/semantics/clusters.h"
#include "s3lam/semantics/instances.h"
#include "s3lam/semantics/label_fusion.h"
#include "s3lam/semantics/mask_observations.h"
#include "s3lam/semantics/plane_fitting.h"

namespace s3lam {

enum class InstanceMethod { kIou, kConsensus };

struct LiftOptions {
  LookupOptions lookup;
  FusionOptions fusion;
  InstanceMethod instances = InstanceMethod::kConsensus;
  TrackingOptions tracking;
  ConsensusOptions consensus;
  ClusterOptions clusters;
  PlaneFittingOptions planes;
  int num_threads = 0;  // 0: all. From the command line, as is the seed.
  uint64_t seed = 0;
  std::optional<ConfusionMatrix> confusion;  // Given, not estimated; from the command line as well.

  void Visit(OptionVisitor& v);
};

struct ClassCounts {
  size_t points = 0;  // By most likely class, in a cluster or not.
  size_t clusters = 0;
  size_t planes = 0;
  size_t plane_inliers = 0;
};

struct LiftReport {
  size_t num_images = 0;
  size_t num_images_with_mask = 0;
  size_t num_images_without_mask = 0;
  size_t num_images_with_bad_mask = 0;
  size_t num_scaled_masks = 0;
  size_t num_points = 0;
  size_t num_points_labelled = 0;
  size_t num_points_clustered = 0;
  size_t num_segments = 0;
  int num_merges = 0;
  double keypoint_sigma_px = 0.0;
  double mean_entropy_bits = 0.0;      // Of the points' distributions.
  double mean_margin = 0.0;            // Probability of the best class less that of the second.
  std::map<int, ClassCounts> classes;  // By class index, those that occur.
  StepTimes step_times;
};

struct LiftResult {
  SemanticMap map;
  LiftReport report;
  std::optional<ConfusionMatrix> confusion;  // The one used, given or estimated.
};

/// Stage 2: carries the masks' labels over to the points of a model, groups them into objects and
/// fits planes. `descriptors` may be empty; then no clusters are merged by them. Throws InputError
/// if no image has a mask.
LiftResult LiftSemantics(const Reconstruction& reconstruction, const ClassTable& class_table,
                         const MaskProvider& masks, const PointDescriptors& descriptors,
                         const LiftOptions& options);

/// The model with every point in the colour of its class (of its cluster if it has one); points
/// without a label are gray.
Reconstruction ColorByClass(const Reconstruction& reconstruction, const SemanticMap& map);

/// The model with every cluster in a colour of its own; points in none are gray.
Reconstruction ColorByCluster(const Reconstruction& reconstruction, const SemanticMap& map);

}  // namespace s3lam
