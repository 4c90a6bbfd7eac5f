#pragma once

#include "s3lam/report/drawing.h"
#include "s3lam/report/frame_trust.h"

namespace s3lam::report {

/// Light blue, vermilion, nearly black: apart in hue and in lightness, so that colour-blind people
/// and printers can tell them too.
Rgb StateColor(FrameState state);

/// "good", "little trusted", "not localised".
const char* StateTitle(FrameState state);

/// The frames of the sequence from left to right: the trust in each, below it the state of its
/// stretch, numbers and a legend. Of many frames that share a column of pixels, the worst is drawn.
Drawing DrawTrustStrip(const FrameTrust& trust);

}  // namespace s3lam::report
