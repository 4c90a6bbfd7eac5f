#include "s3lam/semantics/label_fusion.h"

#include <array>
#include <cmath>
#include <string_view>

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 2> kMethodNames = {"bayes", "majority"};

/// The observations of a row that count.
std::vector<size_t> UsableSegments(const MaskObservations& observations, size_t row,
                                   bool drop_border) {
  std::vector<size_t> inside;
  std::vector<size_t> all;
  for (const PointObservation& o : observations.ObservationsOf(row)) {
    if (o.segment == kVoidSegment || o.predicted) continue;
    all.push_back(static_cast<size_t>(o.segment));
    if (!o.near_border) inside.push_back(static_cast<size_t>(o.segment));
  }
  return drop_border && !inside.empty() ? inside : all;
}

/// exp(x) / sum(exp(x)), without overflow.
Eigen::VectorXd Softmax(const Eigen::VectorXd& logs) {
  const Eigen::VectorXd shifted = (logs.array() - logs.maxCoeff()).exp();
  return shifted / shifted.sum();
}

}  // namespace

void FusionOptions::Visit(OptionVisitor& v) {
  v.Choice("method", method, kMethodNames, "How the observations of a point are combined.");
  v.Value("floor", floor, "Least probability of any class in one observation.", 1e-9, 0.5);
  v.Value("use_scores", use_scores, "Take a segment's score for the probability of its class.");
  v.Value("drop_border", drop_border,
          "Leave out observations near a segment's border (see lookup.border_px).");
  v.Value("tempering", tempering,
          "Observations are not independent: with n of them each counts n^-tempering. 0 is the "
          "paper's product, 1 the geometric mean.",
          0.0, 1.0);
}

Eigen::VectorXd SegmentDistribution(const PanopticSegment& label, int num_classes,
                                    const FusionOptions& options) {
  Eigen::VectorXd p(num_classes);
  if (!label.distribution.empty()) {
    p = Eigen::Map<const Eigen::VectorXf>(label.distribution.data(), num_classes).cast<double>();
  } else if (options.use_scores && num_classes > 1) {
    p.setConstant((1.0 - label.score) / (num_classes - 1));
    p[label.class_index] = label.score;
  } else {
    p.setZero();
    p[label.class_index] = 1.0;
  }
  p = p.cwiseMax(options.floor);
  return p / p.sum();
}

ClassDistributions FuseLabels(const MaskObservations& observations, int num_classes,
                              const FusionOptions& options) {
  const size_t num_segments = observations.segments.size();
  Eigen::MatrixXd logs(num_classes, static_cast<Eigen::Index>(num_segments));
  std::vector<int> best(num_segments);
  for (size_t s = 0; s < num_segments; ++s) {
    const Eigen::VectorXd p =
        SegmentDistribution(observations.segments[s].label, num_classes, options);
    p.maxCoeff(&best[s]);
    logs.col(static_cast<Eigen::Index>(s)) = p.array().log();
  }
  ClassDistributions result(static_cast<Eigen::Index>(observations.points.size()), num_classes);
  for (size_t row = 0; row < observations.points.size(); ++row) {
    const std::vector<size_t> segments = UsableSegments(observations, row, options.drop_border);
    const auto n = static_cast<double>(segments.size());
    Eigen::VectorXd sum = Eigen::VectorXd::Zero(num_classes);
    if (options.method == FusionMethod::kMajority) {
      for (const size_t s : segments) sum[best[s]] += 1.0 / n;
    } else {
      for (const size_t s : segments) sum += logs.col(static_cast<Eigen::Index>(s));
      sum = Softmax(std::pow(n, -options.tempering) * sum);
    }
    result.row(static_cast<Eigen::Index>(row)) = sum.cast<float>().transpose();
  }
  return result;
}

int MostLikelyClass(const ClassDistributions& distributions, size_t row) {
  int best = 0;
  distributions.row(static_cast<Eigen::Index>(row)).maxCoeff(&best);
  return best;
}

}  // namespace s3lam
