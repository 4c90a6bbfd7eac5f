#pragma once

#include <Eigen/Core>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/semantics/mask_observations.h"

namespace s3lam {

using ClassDistributions =
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;  // rows x classes

/// How often a class is taken for another: row = true class, column = class in the masks, every row
/// a distribution.
using ConfusionMatrix = Eigen::MatrixXd;

enum class FusionMethod { kBayes, kMajority };
enum class ConfusionSource { kNone, kEstimated };

struct FusionOptions {
  FusionMethod method = FusionMethod::kBayes;
  double floor = 0.01;
  bool use_scores = true;
  bool drop_border = false;
  double tempering = 0.25;
  ConfusionSource confusion = ConfusionSource::kNone;
  int confusion_rounds = 3;
  double confusion_prior = 50.0;

  void Visit(OptionVisitor& v);
};

/// The class distribution of a segment's pixels, P_i(u, v, .) of the paper: its own if it has one,
/// else its score (or certainty) on its class and the rest evenly on the others; nothing below
/// `floor` before normalisation.
Eigen::VectorXd SegmentDistribution(const PanopticSegment& label, int num_classes,
                                    const FusionOptions& options);

/// Fuses the observations of every point (row).
///   bayes     p_c = (1/Z) prod_i P_i(c)^(n^-tempering) over its n observations, in log space
///   majority  share of the observations whose most likely class is c
/// P_i is the pixel's distribution where the masks have one, else its segment's. With a confusion
/// matrix M it is the likelihood sum_l M(c, l) P_i(l) in its place. Observations in no segment are
/// left out; those near a border too, unless all are.
ClassDistributions FuseLabels(const MaskObservations& observations, int num_classes,
                              const FusionOptions& options,
                              const ConfusionMatrix* confusion = nullptr);

/// Estimates the confusion of the masks' classes from how the views of a point agree (Dawid and
/// Skene, 1979): the fused distributions tell which class a point is, its observations what it was
/// taken for; repeated confusion_rounds times. Each class starts from confusion_prior observations,
/// nearly all of them right, so that rare classes stay near the identity.
ConfusionMatrix EstimateConfusion(const MaskObservations& observations, int num_classes,
                                  const FusionOptions& options);

/// Index of the most likely class of a row; the lower one of equals.
int MostLikelyClass(const ClassDistributions& distributions, size_t row);

}  // namespace s3lam
