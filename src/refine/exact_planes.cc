#include "s3lam/refine/exact_planes.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "s3lam/base/statistics.h"
#include "s3lam/refine/projection.h"

namespace s3lam {
namespace {

/// The members' distances in units of what triangulation alone explains, as the standard deviation
/// of a normal distribution with their median.
double Scatter(const PlaneModel& model, const BundleProblem& problem, size_t k) {
  const AnchoredPlane& plane = problem.planes[k];
  const Eigen::Vector3d normal = plane.parameters.head<3>();
  std::vector<double> ratios;
  for (const int i : model.planes[k].members) {
    const double variance = normal.dot(model.covariances[i] * normal);
    const double distance =
        normal.dot(problem.points[i] - plane.anchor_in_world) + plane.parameters[3];
    ratios.push_back(std::abs(distance) / std::sqrt(std::max(variance, 1e-300)));
  }
  if (ratios.empty()) return std::numeric_limits<double>::infinity();
  return Median(std::move(ratios)) / kMedianOfAbsoluteNormal;
}

void ChoosePlanes(const ExactPlaneOptions& options, const PlaneModel& model,
                  const BundleProblem& problem, ExactPlanes& exact) {
  exact.is_exact.assign(model.planes.size(), 0);
  exact.point_is_freed.assign(problem.points.size(), 0);
  for (size_t k = 0; k < model.planes.size(); ++k) {
    const PlaneState& state = model.planes[k];
    const auto members = static_cast<double>(state.members.size());
    exact.is_exact[k] =
        state.in_use && !state.is_ground && !state.is_piece &&
        static_cast<int>(state.members.size()) >= options.min_points &&
        members >= options.min_member_share * static_cast<double>(state.candidates.size()) &&
        Scatter(model, problem, k) <= options.max_scatter;
  }
}

/// The plane of every point that has one term, on an exact plane; -1 for others.
std::vector<int> ExactPlaneOfPoint(const ExactPlanes& exact, const BundleProblem& problem) {
  std::vector<int> plane(problem.points.size(), -1);
  const auto& terms = problem.points_on_planes;
  for (size_t t = 0; t < terms.size(); ++t) {
    const int i = terms[t].point;
    const bool alone =
        (t == 0 || terms[t - 1].point != i) && (t + 1 == terms.size() || terms[t + 1].point != i);
    if (alone && !problem.IsConstantPoint(i) && exact.is_exact[terms[t].plane] != 0 &&
        exact.point_is_freed[i] == 0) {
      plane[i] = terms[t].plane;
    }
  }
  return plane;
}

}  // namespace

void ExactPlaneOptions::Visit(OptionVisitor& v) {
  v.Value("min_points", min_points, "a plane with fewer points on it keeps soft terms", 10,
          1000000);
  v.Value("min_member_share", min_member_share,
          "so does one to which a smaller part of its cluster's nearby points belongs", 0.0, 1.0);
  v.Value("max_scatter", max_scatter,
          "and one whose points scatter by more than this [standard deviations of triangulation]",
          0.1, 100.0);
  v.Value("max_point_sigma", max_point_sigma,
          "points that their observations would take farther off the plane are freed [sigma]", 1.0,
          100.0);
}

std::vector<double> StepsOffPlanes(const BundleProblem& problem, double sigma_px,
                                   const std::vector<int>& plane_of_point) {
  std::vector<Rigid3> poses;
  for (const PoseBlock& pose : problem.poses) poses.push_back(FromPoseBlock(pose.data()));
  std::vector<double> steps(problem.points.size(), 0.0);
  const auto& observations = problem.observations;
  for (size_t begin = 0, end = 0; begin < observations.size(); begin = end) {
    const int point = observations[begin].point;
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (end = begin; end < observations.size() && observations[end].point == point; ++end) {
      const BundleObservation& o = observations[end];
      const Camera& camera = problem.cameras[problem.camera_of_pose[o.pose]];
      Eigen::Vector2d pixel;
      Matrix23 by_point;
      if (plane_of_point[point] < 0 ||
          !ProjectPoint(camera.model, camera.params.data(), poses[o.pose] * problem.points[point],
                        &pixel, &by_point)) {
        continue;
      }
      const double sigma = sigma_px * o.sigma;
      const Matrix23 j = by_point * poses[o.pose].rotation.toRotationMatrix() / sigma;
      hessian.noalias() += j.transpose() * j;
      gradient.noalias() += j.transpose() * (pixel - o.pixel) / sigma;
    }
    if (hessian.isZero(0.0)) continue;
    hessian.diagonal().array() += 1e-12 * hessian.trace();
    const Eigen::Vector3d normal = problem.planes[plane_of_point[point]].parameters.head<3>();
    const Eigen::LDLT<Eigen::Matrix3d> factor(hessian);
    const double variance = normal.dot(factor.solve(normal));
    steps[point] = std::abs(normal.dot(factor.solve(gradient))) / std::sqrt(variance);
  }
  return steps;
}

void MarkExactPlanes(const ExactPlaneOptions& options, double sigma_px, const PlaneModel& model,
                     ExactPlanes& exact, BundleProblem& problem) {
  const bool first = exact.is_exact.empty();
  if (first) ChoosePlanes(options, model, problem, exact);
  std::vector<int> plane_of_point = ExactPlaneOfPoint(exact, problem);
  if (!first) {
    const std::vector<double> steps = StepsOffPlanes(problem, sigma_px, plane_of_point);
    for (size_t i = 0; i < steps.size(); ++i) {
      if (steps[i] > options.max_point_sigma) exact.point_is_freed[i] = 1;
    }
    plane_of_point = ExactPlaneOfPoint(exact, problem);
  }
  exact.num_points = 0;
  for (PointOnPlane& term : problem.points_on_planes) {
    term.is_exact = plane_of_point[term.point] == term.plane;
    exact.num_points += term.is_exact;
  }
}

}  // namespace s3lam
