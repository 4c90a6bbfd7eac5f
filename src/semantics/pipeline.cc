#include "s3lam/semantics/pipeline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 2> kInstanceNames = {"iou", "consensus"};

std::vector<Cluster> FindClusters(const MaskObservations& observations,
                                  const ClassDistributions& distributions,
                                  const ClassTable& class_table, const LiftOptions& options) {
  if (options.instances == InstanceMethod::kIou) {
    return ClusterByClassAndInstance(observations, TrackInstances(observations, options.tracking),
                                     distributions);
  }
  return ClusterByInstance(observations,
                           ClusterByConsensus(observations, options.consensus, options.num_threads),
                           distributions, class_table);
}

std::vector<int> CountMaskObservations(const MaskObservations& observations) {
  std::vector<int> counts;
  for (size_t row = 0; row < observations.points.size(); ++row) {
    int count = 0;
    for (const PointObservation& o : observations.ObservationsOf(row)) {
      count += o.segment != kVoidSegment && !o.predicted ? 1 : 0;
    }
    counts.push_back(count);
  }
  return counts;
}

/// Class of a row: its cluster's, or the most likely one.
int ClassOfRow(const SemanticMap& map, size_t row) {
  const ClusterId cluster = map.cluster_of_point[row];
  return cluster.valid() ? map.clusters.at(cluster).class_index
                         : MostLikelyClass(map.distributions, row);
}

void ReportCertainty(const SemanticMap& map, LiftReport& report) {
  for (Eigen::Index row = 0; row < map.distributions.rows(); ++row) {
    float best = 0.0F;
    float second = 0.0F;
    for (const float p : map.distributions.row(row)) {
      second = std::max(second, std::min(best, p));
      best = std::max(best, p);
    }
    const auto p = map.distributions.row(row).array();
    constexpr float kLeast = std::numeric_limits<float>::min();  // 0 log 0 is 0.
    report.mean_entropy_bits -=
        static_cast<double>((p * p.max(kLeast).log()).sum()) / std::numbers::ln2;
    report.mean_margin += static_cast<double>(best - second);
  }
  const auto n = static_cast<double>(std::max<Eigen::Index>(1, map.distributions.rows()));
  report.mean_entropy_bits /= n;
  report.mean_margin /= n;
}

void FillReport(const Reconstruction& reconstruction, const MaskObservations& observations,
                const SemanticMap& map, LiftReport& report) {
  report.num_images = reconstruction.images.size();
  report.num_images_with_mask = observations.frames.size();
  report.num_images_without_mask = observations.num_images_without_mask;
  report.num_images_with_bad_mask = observations.num_images_with_bad_mask;
  report.num_scaled_masks = observations.num_scaled_masks;
  report.num_points = reconstruction.points.size();
  report.num_points_labelled = map.points.size();
  report.num_segments = observations.segments.size();
  for (size_t row = 0; row < map.points.size(); ++row) {
    ++report.classes[ClassOfRow(map, row)].points;
    report.num_points_clustered += map.cluster_of_point[row].valid() ? 1 : 0;
  }
  for (const auto& [id, cluster] : map.clusters) ++report.classes[cluster.class_index].clusters;
  for (const auto& [id, plane] : map.planes) {
    ClassCounts& counts = report.classes[plane.class_index];
    ++counts.planes;
    counts.plane_inliers += plane.inliers.size();
  }
  ReportCertainty(map, report);
}

constexpr Rgb kUnlabelled = {90, 90, 90};

/// Well spread colours: hues by the golden ratio, alternating brightness.
Rgb ClusterColor(ClusterId id) {
  const double hue = 6.0 * std::fmod(0.618033988749895 * (id.value() + 1), 1.0);
  const double value = id.value() % 2 == 0 ? 1.0 : 0.75;
  Rgb color{};
  for (size_t i = 0; i < 3; ++i) {
    const double k = std::fmod(5.0 - 2.0 * static_cast<double>(i) + hue, 6.0);
    const double c = value * (1.0 - 0.8 * std::clamp(std::min(k, 4.0 - k), 0.0, 1.0));
    color[i] = static_cast<uint8_t>(std::lround(255.0 * c));
  }
  return color;
}

