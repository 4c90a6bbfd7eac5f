#include "s3lam/refine/bending_planes.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "s3lam/base/statistics.h"

namespace s3lam {
namespace {

/// Direction in which points spread most, within a plane.
Eigen::Vector3d LongAxis(const std::vector<int>& indices, const AnchoredPlane& plane,
                         const std::vector<Eigen::Vector3d>& points) {
  const Eigen::Vector3d normal = plane.parameters.head<3>();
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const int i : indices) {
    Eigen::Vector3d arm = points[i] - plane.anchor_in_world;
    arm -= normal.dot(arm) * normal;
    scatter += arm * arm.transpose();
  }
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors().col(2);
}

/// Median of the values of points, of those in use: others have none; zero without any.
double MedianInUse(const std::vector<double>& values, const std::vector<int>& points) {
  std::vector<double> chosen;
  for (const int i : points) {
    if (values[i] > 0.0) chosen.push_back(values[i]);
  }
  return Median(std::move(chosen));
}

class Cutter {
 public:
  Cutter(const BendingOptions& options, const ClassTable& classes, double sigma_px,
         PlaneModel& model, BundleProblem& problem)
      : options_(options),
        classes_(classes),
        sigma_px_(sigma_px),
        model_(model),
        problem_(problem),
        depths_(DepthsOfPoints(problem)),
        pixel_sizes_(PixelSizes(problem)) {}

  void Run() {
    const size_t count = model_.planes.size();
    for (size_t k = 0; k < count; ++k) {
      const std::string& name = classes_.classes.at(model_.planes[k].class_index).name;
      const auto& bending = options_.classes;
      if (std::find(bending.begin(), bending.end(), name) != bending.end()) Cut(k);
    }
  }

 private:
  void Cut(size_t k) {
    const std::vector<int> candidates = model_.planes[k].candidates;
    const double pixel = MedianInUse(pixel_sizes_, candidates);
    const double length = options_.length_depths * MedianInUse(depths_, candidates);
    if (!(length > 0.0)) return;
    const AnchoredPlane whole = problem_.planes[k];
    const Eigen::Vector3d axis = LongAxis(candidates, whole, problem_.points);
    std::vector<double> along;
    for (const int i : candidates) {
      along.push_back(axis.dot(problem_.points[i] - whole.anchor_in_world));
    }
    // A few far points may lie anywhere: the length that matters holds 98 % of the points.
    std::vector<double> sorted = along;
    std::sort(sorted.begin(), sorted.end());
    const double low = sorted[sorted.size() / 100];
    const double high = sorted[sorted.size() - 1 - sorted.size() / 100];
    const auto pieces = static_cast<size_t>(std::ceil((high - low) / length));
    if (pieces < 2) return;
    std::vector<std::vector<int>> points(pieces);
    for (size_t i = 0; i < candidates.size(); ++i) {
      const double place = (along[i] - low) / (high - low) * static_cast<double>(pieces);
      points[static_cast<size_t>(std::clamp(place, 0.0, static_cast<double>(pieces) - 0.5))]
          .push_back(candidates[i]);
    }
    const Plane plane = whole.PlaneInWorld();
    int previous = -1;
    for (size_t p = 0; p < pieces; ++p) {
      if (points[p].empty()) {
        previous = -1;
        continue;
      }
      const int index = AddPiece(k, p == 0, plane, std::move(points[p]));
      const double boundary =
          low + (high - low) * static_cast<double>(p) / static_cast<double>(pieces);
      if (previous >= 0) {
        Tie(previous, index, plane.Project(whole.anchor_in_world + boundary * axis), pixel);
      }
      previous = index;
    }
  }

  /// The first piece takes the place of the whole plane.
  int AddPiece(size_t whole, bool first, const Plane& plane, std::vector<int> points) {
    Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
    for (const int i : points) centroid += problem_.points[i] / static_cast<double>(points.size());
    PlaneState state = model_.planes[whole];
    state.candidates = std::move(points);
    state.is_piece = true;
    if (first) {
      model_.planes[whole] = std::move(state);
      problem_.planes[whole] = AnchoredPlane::FromPlane(plane, centroid);
      return static_cast<int>(whole);
    }
    state.id = PlaneId(model_.next_id++);
    model_.planes.push_back(std::move(state));
    problem_.planes.push_back(AnchoredPlane::FromPlane(plane, centroid));
    return static_cast<int>(problem_.planes.size()) - 1;
  }

  void Tie(int a, int b, const Eigen::Vector3d& place, double pixel) {
    RelationTerm term;
    term.relation = PlaneRelation::kMeeting;
    term.plane_a = a;
    term.plane_b = b;
    term.sigma_rad = options_.max_bend_deg * std::numbers::pi / 180.0;
    term.sigma_offset = options_.max_step_sigma * sigma_px_ * pixel;
    term.place_in_world = place;
    problem_.relations.push_back(term);
  }

  const BendingOptions& options_;
  const ClassTable& classes_;
  double sigma_px_;
  PlaneModel& model_;
  BundleProblem& problem_;
  std::vector<double> depths_;
  std::vector<double> pixel_sizes_;
};

}  // namespace

void BendingOptions::Visit(OptionVisitor& v) {
  v.Value("classes", classes, "surfaces that are flat nearby and bend over a distance");
  v.Value("length_depths", length_depths,
          "length of a piece, in median distances from which the surface is seen", 1e-3, 1e9);
  v.Value("max_bend_deg", max_bend_deg, "sigma of the bend between two pieces [deg]", 1e-6, 90.0);
  v.Value("max_step_sigma", max_step_sigma,
          "sigma of the step between two pieces [px at that distance]", 1e-6, 1e6);
}

void CutBendingPlanes(const BendingOptions& options, const ClassTable& classes, double sigma_px,
                      PlaneModel& model, BundleProblem& problem) {
  Cutter(options, classes, sigma_px, model, problem).Run();
}

}  // namespace s3lam
