#pragma once

#include <optional>
#include <string_view>

#include "s3lam/scene/panoptic_frame.h"

namespace s3lam {

/// R + 256 G + 65536 B of every pixel of a PNG file of three colours of 8 bits, not interlaced:
/// what nearly all masks are. Several times faster on masks than a decoder for pictures. Empty for
/// any other file and for a defective one; those are for DecodePngMask, which says what is wrong.
std::optional<SegmentImage> DecodeColourPng(std::string_view bytes);

}  // namespace s3lam
