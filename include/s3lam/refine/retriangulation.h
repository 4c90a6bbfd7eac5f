#pragma once

#include "s3lam/base/options.h"
#include "s3lam/refine/problem_builder.h"
#include "s3lam/scene/descriptor.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// Points and tracks mended between solves, when poses are better than those they were made with.
struct RetriangulationOptions {
  bool enabled = true;
  double min_angle_deg = 1.0;
  bool merge = true;
  int max_descriptor_distance = 50;
  double max_merge_px = 3.0;

  void Visit(OptionVisitor& v);
};

/// Triangulates points anew where less than half of their observations fit: from two of them at a
/// time, all others being asked which fit (at most max_reprojection_sigma), then from all that fit.
/// A point moves if more observations fit than are in use now, and if two of them see it from
/// directions that differ by min_angle_deg. Constant points stay. Returns how many moved;
/// SelectObservations then takes the observations in.
size_t RetriangulatePoints(const RetriangulationOptions& options, const OutlierOptions& outliers,
                           double sigma_px, BundleMap& map);

/// Makes one point of two that are the same: within max_merge_px pixels of each other as the
/// cameras see them, with descriptors at most max_descriptor_distance bits apart, in no image both,
/// and with one position at which all observations of both fit (95 %). The one with the shorter
/// track loses its observations to the other and is gone from the output. Points whose looks are
/// not known, constant ones, those that are not in use and those of different groups are left
/// alone. Returns how many were merged into others.
size_t MergePoints(const RetriangulationOptions& options, double sigma_px, BundleMap& map);

/// Fills map.looks: descriptors, and the cluster of each point as its group.
void AddLooks(const PointDescriptors& descriptors, const SemanticMap& semantics, BundleMap& map);

}  // namespace s3lam
