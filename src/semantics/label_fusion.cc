#include "s3lam/semantics/label_fusion.h"

#include <array>
#include <cmath>
#include <string_view>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 2> kMethodNames = {"bayes", "majority"};
constexpr std::array<std::string_view, 2> kConfusionNames = {"none", "estimated"};

/// Views that a point needs to tell anything of how its views agree.
constexpr size_t kMinViews = 3;

/// The observations of a row that count.
std::vector<PointObservation> UsableObservations(const MaskObservations& observations, size_t row,
                                                 bool drop_border) {
  std::vector<PointObservation> inside;
  std::vector<PointObservation> all;
  for (const PointObservation& o : observations.ObservationsOf(row)) {
    if (o.segment == kVoidSegment || o.predicted) continue;
    all.push_back(o);
    if (!o.near_border) inside.push_back(o);
  }
  return drop_border && !inside.empty() ? inside : all;
}

Eigen::VectorXd Expand(const PixelDistribution& pixel, int num_classes) {
  Eigen::VectorXd p = Eigen::VectorXd::Constant(num_classes, pixel.each_of_others);
  for (size_t i = 0; i < pixel.num_classes; ++i) p[pixel.classes[i]] = pixel.probabilities[i];
  return p;
}

Eigen::VectorXd Floored(const Eigen::VectorXd& p, double floor) {
  const Eigen::VectorXd raised = p.cwiseMax(floor);
  return raised / raised.sum();
}

/// Of a segment of which only a class and a score are known: its logarithms have two values.
struct PlainLabel {
  int class_index = 0;
  double log_own = 0.0;     // Of its class.
  double log_others = 0.0;  // Of each other class.
};

/// What the observations say, as distributions over the classes.
class Beliefs {
 public:
  Beliefs(const MaskObservations& observations, int num_classes, const FusionOptions& options)
      : observations_(observations), num_classes_(num_classes), options_(options) {
    for (const SegmentNode& segment : observations.segments) {
      PlainLabel& plain = plain_.emplace_back();
      plain.class_index = segment.label.class_index;
      if (!segment.label.distribution.empty()) continue;
      const Eigen::VectorXd p = SegmentDistribution(segment.label, num_classes, options);
      plain.log_own = std::log(p[plain.class_index]);
      if (num_classes > 1) plain.log_others = std::log(p[plain.class_index == 0 ? 1 : 0]);
    }
  }

  [[nodiscard]] Eigen::VectorXd Of(const PointObservation& o) const {
    if (o.pixel < 0) {
      return SegmentDistribution(observations_.segments[static_cast<size_t>(o.segment)].label,
                                 num_classes_, options_);
    }
    return Floored(
        Expand(observations_.pixel_distributions[static_cast<size_t>(o.pixel)], num_classes_),
        options_.floor);
  }

  /// Null if the observation has a distribution of its own.
  [[nodiscard]] const PlainLabel* PlainOf(const PointObservation& o) const {
    const auto segment = static_cast<size_t>(o.segment);
    const bool is_plain = o.pixel < 0 && observations_.segments[segment].label.distribution.empty();
    return is_plain ? &plain_[segment] : nullptr;
  }

 private:
  const MaskObservations& observations_;
  int num_classes_;
  const FusionOptions& options_;
  std::vector<PlainLabel> plain_;  // Of each segment.
};

/// Sum over the observations of the logarithms of what they say, up to a constant.
Eigen::VectorXd SumLogs(const std::vector<PointObservation>& usable, const Beliefs& beliefs,
                        int num_classes, double floor, const ConfusionMatrix* confusion) {
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(num_classes);
  for (const PointObservation& o : usable) {
    const PlainLabel* plain = confusion == nullptr ? beliefs.PlainOf(o) : nullptr;
    if (plain != nullptr) {
      sum[plain->class_index] += plain->log_own - plain->log_others;
      continue;
    }
    Eigen::VectorXd p = beliefs.Of(o);
    if (confusion != nullptr) p = Floored(*confusion * p, floor);
    sum += Eigen::VectorXd(p.array().log());
  }
  return sum;
}

