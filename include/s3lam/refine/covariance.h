#pragma once

#include <Eigen/Core>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/similarity3.h"
#include "s3lam/refine/bundle_solver.h"
#include "s3lam/refine/problem_builder.h"
#include "s3lam/scene/semantic_map.h"

namespace s3lam {

struct CovarianceOptions {
  bool enabled = false;
  int max_dense_rows = 4000;

  void Visit(OptionVisitor& v);
};

using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Covariances of a solved bundle, in its gauge and by its sigmas. Empty where nothing is estimated
/// (constant, or not in use).
struct BundleCovariance {
  /// Per pose: of (w, v), see PoseManifold.
  std::vector<std::optional<Matrix6d>> poses;
  /// Per plane: of the rotation of its normal along PlaneAxes [rad], and of its offset at the
  /// anchor.
  std::vector<std::optional<Eigen::Matrix3d>> planes;
};

/// Inverse of the Hessian of poses, planes and whatever else is estimated beside the points, after
/// these are eliminated (Schur complement), as Gauss and Newton approximate it at the present
/// values and with the weights of the robust losses. Up to max_dense_rows rows it is inverted as a
/// whole, beyond that factored sparsely and solved for each pose and plane. Planes without points
/// take no part. Empty if it is singular.
std::optional<BundleCovariance> ComputeCovariance(const CovarianceOptions& options,
                                                  const BundleSolverOptions& solver,
                                                  const BundleProblem& problem);

/// Covariances of what is put out, in the output's world.
struct OutputCovariance {
  bool computed = false;
  std::map<ImageId, Matrix6d> poses;          // See CenterCovariance.
  std::map<PlaneId, Eigen::Matrix3d> planes;  // See PlanarSurface::covariance.
};

/// covariance.json: poses (image_id, name, covariance: 6 x 6 by rows) and planes (id, covariance: 3
/// x 3 by rows).
nlohmann::json ToJson(const OutputCovariance& covariance, const Reconstruction& model);

/// The covariance of (rotation about the camera's axes [rad], centre in the new world [map units])
/// of a pose with that of (w, v).
Matrix6d CenterCovariance(const Matrix6d& covariance, const Rigid3& cam_from_world,
                          const Similarity3& new_from_old);

/// The covariance of a plane in PlanarSurface's form: (rotation about u, about v [rad], shift along
/// the normal at the centroid).
Eigen::Matrix3d SurfaceCovariance(const Eigen::Matrix3d& covariance, const AnchoredPlane& plane,
                                  const PlanarSurface& surface);

}  // namespace s3lam
