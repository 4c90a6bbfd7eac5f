#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/scene/panoptic_frame.h"
#include "s3lam/scene/reconstruction.h"
#include "s3lam/scene/semantic_map.h"
#include "s3lam/semantics/visibility.h"

namespace s3lam {

/// Yields the panoptic segmentation of an image, or nothing if there is none. Called once per image
/// and from several threads at once; throws InputError for a mask that cannot be used.
using MaskProvider = std::function<std::optional<PanopticFrame>(const Image&)>;

/// A segment of one mask.
struct SegmentNode {
  SegmentRef ref;
  uint32_t frame = 0;  // Index into MaskObservations::frames.
  PanopticSegment label;
  std::vector<uint32_t> points;  // Rows seen in it, ascending.
};

inline constexpr int32_t kVoidSegment = -1;

/// What a probability volume says of one pixel: the likeliest classes, and the rest evenly on the
/// others. (A volume has 133 or 150 classes, nearly all of which have next to nothing.)
struct PixelDistribution {
  static constexpr size_t kMaxClasses = 8;
  std::array<uint16_t, kMaxClasses> classes{};
  std::array<float, kMaxClasses> probabilities{};
  uint16_t num_classes = 0;     // Of those listed.
  float each_of_others = 0.0F;  // Probability of a class that is not listed.
};
PixelDistribution Compress(const std::vector<float>& distribution);

/// One point seen in one mask.
struct PointObservation {
  uint32_t frame = 0;
  int32_t segment = kVoidSegment;  // Index into MaskObservations::segments.
  bool near_border = false;        // Another segment is within LookupOptions::border_px.
  bool predicted = false;          // Not observed: see VisibilityPredictor.
  int32_t pixel = -1;              // Index into pixel_distributions; -1 without any.
};

/// How far two segments of one class, of different frames, cover each other in the image.
struct SegmentOverlap {
  uint32_t segment = 0;       // Of the later frame.
  uint32_t other = 0;         // Of the earlier frame.
  uint32_t frames_apart = 1;  // Among the frames with masks.
  double iou = 0.0;           // Intersection over union of their pixels.
};

/// What the masks say of the points of a model.
struct MaskObservations {
  std::vector<ImageId> frames;        // Images with a mask, in natural order of their names.
  std::vector<SegmentNode> segments;  // By frame, then segment id.
  std::vector<PointId> points;        // Rows: points observed in at least one segment, ascending.
  /// observations[first_observation[row]] ... observations[first_observation[row + 1] - 1] are the
  /// row's, by frame; void ones included.
  std::vector<uint32_t> first_observation;
  std::vector<PointObservation> observations;
  std::vector<PixelDistribution> pixel_distributions;
  std::vector<SegmentOverlap> overlaps;  // By segment; empty unless asked for.

  size_t num_images_without_mask = 0;
  size_t num_images_with_bad_mask = 0;  // Only if lenient.
  size_t num_scaled_masks = 0;          // Of another resolution than their image.

  [[nodiscard]] std::span<const PointObservation> ObservationsOf(size_t row) const {
    return std::span(observations)
        .subspan(first_observation[row], first_observation[row + 1] - first_observation[row]);
  }
};

struct LookupOptions {
  double border_px = 1.5;
  bool lenient = false;
  VisibilityOptions visibility;

  void Visit(OptionVisitor& v);
};

/// Throws InputError naming both sizes, and what may have gone wrong, unless the mask is a scaled
/// version of the image, to the nearest pixel.
void CheckMaskShape(const PanopticFrame& frame, const Camera& camera,
                    const std::string& image_name);

/// Looks every keypoint that belongs to a point up in its image's mask, and the predicted pixels of
/// points that the image shows but does not observe. A mask of another size but
/// the same shape is looked up by nearest pixel; one of another shape throws InputError naming both
/// sizes. Masks are decoded a few at a time, each once. With `with_overlaps`, also compares the
/// segments of each frame with those of the two frames before.
MaskObservations LookUpMasks(const Reconstruction& reconstruction, const MaskProvider& masks,
                             const LookupOptions& options, bool with_overlaps, int num_threads);

}  // namespace s3lam