/// Share of the observations whose likeliest class each is.
Eigen::VectorXd CountVotes(const std::vector<PointObservation>& usable, const Beliefs& beliefs,
                           int num_classes) {
  Eigen::VectorXd votes = Eigen::VectorXd::Zero(num_classes);
  for (const PointObservation& o : usable) {
    Eigen::Index best = 0;
    beliefs.Of(o).maxCoeff(&best);
    votes[best] += 1.0 / static_cast<double>(usable.size());
  }
  return votes;
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
  v.Choice("confusion", confusion, kConfusionNames,
           "Whether the masks' confusion of classes is estimated from how the views of a point "
           "agree, and taken for the likelihood. A matrix given by hand wins.");
  v.Value("confusion_rounds", confusion_rounds, "Rounds of that estimation.", 1, 100);
  v.Value("confusion_prior", confusion_prior,
          "Observations of each class that are taken for right before any is seen.", 0.0);
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
  return Floored(p, options.floor);
}

ClassDistributions FuseLabels(const MaskObservations& observations, int num_classes,
                              const FusionOptions& options, const ConfusionMatrix* confusion) {
  S3LAM_CHECK(confusion == nullptr ||
              (confusion->rows() == num_classes && confusion->cols() == num_classes));
  const Beliefs beliefs(observations, num_classes, options);
  ClassDistributions result(static_cast<Eigen::Index>(observations.points.size()), num_classes);
  for (size_t row = 0; row < observations.points.size(); ++row) {
    const auto usable = UsableObservations(observations, row, options.drop_border);
    Eigen::VectorXd p;
    if (options.method == FusionMethod::kMajority) {
      p = CountVotes(usable, beliefs, num_classes);
    } else {
      const double each = std::pow(static_cast<double>(usable.size()), -options.tempering);
      p = Softmax(each * SumLogs(usable, beliefs, num_classes, options.floor, confusion));
    }
    result.row(static_cast<Eigen::Index>(row)) = p.cast<float>().transpose();
  }
  return result;
}

ConfusionMatrix EstimateConfusion(const MaskObservations& observations, int num_classes,
                                  const FusionOptions& options) {
  constexpr double kPriorRight = 0.95;
  const double others = num_classes > 1 ? (1.0 - kPriorRight) / (num_classes - 1) : 0.0;
  ConfusionMatrix prior = ConfusionMatrix::Constant(num_classes, num_classes, others);
  prior.diagonal().setConstant(kPriorRight);
  const Beliefs beliefs(observations, num_classes, options);
  ConfusionMatrix confusion = prior;
  for (int round = 0; round < options.confusion_rounds; ++round) {
    const ClassDistributions fused =
        FuseLabels(observations, num_classes, options, round == 0 ? nullptr : &confusion);
    confusion = options.confusion_prior * prior;
    for (size_t row = 0; row < observations.points.size(); ++row) {
      const auto usable = UsableObservations(observations, row, options.drop_border);
      if (usable.size() < kMinViews) continue;
      const Eigen::VectorXd p = fused.row(static_cast<Eigen::Index>(row)).cast<double>();
      for (const PointObservation& o : usable) confusion += p * beliefs.Of(o).transpose();
    }
    for (Eigen::Index c = 0; c < num_classes; ++c) {
      const double sum = confusion.row(c).sum();
      confusion.row(c) =
          sum > 0.0 ? Eigen::RowVectorXd(confusion.row(c) / sum) : Eigen::RowVectorXd(prior.row(c));
    }
  }
  return confusion;
}

int MostLikelyClass(const ClassDistributions& distributions, size_t row) {
  int best = 0;
  distributions.row(static_cast<Eigen::Index>(row)).maxCoeff(&best);
  return best;
}

}  // namespace s3lam
