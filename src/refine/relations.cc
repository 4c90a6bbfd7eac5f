#include "s3lam/refine/relations.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "s3lam/base/error.h"
#include "s3lam/base/statistics.h"
#include "s3lam/robust/plane_fit.h"

namespace s3lam {
namespace {

constexpr double kRadians = std::numbers::pi / 180.0;
constexpr double kGateSigmas = 3.0;
/// Planes said to be parallel may look so far from it in a map before its adjustment [deg].
constexpr double kMaxKnownAngleDeg = 20.0;

/// What the points say of a plane, without the plane's pull on them.
struct Evidence {
  bool usable = false;
  Plane plane;
  Eigen::Vector3d centroid = Eigen::Vector3d::Zero();
  double sigma_normal = 0.0;  // [rad]
  double sigma_offset = 0.0;  // At the centroid [map units].
  double sigma_point = 0.0;   // Median over the members [map units].
  double radius = 0.0;        // Most members are so near to the centroid [map units].
  double view_range = 0.0;    // Half of the members were seen from so far or farther [map units].
};

/// Part of a plane's members that its radius takes in.
constexpr double kShareInRadius = 0.9;

/// From how far each point was seen at the most [map units].
std::vector<double> ViewRanges(const BundleProblem& problem) {
  std::vector<Eigen::Vector3d> centers;
  for (int i = 0; i < static_cast<int>(problem.poses.size()); ++i) {
    centers.push_back(problem.CenterOf(i));
  }
  std::vector<double> ranges(problem.points.size(), 0.0);
  for (const BundleObservation& o : problem.observations) {
    ranges[o.point] = std::max(ranges[o.point], (problem.points[o.point] - centers[o.pose]).norm());
  }
  return ranges;
}

class Proposer {
 public:
  Proposer(const RelationOptions& options, const PlaneSigmaOptions& sigma, double sigma_px,
           const ClassTable& classes, const PlaneModel& model, const BundleProblem& problem)
      : options_(options),
        sigma_(sigma),
        sigma_px_(sigma_px),
        classes_(classes),
        model_(model),
        problem_(problem),
        view_range_of_point_(ViewRanges(problem)) {}

  std::vector<RelationTerm> Run() {
    for (size_t k = 0; k < model_.planes.size(); ++k) evidence_.push_back(EvidenceOf(k));
    std::vector<size_t> order;  // Planes with the most points first.
    for (size_t k = 0; k < evidence_.size(); ++k) {
      if (evidence_[k].usable) order.push_back(k);
    }
    std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
      return model_.planes[a].members.size() > model_.planes[b].members.size();
    });
    std::vector<int> parallel(evidence_.size(), 0);
    std::vector<int> orthogonal(evidence_.size(), 0);
    for (size_t j = 1; j < order.size(); ++j) {
      for (size_t i = 0; i < j; ++i) Consider(order[i], order[j], parallel, orthogonal);
    }
    std::sort(terms_.begin(), terms_.end(), [](const RelationTerm& a, const RelationTerm& b) {
      return std::tuple(a.plane_a, a.plane_b, a.relation) <
             std::tuple(b.plane_a, b.plane_b, b.relation);
    });
    return terms_;
  }

 private:
  [[nodiscard]] Evidence EvidenceOf(size_t k) const {
    Evidence evidence;
    const PlaneState& state = model_.planes[k];
    if (!state.in_use || state.is_ground || state.is_piece || state.members.empty())
      return evidence;
    const auto fit = FitMembers(sigma_, sigma_px_, state, model_, problem_);
    if (!fit) return evidence;
    evidence.plane = problem_.planes[k].PlaneInWorld();
    evidence.centroid = evidence.plane.Project(fit->centroid);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> tilt(
        fit->covariance.topLeftCorner<2, 2>().eval());
    evidence.sigma_normal = std::sqrt(std::max(0.0, tilt.eigenvalues()[1]));
    evidence.sigma_offset = std::sqrt(std::max(0.0, fit->covariance(2, 2)));
    std::vector<double> sigmas;
    std::vector<double> distances;
    std::vector<double> ranges;
    for (const int i : state.members) {
      sigmas.push_back(PlaneSigma(sigma_, model_, sigma_px_, state, i));
      distances.push_back((problem_.points[i] - evidence.centroid).norm());
      ranges.push_back(view_range_of_point_[i]);
    }
    evidence.sigma_point = Median(std::move(sigmas));
    evidence.radius = UpperQuantile(std::move(distances), kShareInRadius);
    evidence.view_range = Median(std::move(ranges));
    evidence.usable = evidence.sigma_normal <= options_.max_normal_sigma_deg * kRadians;
    return evidence;
  }

