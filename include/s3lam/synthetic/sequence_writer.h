#pragma once

#include <filesystem>
#include <string>

#include "s3lam/base/options.h"
#include "s3lam/synthetic/panoptic.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam {

struct SequenceWriterOptions {
  std::string image_format = "jpg";  // "jpg" (quality 95) or "png".
  MaskCorruptionOptions masks;       // Of the noisy masks.
  void Visit(OptionVisitor& v) {
    v.Value("image_format", image_format, "jpg (quality 95) or png");
    v.Group("masks", masks, "how the noisy masks are corrupted");
  }
};

/// What was written, and how corrupted the noisy masks came out.
struct SequenceWriterReport {
  int num_frames = 0;
  int num_objects = 0;
  int num_planar_objects = 0;
  double path_length_m = 0.0;
  double segments_clean = 0.0;  // Per frame.
  double segments_noisy = 0.0;
  double missed_share = 0.0;       // Of the things seen.
  double wrong_class_share = 0.0;  // Of the segments: with a part of a wrong class.
  double setup_seconds = 0.0;
  double render_seconds = 0.0;  // Rendering and writing.
};

/// Writes a scene as a sequence, in the layout of real data:
///   TUM RGB-D         rgb.txt, rgb/, camera.json, panoptic_clean/, panoptic_noisy/ with their
///                     .json (COCO panoptic)
///   KITTI odometry    image_0/, calib.txt (principal point - 0.5, as KITTI counts), times.txt,
///                     panoptic/, panoptic_noisy/ (KITTI-STEP)
/// and for both groundtruth.txt (TUM, world_from_camera), truth_clean.json and truth_noisy.json
/// (frames[mask][segment id] -> {object, category_id, objects: {id: pixels}, corruption?}; missed)
/// and objects.json (class, plane n . x + d = 0 in metres, outline). `directory` must exist and be
/// empty. The files are the same for any number of threads. Throws UsageError for an unknown
/// image format, std::runtime_error if writing fails.
SequenceWriterReport WriteSequence(const Scene& scene, const SequenceWriterOptions& options,
                                   const std::filesystem::path& directory, int num_threads);

}  // namespace s3lam
