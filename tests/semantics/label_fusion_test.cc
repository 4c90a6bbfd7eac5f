#include "s3lam/semantics/label_fusion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "s3lam/base/rng.h"
#include "semantics/semantics_fixture.h"

namespace s3lam {
namespace {

constexpr int kClasses = 4;

FusionOptions PaperOptions() {
  FusionOptions options;
  options.tempering = 0.0;
  options.drop_border = false;
  return options;
}

TEST(SegmentDistribution, SpreadsTheRestOfTheScore) {
  PanopticSegment label;
  label.class_index = 2;
  label.score = 0.7;
  const Eigen::VectorXd p = SegmentDistribution(label, kClasses, PaperOptions());
  EXPECT_NEAR(p[2], 0.7, 1e-12);
  EXPECT_NEAR(p[0], 0.1, 1e-12);
  EXPECT_NEAR(p.sum(), 1.0, 1e-12);
}

TEST(SegmentDistribution, KeepsTheFloor) {
  PanopticSegment label;
  label.class_index = 1;
  FusionOptions options = PaperOptions();
  options.floor = 0.02;
  const Eigen::VectorXd certain = SegmentDistribution(label, kClasses, options);
  EXPECT_NEAR(certain[0], 0.02 / 1.06, 1e-12);
  label.distribution = {0.5F, 0.5F, 0.0F, 0.0F};
  const Eigen::VectorXd own = SegmentDistribution(label, kClasses, options);
  EXPECT_NEAR(own[0], 0.5 / 1.04, 1e-7);
  EXPECT_NEAR(own[3], 0.02 / 1.04, 1e-7);
}

TEST(FuseLabels, EqualsTheDirectProduct) {
  testing::ObservationBuilder builder;
  const std::vector<std::pair<int, double>> labels = {{0, 0.6}, {1, 0.9}, {0, 0.55}, {2, 0.5}};
  std::vector<int32_t> segments;
  for (uint32_t f = 0; f < labels.size(); ++f) {
    segments.push_back(builder.AddSegment(f, labels[f].first, labels[f].second));
  }
  builder.AddPoint(segments);
  const ClassDistributions fused = FuseLabels(builder.result(), kClasses, PaperOptions());
  Eigen::VectorXd product = Eigen::VectorXd::Ones(kClasses);
  for (const SegmentNode& segment : builder.result().segments) {
    product = product.cwiseProduct(SegmentDistribution(segment.label, kClasses, PaperOptions()));
  }
  product /= product.sum();
  for (int c = 0; c < kClasses; ++c) EXPECT_NEAR(fused(0, c), product[c], 1e-6);
}

TEST(FuseLabels, SurvivesThousandsOfObservations) {
  testing::ObservationBuilder builder;
  std::vector<int32_t> segments;
  for (uint32_t f = 0; f < 5000; ++f) segments.push_back(builder.AddSegment(f, f % 3 == 0 ? 1 : 2));
  builder.AddPoint(segments);
  const ClassDistributions fused = FuseLabels(builder.result(), kClasses, PaperOptions());
  EXPECT_TRUE(fused.allFinite());
  EXPECT_NEAR(fused.row(0).sum(), 1.0, 1e-6);
  EXPECT_EQ(MostLikelyClass(fused, 0), 2);
}

TEST(FuseLabels, DoesNotDependOnTheOrder) {
  Rng rng(5);
  std::vector<std::pair<int, double>> labels;
  for (int i = 0; i < 12; ++i) {
    labels.emplace_back(static_cast<int>(rng.Below(kClasses)), rng.Uniform(0.5, 1.0));
  }
  const auto fuse = [&] {
    testing::ObservationBuilder builder;
    std::vector<int32_t> segments;
    for (uint32_t f = 0; f < labels.size(); ++f) {
      segments.push_back(builder.AddSegment(f, labels[f].first, labels[f].second));
    }
    builder.AddPoint(segments);
    return FuseLabels(builder.result(), kClasses, FusionOptions{});
  };
  const ClassDistributions forward = fuse();
  std::reverse(labels.begin(), labels.end());
  EXPECT_TRUE(fuse().isApprox(forward, 1e-6F));
}

TEST(FuseLabels, TemperingFlattensButKeepsTheWinner) {
  testing::ObservationBuilder builder;
  std::vector<int32_t> segments;
  for (uint32_t f = 0; f < 4; ++f) segments.push_back(builder.AddSegment(f, f == 0 ? 1 : 0, 0.6));
  builder.AddPoint(segments);
  FusionOptions options = PaperOptions();
  const ClassDistributions sharp = FuseLabels(builder.result(), kClasses, options);
  options.tempering = 1.0;
  const ClassDistributions flat = FuseLabels(builder.result(), kClasses, options);
  EXPECT_EQ(MostLikelyClass(sharp, 0), 0);
  EXPECT_EQ(MostLikelyClass(flat, 0), 0);
  EXPECT_LT(flat(0, 0), sharp(0, 0));
}

TEST(FuseLabels, LeavesOutBordersUnlessThereIsNothingElse) {
  testing::ObservationBuilder builder;
  const int32_t wrong = builder.AddSegment(0, 3);
  const int32_t also_wrong = builder.AddSegment(1, 3);
  const int32_t right = builder.AddSegment(2, 1);
  builder.AddPoint({wrong, also_wrong, right});
  builder.AddPoint({wrong, also_wrong}, true);
  auto& observations = builder.result().observations;
  observations[0].near_border = observations[1].near_border = true;
  FusionOptions options;
  options.drop_border = true;
  EXPECT_EQ(MostLikelyClass(FuseLabels(builder.result(), kClasses, options), 0), 1);
  EXPECT_EQ(MostLikelyClass(FuseLabels(builder.result(), kClasses, options), 1), 3);
  options.drop_border = false;
  EXPECT_EQ(MostLikelyClass(FuseLabels(builder.result(), kClasses, options), 0), 3);
}

TEST(FuseLabels, MajorityCountsVotes) {
  testing::ObservationBuilder builder;
  std::vector<int32_t> segments = {builder.AddSegment(0, 2, 0.99), builder.AddSegment(1, 1, 0.4),
                                   builder.AddSegment(2, 1, 0.4)};
  builder.AddPoint(segments);
  FusionOptions options;
  options.method = FusionMethod::kMajority;
  const ClassDistributions fused = FuseLabels(builder.result(), kClasses, options);
  EXPECT_NEAR(fused(0, 1), 2.0 / 3.0, 1e-6);
  EXPECT_NEAR(fused(0, 2), 1.0 / 3.0, 1e-6);
  // The scores say otherwise, and Bayes listens to them.
  options.method = FusionMethod::kBayes;
  EXPECT_EQ(MostLikelyClass(FuseLabels(builder.result(), kClasses, options), 0), 2);
}

TEST(FuseLabels, TakesThePixelsDistributionWhereThereIsOne) {
  testing::ObservationBuilder builder;
  builder.AddPoint({builder.AddSegment(0, 0), builder.AddSegment(1, 0)});
  MaskObservations& observations = builder.result();
  for (PointObservation& o : observations.observations) {
    o.pixel = static_cast<int32_t>(observations.pixel_distributions.size());
    observations.pixel_distributions.push_back(Compress({0.3F, 0.6F, 0.05F, 0.05F}));
  }
  const ClassDistributions fused = FuseLabels(observations, kClasses, PaperOptions());
  EXPECT_NEAR(fused(0, 1), 0.36 / (0.09 + 0.36 + 2 * 0.0025), 1e-5);
}

TEST(PixelDistribution, KeepsTheLikeliestAndTheSum) {
  std::vector<float> p(20, 0.01F);
  p[3] = 0.5F;
  p[17] = 0.5F - 0.18F;
  const PixelDistribution pixel = Compress(p);
  EXPECT_EQ(pixel.classes[0], 3);
  EXPECT_EQ(pixel.classes[1], 17);
  EXPECT_EQ(pixel.num_classes, 8);
  EXPECT_NEAR(pixel.each_of_others, 0.01, 1e-6);
}

/// Points of class 0, which the masks take for class 1 in two views of five, and points of class 1,
/// which they always take for class 1.
MaskObservations ConfusedObservations() {
  testing::ObservationBuilder builder;
  std::vector<std::vector<int32_t>> segments(5);
  for (uint32_t f = 0; f < 5; ++f) {
    for (const int c : {0, 1}) segments[f].push_back(builder.AddSegment(f, c));
  }
  for (size_t i = 0; i < 200; ++i) {
    std::vector<int32_t> views;
    for (size_t f = 0; f < 5; ++f) {
      const bool is_confused = (f + i) % 5 < 2;
      views.push_back(segments[f][is_confused ? 1 : 0]);
    }
    builder.AddPoint(views);
    builder.AddPoint({segments[0][1], segments[1][1], segments[2][1], segments[3][1]});
  }
  // Two views say class 0, three class 1: only a confused class 0 looks like that.
  builder.AddPoint(
      {segments[0][0], segments[1][0], segments[2][1], segments[3][1], segments[4][1]});
  return builder.result();
}

TEST(EstimateConfusion, FindsWhatIsTakenForWhat) {
  FusionOptions options = PaperOptions();
  options.floor = 1e-3;
  const MaskObservations observations = ConfusedObservations();
  const ConfusionMatrix confusion = EstimateConfusion(observations, kClasses, options);
  EXPECT_NEAR(confusion(0, 1), 0.4, 0.03);
  EXPECT_NEAR(confusion(1, 1), 0.99, 0.01);
  for (int c = 0; c < kClasses; ++c) EXPECT_NEAR(confusion.row(c).sum(), 1.0, 1e-9);
  EXPECT_GT(confusion(3, 3), 0.9);  // Never seen.
  const size_t last = observations.points.size() - 1;
  EXPECT_EQ(MostLikelyClass(FuseLabels(observations, kClasses, options), last), 1);
  EXPECT_EQ(MostLikelyClass(FuseLabels(observations, kClasses, options, &confusion), last), 0);
}

}  // namespace
}  // namespace s3lam