  void Consider(size_t a, size_t b, std::vector<int>& parallel, std::vector<int>& orthogonal) {
    if (IsRefused(a, b) || HasKnownDistance(static_cast<int>(a), static_cast<int>(b))) return;
    const Evidence& ea = evidence_[a];
    const Evidence& eb = evidence_[b];
    if (!AreInOnePlace(ea, eb)) return;
    const double angle = PlaneAngle(ea.plane, eb.plane);
    const double sigma = std::hypot(ea.sigma_normal, eb.sigma_normal);
    const double gate = kGateSigmas * std::hypot(sigma, options_.sigma_deg * kRadians);
    RelationTerm term;
    term.plane_a = static_cast<int>(std::min(a, b));
    term.plane_b = static_cast<int>(std::max(a, b));
    term.sigma_rad = options_.sigma_deg * kRadians;
    if (angle <= std::min(gate, options_.max_parallel_deg * kRadians)) {
      if (parallel[b] >= options_.max_partners) return;
      ++parallel[b];
      term.relation = PlaneRelation::kParallel;
      if (AreCoplanar(a, b, term)) term.relation = PlaneRelation::kCoplanar;
    } else if (std::abs(angle - 0.5 * std::numbers::pi) <=
               std::min(gate, options_.max_orthogonal_deg * kRadians)) {
      if (orthogonal[b] >= options_.max_partners) return;
      ++orthogonal[b];
      term.relation = PlaneRelation::kOrthogonal;
    } else {
      return;
    }
    terms_.push_back(term);
  }

  /// Would a camera between two planes see both of them from as far as each was seen? What was
  /// built together is parallel for a reason, distant planes are by chance.
  static bool AreInOnePlace(const Evidence& a, const Evidence& b) {
    return (a.centroid - b.centroid).norm() - a.radius - b.radius <= a.view_range + b.view_range;
  }

  /// Fills place and sigma of the offset, too.
  bool AreCoplanar(size_t a, size_t b, RelationTerm& term) const {
    if (model_.planes[a].class_index != model_.planes[b].class_index) return false;
    const Evidence& ea = evidence_[a];
    const Evidence& eb = evidence_[b];
    term.place_in_world = 0.5 * (ea.centroid + eb.centroid);
    term.sigma_offset = std::max(ea.sigma_point, eb.sigma_point);
    const double half_distance = 0.5 * (ea.centroid - eb.centroid).norm();
    const double uncertainty =
        std::hypot(std::hypot(ea.sigma_offset, eb.sigma_offset),
                   half_distance * std::hypot(ea.sigma_normal, eb.sigma_normal));
    const double step = std::abs(StepBetween(ea.plane, eb.plane, term.place_in_world));
    // The planes must tell a step of a point's own sigma, else anything would pass for coplanar.
    return uncertainty <= term.sigma_offset &&
           step <= options_.max_offset_sigma * std::hypot(uncertainty, term.sigma_offset / 3.0);
  }

  [[nodiscard]] bool HasKnownDistance(int a, int b) const {
    return std::any_of(problem_.relations.begin(), problem_.relations.end(),
                       [&](const RelationTerm& term) {
                         return term.relation == PlaneRelation::kAtDistance &&
                                std::minmax(term.plane_a, term.plane_b) == std::minmax(a, b);
                       });
  }

  [[nodiscard]] bool IsRefused(size_t a, size_t b) const {
    const std::string& name_a = classes_.classes.at(model_.planes[a].class_index).name;
    const std::string& name_b = classes_.classes.at(model_.planes[b].class_index).name;
    const auto& refused = options_.refused;
    return std::find(refused.begin(), refused.end(), name_a + "|" + name_b) != refused.end() ||
           std::find(refused.begin(), refused.end(), name_b + "|" + name_a) != refused.end();
  }

  const RelationOptions& options_;
  const PlaneSigmaOptions& sigma_;
  double sigma_px_;
  const ClassTable& classes_;
  const PlaneModel& model_;
  const BundleProblem& problem_;
  std::vector<double> view_range_of_point_;
  std::vector<Evidence> evidence_;
  std::vector<RelationTerm> terms_;
};

}  // namespace

