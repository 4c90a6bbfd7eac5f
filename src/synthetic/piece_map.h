#pragma once

#include <opencv2/core/mat.hpp>
#include <vector>

#include "s3lam/synthetic/panoptic.h"

namespace s3lam::synthetic {

/// Streams of a scene's seed that masks draw from.
inline constexpr uint64_t kIdStream = 201;
inline constexpr uint64_t kCorruptionStream = 202;

/// An object or a part of one, on its way into a segment.
struct Piece {
  int object = 0;
  int class_id = -1;  // -1: void.
  bool is_thing = false;
  int group = 0;  // Things with the same class and group make one segment.
  double score = 0.99;
  std::vector<CorruptionNote> notes;
};

/// Index of the piece at every pixel (32-bit signed).
struct PieceMap {
  cv::Mat image;
  std::vector<Piece> pieces;
};

PieceMap MakePieces(const Scene& scene, const cv::Mat& labels);

/// Joins pieces into segments and gives these their ids; `missed` is left empty.
SyntheticPanoptic AssemblePanoptic(const Scene& scene, int frame, const PieceMap& map,
                                   const cv::Mat& clean_labels);

}  // namespace s3lam::synthetic
