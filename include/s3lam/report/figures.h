#pragma once

#include <vector>

#include "s3lam/report/frame_trust.h"
#include "s3lam/report/pipeline.h"
#include "s3lam/report/tables.h"

namespace s3lam::report {

/// How far the frames are to be trusted; nothing if that is unknown.
void AddTrustFigure(const FrameTrust& trust, std::vector<Figure>& figures);

/// Trajectories against the truth from above and from the side, errors along time.
void AddTrajectoryFigures(const RunFolder& run, const Measures& measures,
                          std::vector<Figure>& figures);

/// Histograms of reprojection errors and of distances from planes.
void AddResidualFigures(const Options& options, const RunFolder& run, const Measures& measures,
                        std::vector<Figure>& figures);

/// The map of each arm from the top, at three quarters and from the side, in class colours.
void AddMapFigures(const Options& options, const RunFolder& run, const Measures& measures,
                   std::vector<Figure>& figures);

/// Keyframes of the last arm with keypoints in class colour and normals of planes. Without
/// `image_directory` the one that the run noted is tried; what is not there is said in `missing`.
void AddKeyframeFigures(const Options& options, const RunFolder& run,
                        const std::filesystem::path& image_directory, std::vector<Figure>& figures,
                        std::vector<std::string>& missing);

}  // namespace s3lam::report