Reconstruction GrayCopy(const Reconstruction& reconstruction) {
  Reconstruction copy = reconstruction;
  for (auto& [id, point] : copy.points) point.color = kUnlabelled;
  return copy;
}

}  // namespace

void LiftOptions::Visit(OptionVisitor& v) {
  v.Group("lookup", lookup, "Looking keypoints up in the masks.");
  v.Group("fusion", fusion, "Fusing a point's observations into one distribution.");
  v.Choice("instances", instances, kInstanceNames,
           "How the segments of the frames are associated to objects.");
  v.Group("tracking", tracking, "Of instances = iou.");
  v.Group("consensus", consensus, "Of instances = consensus.");
  v.Group("clusters", clusters, "Clusters of points.");
  v.Group("planes", planes, "Planes of the clusters.");
}

LiftResult LiftSemantics(const Reconstruction& reconstruction, const ClassTable& class_table,
                         const MaskProvider& masks, const PointDescriptors& descriptors,
                         const LiftOptions& options) {
  LiftResult result;
  SemanticMap& map = result.map;
  StepTimes& times = result.report.step_times;
  map.class_table = class_table;
  map.model_fingerprint = FingerprintOfModel(reconstruction);

  MaskObservations observations;
  {
    const ScopedStep step(times, "masks");
    observations = LookUpMasks(reconstruction, masks, options.lookup,
                               options.instances == InstanceMethod::kIou, options.num_threads);
    if (observations.frames.empty() && observations.num_images_with_bad_mask > 0) {
      ThrowInputError(
          "all {} masks of the model's images are unusable: without --lenient, the "
          "first one's reason is said",
          observations.num_images_with_bad_mask);
    }
    if (observations.frames.empty()) {
      ThrowInputError(
          "none of the model's {} images has a mask: a mask is named as its image (.png, .npy, "
          ".npz)",
          reconstruction.images.size());
    }
  }
  {
    const ScopedStep step(times, "fusion");
    map.points = observations.points;
    map.num_mask_observations = CountMaskObservations(observations);
    const int num_classes = class_table.size();
    result.confusion = options.confusion;
    if (!result.confusion && options.fusion.confusion == ConfusionSource::kEstimated) {
      result.confusion = EstimateConfusion(observations, num_classes, options.fusion);
    }
    map.distributions = FuseLabels(observations, num_classes, options.fusion,
                                   result.confusion ? &*result.confusion : nullptr);
  }
  {
    const ScopedStep step(times, "instances");
    std::vector<Cluster> clusters =
        FindClusters(observations, map.distributions, class_table, options);
    result.report.num_merges =
        options.clusters.merge == MergeMethod::kReprojection
            ? MergeByReprojection(observations, options.clusters, clusters)
            : MergeClusters(reconstruction, descriptors, MedianDepth(reconstruction),
                            options.clusters, clusters);
    if (options.instances == InstanceMethod::kConsensus) {
      result.report.num_merges +=
          MergeSeenApart(reconstruction, class_table, options.clusters, clusters);
    }
    AddClusters(reconstruction, std::move(clusters), options.clusters, map);
  }
  {
    const ScopedStep step(times, "planes");
    result.report.keypoint_sigma_px = EstimateKeypointSigma(reconstruction);
    FitPlanes(reconstruction, result.report.keypoint_sigma_px, options.planes, options.seed,
              options.num_threads, map);
  }
  FillReport(reconstruction, observations, map, result.report);
  return result;
}

Reconstruction ColorByClass(const Reconstruction& reconstruction, const SemanticMap& map) {
  Reconstruction copy = GrayCopy(reconstruction);
  for (size_t row = 0; row < map.points.size(); ++row) {
    copy.points.at(map.points[row]).color =
        map.class_table.classes[static_cast<size_t>(ClassOfRow(map, row))].color;
  }
  return copy;
}

Reconstruction ColorByCluster(const Reconstruction& reconstruction, const SemanticMap& map) {
  Reconstruction copy = GrayCopy(reconstruction);
  for (const auto& [id, cluster] : map.clusters) {
    for (const PointId point : cluster.points) copy.points.at(point).color = ClusterColor(id);
  }
  return copy;
}

}  // namespace s3lam
