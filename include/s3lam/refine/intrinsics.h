#pragma once

#include <map>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/refine/problem_builder.h"

namespace s3lam {

/// Which camera parameters are optimised, and how far they may go.
struct IntrinsicsOptions {
  bool focal_length = false;
  bool principal_point = false;
  bool distortion = false;
  bool tangential = false;  // As well, if the distortion is refined.
  bool shared = false;
  bool check = true;
  std::vector<std::string> cameras;
  int min_images = 5;
  int min_observations = 500;
  double max_focal_change = 0.2;
  double max_principal_shift = 0.1;

  void Visit(OptionVisitor& v);
  [[nodiscard]] bool Any() const { return focal_length || principal_point || distortion; }
};

/// What became of one camera (or of several that share their parameters).
struct IntrinsicsReport {
  std::vector<CameraId> cameras;
  std::string model;  // As given.
  std::string model_after;
  bool refined = false;
  bool pinhole_is_refined = false;  // Its focal lengths and its principal point, too.
  std::string reason;               // Why not; empty where no camera was asked for.
  /// Share of the reprojection cost that a refined lens distortion would remove; 0 if not checked.
  double distortion_cost_share = 0.0;
  bool distortion_is_doubtful = false;  // That share is notable.
  /// What other focal lengths and another principal point would remove of the rest, and fx, fy, cx,
  /// cy [px] of these; empty if the share is not notable.
  double pinhole_cost_share = 0.0;
  std::vector<double> better_pinhole;
  std::vector<double> before;
  std::vector<double> after;
};

/// Cameras that are not refined, and why.
using HeldCameras = std::map<CameraId, std::string>;

/// Indices of the parameters of a camera model that the options ask for.
std::vector<int> RefinedParams(const IntrinsicsOptions& options, CameraModel model);

/// If `shared`, lets all cameras of one model and image size be one, which starts from the first
/// one's parameters; frees the parameters asked for, of which a pinhole camera gets those of
/// OPENCV's distortion if that is to be refined, of the cameras that enough images and observations
/// in use see and that are not held. Says of every camera whether and why not. Throws InputError
/// for a camera in the options that the map does not have.
std::vector<IntrinsicsReport> FreeIntrinsics(const IntrinsicsOptions& options,
                                             const HeldCameras& held, BundleMap& map);

/// Warns, and says why, where cameras were asked for and none is refined.
void WarnIfNoneIsRefined(const IntrinsicsOptions& options,
                         const std::vector<IntrinsicsReport>& reports);

/// Writes what became of the cameras' parameters into their reports.
void TellParameters(const BundleMap& map, std::vector<IntrinsicsReport>& reports);

/// Takes over what later `refined` cameras came to. Doubts about what of them was kept until then
/// are gone.
void AddRefined(const std::vector<IntrinsicsReport>& refined,
                std::vector<IntrinsicsReport>& reports);

/// How much of the reprojection cost of an adjusted map another calibration would remove, see
/// CheckCalibration, of the five cameras with the most observations in use among those that are not
/// refined, if enough images and observations see them. What a wrong calibration does to a map (it
/// bends, and its scale drifts) is not told by its residuals' size. Written into the cameras'
/// `reports`, which are appended where there are none.
void CheckKeptCameras(const IntrinsicsOptions& options, double sigma_px, const BundleMap& map,
                      std::vector<IntrinsicsReport>& reports);

/// Why the refined parameters of a camera cannot be believed, so that it is to be held; empty if
/// they can: the focal length changed by at most max_focal_change, the principal point moved by at
/// most max_principal_shift of the image's larger side, and the distortion can be inverted all
/// along the image's border if it could before.
std::string DoubtsAboutCamera(const IntrinsicsOptions& options, const Camera& before,
                              const Camera& after);

/// The cameras of the problem with free parameters that cannot be believed, and why.
HeldCameras DoubtfulCameras(const IntrinsicsOptions& options, const std::vector<Camera>& before,
                            const BundleMap& map);

}  // namespace s3lam