void RelationOptions::Visit(OptionVisitor& v) {
  v.Value("enabled", enabled, "whether planes are held parallel, orthogonal or coplanar (joint)");
  v.Value("max_parallel_deg", max_parallel_deg, "largest angle of a parallel pair [deg]", 0.0,
          90.0);
  v.Value("max_orthogonal_deg", max_orthogonal_deg,
          "largest deviation of an orthogonal pair from a right angle [deg]", 0.0, 90.0);
  v.Value("max_normal_sigma_deg", max_normal_sigma_deg,
          "planes with less certain normals take no part [deg]", 0.0, 90.0);
  v.Value("sigma_deg", sigma_deg, "how well the relations hold in reality [deg]", 1e-6, 90.0);
  v.Value("max_offset_sigma", max_offset_sigma, "largest step between coplanar planes [sigma]", 0.0,
          1e6);
  v.Value("max_partners", max_partners, "most relations of a kind per plane", 0, 1000);
  v.Value("refused", refused, "pairs of classes without relations, as \"class|class\"");
}

double StepBetween(const Plane& a, const Plane& b, const Eigen::Vector3d& place_in_world) {
  const double sign = a.normal.dot(b.normal) < 0.0 ? -1.0 : 1.0;
  return a.SignedDistance(place_in_world) - sign * b.SignedDistance(place_in_world);
}

void AddKnownDistances(const RelationOptions& options, const std::vector<PlaneDistance>& distances,
                       const SemanticMap& semantics, const PlaneModel& model,
                       BundleProblem& problem) {
  const auto index_of = [&](PlaneId id) {
    if (!semantics.planes.contains(id)) {
      ThrowInputError("plane_distances: the semantic map has no plane {}", id.value());
    }
    const auto it = std::find_if(model.planes.begin(), model.planes.end(),
                                 [&](const auto& plane) { return plane.id == id && plane.in_use; });
    return it == model.planes.end() ? -1 : static_cast<int>(it - model.planes.begin());
  };
  for (const PlaneDistance& known : distances) {
    RelationTerm term;
    term.relation = PlaneRelation::kAtDistance;
    term.plane_a = index_of(known.a);
    term.plane_b = index_of(known.b);
    if (term.plane_a < 0 || term.plane_b < 0) continue;
    const AnchoredPlane& a = problem.planes[term.plane_a];
    const AnchoredPlane& b = problem.planes[term.plane_b];
    const double angle = PlaneAngle(a.PlaneInWorld(), b.PlaneInWorld()) / kRadians;
    if (angle > kMaxKnownAngleDeg) {
      ThrowInputError("plane_distances: planes {} and {} are not parallel but at {:.1f} deg",
                      known.a.value(), known.b.value(), angle);
    }
    term.sigma_rad = options.sigma_deg * kRadians;
    term.sigma_offset = known.sigma;
    term.place_in_world = 0.5 * (a.anchor_in_world + b.anchor_in_world);
    const double step = StepBetween(a.PlaneInWorld(), b.PlaneInWorld(), term.place_in_world);
    term.distance = std::copysign(known.distance, step);
    problem.relations.push_back(term);
  }
}

std::vector<PlaneDistance> UnusedDistances(const std::vector<PlaneDistance>& distances,
                                           const PlaneModel& model, const BundleProblem& problem) {
  std::vector<PlaneDistance> unused;
  for (const PlaneDistance& known : distances) {
    const bool is_used = std::any_of(
        problem.relations.begin(), problem.relations.end(), [&](const RelationTerm& term) {
          return term.relation == PlaneRelation::kAtDistance &&
                 std::minmax(model.planes[term.plane_a].id, model.planes[term.plane_b].id) ==
                     std::minmax(known.a, known.b);
        });
    if (!is_used) unused.push_back(known);
  }
  return unused;
}

std::vector<RelationTerm> ProposeRelations(const RelationOptions& options,
                                           const PlaneSigmaOptions& sigma, double sigma_px,
                                           const ClassTable& classes, const PlaneModel& model,
                                           const BundleProblem& problem) {
  return Proposer(options, sigma, sigma_px, classes, model, problem).Run();
}

}  // namespace s3lam
