#pragma once

#include <functional>
#include <opencv2/core/mat.hpp>

#include "s3lam/slam/mapper.h"
#include "s3lam/slam/patch_refiner.h"

namespace s3lam {

struct SecondPassOptions {
  int rounds = 1;
  int neighbours = 30;
  PatchRefinerOptions patches;

  void Visit(OptionVisitor& v);
};

/// With the whole map at hand: every keyframe is matched against the points of all its neighbours
/// again, both ways, points that are the same merged, and what is still free triangulated.
void MatchAgain(const SecondPassOptions& options, const Mapper& mapper, Map& map);

/// Aligns every observation of a point with the one that looks most like the others; aligned ones
/// move and get their smaller sigma, observations that do not align are removed. `read_gray` gives
/// a frame's image.
PatchRefinement RefineObservations(const SecondPassOptions& options,
                                   const FeatureOptions& feature_options,
                                   const Undistorter& undistorter,
                                   const std::function<cv::Mat(size_t)>& read_gray, int num_threads,
                                   Map& map);

}  // namespace s3lam
