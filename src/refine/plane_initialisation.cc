// Finds the planes among their candidates before any solve with planes.

#include <algorithm>
#include <cmath>
#include <limits>

#include "plane_distance.h"
#include "s3lam/base/statistics.h"
#include "s3lam/refine/plane_model.h"
#include "s3lam/robust/flat_cells.h"

namespace s3lam {
namespace {

/// Rounds of InitialisePlanes, and how near [sigma] to its plane a point must be to speak for
/// kappa.
constexpr int kInitialRounds = 6;
/// The first rounds bring a plane to where its points are, wherever it was handed over: only then
/// is it asked whether they are near enough.
constexpr int kFreeRounds = 3;
constexpr double kKappaGate = 3.0;

constexpr double kLeastRoom = 3.0;
constexpr double kNoLimit = 1e9;

struct KappaSample {
  double squared_distance, triangulation_variance, squared_unit;
};

double MedianSigmas(const std::vector<KappaSample>& samples, double kappa) {
  std::vector<double> sigmas;
  sigmas.reserve(samples.size());
  for (const KappaSample& s : samples) {
    sigmas.push_back(std::sqrt(s.squared_distance /
                               (s.triangulation_variance + kappa * kappa * s.squared_unit)));
  }
  return Median(std::move(sigmas));
}

/// The median falls as kappa grows: bisection.
double SolveKappa(const std::vector<KappaSample>& samples, double min_kappa, double max_kappa) {
  double low = min_kappa;
  if (samples.empty() || MedianSigmas(samples, low) <= kMedianOfAbsoluteNormal) return low;
  double high = low;
  do {
    high *= 2.0;
  } while (MedianSigmas(samples, high) > kMedianOfAbsoluteNormal && high < max_kappa);
  for (int step = 0; step < 30; ++step) {
    const double middle = 0.5 * (low + high);
    (MedianSigmas(samples, middle) > kMedianOfAbsoluteNormal ? low : high) = middle;
  }
  return std::min(high, max_kappa);
}

void EstimateKappa(const PlaneSigmaOptions& options, bool is_free, double sigma_px,
                   const BundleProblem& problem, PlaneModel& model) {
  std::vector<std::vector<KappaSample>> samples(model.kappa_of_class.size());
  for (size_t k = 0; k < model.planes.size(); ++k) {
    const int plane = static_cast<int>(k);
    for (const int i : model.planes[k].members) {
      const double distance = Distance(problem, plane, i);
      const double unit = sigma_px * model.keypoint_size[i];
      samples[model.planes[k].class_index].push_back(
          {distance * distance, NormalVariance(model, problem, plane, i), unit * unit});
    }
  }
  for (size_t c = 0; c < samples.size(); ++c) {
    if (samples[c].empty()) continue;
    // Where keypoints themselves are that uncertain, the limit still leaves room for what they
    // miss.
    const double max_kappa =
        is_free ? kNoLimit
                : std::max({options.min_kappa, kLeastRoom, options.max_roughness_px / sigma_px});
    model.kappa_of_class[c] = SolveKappa(samples[c], options.min_kappa, max_kappa);
  }
  for (PlaneState& plane : model.planes) plane.kappa = model.kappa_of_class[plane.class_index];
}

/// Learns from the best third of each plane's candidates how many are wrong and how far off those
/// lie. If they are many, a point must be certain enough to be seen off the plane at that distance.
void LimitUncertainty(const PlaneOptions& options, double sigma_px, const BundleProblem& problem,
                      PlaneModel& model) {
  constexpr double kManyWrong = 0.1;
  struct Candidate {
    double ratio, distance, innovation;
  };
  for (size_t k = 0; k < model.planes.size(); ++k) {
    PlaneState& state = model.planes[k];
    std::vector<Candidate> best;
    for (const int i : state.candidates) {
      if (!(model.keypoint_size[i] > 0.0)) continue;
      const double sigma = PlaneSigma(options.sigma, model, sigma_px, state, i);
      const double variance = NormalVariance(model, problem, static_cast<int>(k), i);
      const double distance = std::abs(Distance(problem, static_cast<int>(k), i));
      best.push_back({variance / (sigma * sigma), distance, Innovation(distance, variance, sigma)});
    }
    std::stable_sort(best.begin(), best.end(),
                     [](const Candidate& a, const Candidate& b) { return a.ratio < b.ratio; });
    best.resize((best.size() + 2) / 3);
    std::vector<double> wrong;
    for (const Candidate& candidate : best) {
      if (candidate.innovation > options.membership.max_sigma) wrong.push_back(candidate.distance);
    }
    if (static_cast<double>(wrong.size()) <= kManyWrong * static_cast<double>(best.size())) {
      continue;
    }
    state.max_uncertainty = Median(std::move(wrong)) / options.membership.max_sigma;
  }
}

/// Members are the candidates within `gate` sigmas, none of them being pulled by the plane yet.
void GateMembers(const PlaneSigmaOptions& options, double sigma_px, double gate,
                 const BundleProblem& problem, PlaneModel& model) {
  for (size_t k = 0; k < model.planes.size(); ++k) {
    PlaneState& state = model.planes[k];
    state.members.clear();
    if (!state.in_use) continue;
    for (const int i : state.candidates) {
      if (!(model.keypoint_size[i] > 0.0)) continue;
      const int plane = static_cast<int>(k);
      if (Innovation(Distance(problem, plane, i), NormalVariance(model, problem, plane, i),
                     PlaneSigma(options, model, sigma_px, state, i)) <= gate) {
        state.members.push_back(i);
      }
    }
  }
}

/// Takes away the members (or candidates) whose part of the surface does not lie on the plane.
void DropBentParts(const PlaneOptions& options, double sigma_px, std::vector<int> PlaneState::*from,
                   const BundleProblem& problem, PlaneModel& model) {
  for (size_t k = 0; k < model.planes.size(); ++k) {
    PlaneState& state = model.planes[k];
    if (state.is_ground)
      continue;  // Drift of the scale bends it: that is what it is there to undo.
    std::vector<int> near;
    for (const int i : state.candidates) {
      if (model.keypoint_size[i] > 0.0) near.push_back(i);
    }
    const std::vector<uint8_t> is_flat =
        FlatCells(options.membership.cells,
                  UncertainPoints(options.sigma, sigma_px, state, near, model, problem),
                  problem.planes[k].PlaneInWorld());
    std::vector<int> bent;
    for (size_t i = 0; i < near.size(); ++i) {
      if (is_flat[i] == 0) bent.push_back(near[i]);
    }
    std::erase_if(state.*from,
                  [&](int i) { return std::binary_search(bent.begin(), bent.end(), i); });
  }
}

}  // namespace

void InitialisePlanes(const PlaneOptions& options, double sigma_px, PlaneModel& model,
                      BundleProblem& problem) {
  GateMembers(options.sigma, sigma_px, std::numeric_limits<double>::infinity(), problem, model);
  for (int round = 0; round < kInitialRounds; ++round) {
    const bool is_free = round < kFreeRounds;
    EstimateKappa(options.sigma, is_free, sigma_px, problem, model);
    GateMembers(options.sigma, sigma_px, options.membership.max_sigma, problem, model);
    if (!is_free) DropBentParts(options, sigma_px, &PlaneState::members, problem, model);
    RefitPlanes(options.sigma, sigma_px, false, model, problem);
    GateMembers(options.sigma, sigma_px, kKappaGate, problem, model);
  }
  LimitUncertainty(options, sigma_px, problem, model);
  DropBentParts(options, sigma_px, &PlaneState::candidates, problem, model);
  for (PlaneState& plane : model.planes) plane.members.clear();
}

}  // namespace s3lam
