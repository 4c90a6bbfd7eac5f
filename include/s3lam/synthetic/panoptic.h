#pragma once

#include <cstdint>
#include <map>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/scene/panoptic_frame.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam {

/// What was done to a segment of a corrupted mask.
struct CorruptionNote {
  std::string type;  // "class", "merge", "split", "cut".
  int object = 0;    // SceneObject::id it was done to.
};

/// What a segment really shows.
struct SegmentTruth {
  int object = 0;                    // SceneObject::id with most pixels under it; 0: background.
  std::map<int, int> object_pixels;  // Pixels of the uncorrupted labels under the segment.
  std::vector<CorruptionNote> corruption;
};

/// A panoptic mask and the truth behind it.
struct SyntheticPanoptic {
  PanopticFrame frame;
  std::map<uint32_t, SegmentTruth> truth;  // By segment id.
  std::vector<int> missed;                 // Things that the mask does not have.
};

/// How bad a network's masks are. Rates are probabilities per frame; everything grows with `level`,
/// and what is corrupted at one level still is at a higher one.
struct MaskCorruptionOptions {
  double level = 0.15;       // 0: exact; 0.15: like a good network; 0.4: hardly usable.
  double missed = 0.9;       // Times level: things that are not found, in bursts of 1-3 frames.
  double wrong_class = 0.4;  // Times level: objects (parts of large ones) of a confusable class.
  double merged = 1.7;       // Times level: touching things of one class that become one.
  double split = 0.1;        // Times level: things cut in two.
  double cut = 0.2;          // Times level: stuff that loses a part to the void.
  double border_px = 4.0;    // Wandering of borders at level 0.15; grows with its square root. [px]
  void Visit(OptionVisitor& v) {
    v.Value("level", level, "0: exact masks; 0.15: like a good network; 0.4: hardly usable", 0.0,
            1.0);
    v.Value("missed", missed, "times level: rate of things not found", 0.0, 10.0);
    v.Value("wrong_class", wrong_class, "times level: rate of objects of a wrong class", 0.0, 10.0);
    v.Value("merged", merged, "times level: rate of touching things merged", 0.0, 10.0);
    v.Value("split", split, "times level: rate of things cut in two", 0.0, 10.0);
    v.Value("cut", cut, "times level: rate of stuff losing a part to the void", 0.0, 10.0);
    v.Value("border_px", border_px, "wandering of borders at level 0.15 [px]", 0.0, 100.0);
  }
};

/// The mask of a frame from its label image (RenderedFrame::labels): one segment per thing and one
/// per class of stuff, those below 100 pixels dropped. In the COCO layout ids are random, below
/// 2^24 and drawn anew for each frame; in KITTI-STEP's they are class + 256 * (instance / 256) +
/// 65536 * (instance % 256), the value of the pixel in the file. A pure function of scene, frame
/// and options.
SyntheticPanoptic MakePanoptic(const Scene& scene, int frame, const cv::Mat& labels);

/// The same with a network's errors.
SyntheticPanoptic MakeCorruptedPanoptic(const Scene& scene, int frame, const cv::Mat& labels,
                                        const MaskCorruptionOptions& options);

}  // namespace s3lam
