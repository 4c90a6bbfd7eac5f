#pragma once

#include <Eigen/Core>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/semantics/mask_observations.h"

namespace s3lam {

using ClassDistributions =
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;  // rows x classes

enum class FusionMethod { kBayes, kMajority };

struct FusionOptions {
  FusionMethod method = FusionMethod::kBayes;
  double floor = 0.01;
  bool use_scores = true;
  bool drop_border = false;
  double tempering = 0.25;

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
/// Observations in no segment are left out; those near a border too, unless all are.
ClassDistributions FuseLabels(const MaskObservations& observations, int num_classes,
                              const FusionOptions& options);

/// Index of the most likely class of a row; the lower one of equals.
int MostLikelyClass(const ClassDistributions& distributions, size_t row);

}  // namespace s3lam
