#pragma once

#include <filesystem>

#include "class_resolver.h"
#include "coco_panoptic.h"
#include "s3lam/scene/panoptic_frame.h"

namespace s3lam {

// One decoder per MaskFormat; see there for what each reads. All throw InputError naming the file.

PanopticFrame DecodeCoco(const std::filesystem::path& path, const CocoAnnotation& annotation);
PanopticFrame DecodeKittiStep(const std::filesystem::path& path, const ClassResolver& classes);
/// Labels times `divisor` plus an instance; with
/// `plain_below_divisor`, values below the divisor are labels alone (Cityscapes).
PanopticFrame DecodeDivided(const std::filesystem::path& path, const ClassResolver& classes,
                            int divisor, bool plain_below_divisor);
PanopticFrame DecodeScanNet(const std::filesystem::path& labels,
                            const std::filesystem::path& instances, const ClassResolver& classes);
PanopticFrame DecodeSegments(const std::filesystem::path& path, const ClassResolver& classes);
PanopticFrame DecodeLabels(const std::filesystem::path& path, const ClassResolver& classes);
PanopticFrame DecodeProbabilities(const std::filesystem::path& path, const ClassResolver& classes);

}  // namespace s3lam
