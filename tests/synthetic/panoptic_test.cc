#include "s3lam/synthetic/panoptic.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <string>

#include "s3lam/base/error.h"
#include "s3lam/synthetic/render.h"

namespace s3lam {
namespace {

int ClassIdOf(const Scene& scene, const PanopticSegment& segment) {
  return scene.class_table.classes[static_cast<size_t>(segment.class_index)].id;
}

TEST(Panoptic, CleanMaskShowsExactlyTheLabels) {
  for (const std::string& name : SceneNames()) {
    const Scene scene = MakeScene(name, 1);
    const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
    const cv::Mat labels = renderer.RenderLabels(10).labels;
    const SyntheticPanoptic panoptic = MakePanoptic(scene, 10, labels);
    EXPECT_GE(panoptic.frame.segments.size(), 4u) << name;
    std::map<int, int> segments_of_stuff;
    for (const auto& [id, segment] : panoptic.frame.segments) {
      const bool thing =
          scene.class_table.classes[static_cast<size_t>(segment.class_index)].is_thing;
      if (thing) {
        EXPECT_EQ(panoptic.truth.at(id).object_pixels.size(), 1u);
      } else {
        EXPECT_EQ(++segments_of_stuff[segment.class_index], 1) << name;
      }
      if (scene.layout == SequenceLayout::kKittiStep) {
        EXPECT_EQ(static_cast<int>(id % 256), ClassIdOf(scene, segment));
      } else {
        EXPECT_GT(id, 0u);
        EXPECT_LT(id, 1u << 24);
      }
    }
    for (int y = 0; y < labels.rows; ++y) {
      for (int x = 0; x < labels.cols; ++x) {
        const uint32_t id = panoptic.frame.segment_ids(y, x);
        if (id == kNoSegment) continue;
        const int object = labels.at<int>(y, x);
        const int class_id = object == 0 ? scene.background_class_id
                                         : scene.objects[static_cast<size_t>(object - 1)].class_id;
        ASSERT_EQ(ClassIdOf(scene, panoptic.frame.segments.at(id)), class_id);
      }
    }
  }
}

TEST(Panoptic, TruthCountsThePixelsOfEachSegment) {
  const Scene scene = MakeScene("desk", 2);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  const cv::Mat labels = renderer.RenderLabels(30).labels;
  const SyntheticPanoptic panoptic = MakeCorruptedPanoptic(scene, 30, labels, {});
  std::map<uint32_t, int> area;
  for (Eigen::Index i = 0; i < panoptic.frame.segment_ids.size(); ++i) {
    ++area[panoptic.frame.segment_ids.data()[i]];
  }
  for (const auto& [id, truth] : panoptic.truth) {
    int sum = 0;
    for (const auto& [object, pixels] : truth.object_pixels) sum += pixels;
    EXPECT_EQ(sum, area.at(id));
    EXPECT_GE(sum, 100);
  }
  EXPECT_EQ(panoptic.truth.size(), panoptic.frame.segments.size());
}

TEST(Panoptic, IdsAreLocalToTheFrame) {
  const Scene scene = MakeScene("desk", 1);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  std::map<int, std::set<uint32_t>> ids_of_object;
  for (int frame = 0; frame < 6; ++frame) {
    const SyntheticPanoptic panoptic =
        MakePanoptic(scene, frame, renderer.RenderLabels(frame).labels);
    for (const auto& [id, truth] : panoptic.truth) ids_of_object[truth.object].insert(id);
  }
  size_t changing = 0;
  for (const auto& [object, ids] : ids_of_object) changing += ids.size() >= 4 ? 1 : 0;
  EXPECT_GE(changing, ids_of_object.size() / 2);
}

// Share of pixels whose class is that of the exact mask.
double Agreement(const SyntheticPanoptic& a, const SyntheticPanoptic& b) {
  int same = 0;
  for (Eigen::Index i = 0; i < a.frame.segment_ids.size(); ++i) {
    const uint32_t id_a = a.frame.segment_ids.data()[i];
    const uint32_t id_b = b.frame.segment_ids.data()[i];
    if (id_a == kNoSegment || id_b == kNoSegment) {
      same += id_a == id_b ? 1 : 0;
    } else {
      same +=
          a.frame.segments.at(id_a).class_index == b.frame.segments.at(id_b).class_index ? 1 : 0;
    }
  }
  return same / static_cast<double>(a.frame.segment_ids.size());
}

TEST(Panoptic, CorruptionGrowsWithItsLevel) {
  for (const std::string name : {"desk", "street"}) {
    const Scene scene = MakeScene(name, 4);
    const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
    double last_agreement = 1.0 + 1e-12;
    std::set<std::pair<int, int>> last_missed;
    for (const double level : {0.0, 0.1, 0.2, 0.4}) {
      MaskCorruptionOptions options;
      options.level = level;
      double agreement = 0.0;
      std::set<std::pair<int, int>> missed;
      for (int frame = 0; frame < 40; frame += 2) {
        const cv::Mat labels = renderer.RenderLabels(frame).labels;
        const SyntheticPanoptic clean = MakePanoptic(scene, frame, labels);
        const SyntheticPanoptic noisy = MakeCorruptedPanoptic(scene, frame, labels, options);
        if (level == 0.0) {
          ASSERT_EQ(clean.frame.segment_ids, noisy.frame.segment_ids);
        }
        agreement += Agreement(clean, noisy) / 20.0;
        for (const int object : noisy.missed) missed.emplace(frame, object);
      }
      EXPECT_LT(agreement, last_agreement) << name << " " << level;
      EXPECT_TRUE(
          std::includes(missed.begin(), missed.end(), last_missed.begin(), last_missed.end()));
      last_agreement = agreement;
      last_missed = missed;
    }
    EXPECT_GT(last_agreement, 0.4) << "still a mask";
    EXPECT_LT(last_agreement, 0.93);
  }
}

TEST(Panoptic, DefaultCorruptionIsLikeANetworks) {
  const Scene scene = MakeScene("desk", 5);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  double things = 0.0;
  double missed = 0.0;
  std::map<std::string, int> notes;
  for (int frame = 0; frame < 120; ++frame) {
    const cv::Mat labels = renderer.RenderLabels(frame).labels;
    const SyntheticPanoptic clean = MakePanoptic(scene, frame, labels);
    const SyntheticPanoptic noisy = MakeCorruptedPanoptic(scene, frame, labels, {});
    for (const auto& [id, segment] : clean.frame.segments) {
      things +=
          scene.class_table.classes[static_cast<size_t>(segment.class_index)].is_thing ? 1.0 : 0.0;
    }
    missed += static_cast<double>(noisy.missed.size());
    for (const auto& [id, truth] : noisy.truth) {
      for (const CorruptionNote& note : truth.corruption) ++notes[note.type];
      const double score = noisy.frame.segments.at(id).score;
      EXPECT_GE(score, 0.45);
      EXPECT_LE(score, truth.corruption.empty() ? 0.98 : 0.85);
    }
  }
  EXPECT_NEAR(missed / things, 0.13, 0.04);
  for (const char* type : {"class", "merge", "split", "cut"}) EXPECT_GT(notes[type], 0) << type;
}

TEST(Panoptic, MissesComeInBursts) {
  const Scene scene = MakeScene("desk", 6);
  const Renderer renderer(scene, 2, RenderContent::kLabelsOnly);
  const cv::Mat labels = renderer.RenderLabels(0).labels;
  std::map<int, std::vector<bool>> missing;
  for (int frame = 0; frame < 200; ++frame) {  // The same picture, so that only time matters.
    const SyntheticPanoptic noisy = MakeCorruptedPanoptic(scene, frame, labels, {});
    for (const auto& object : scene.objects) {
      missing[object.id].push_back(std::count(noisy.missed.begin(), noisy.missed.end(), object.id) >
                                   0);
    }
  }
  int missed = 0;
  int again = 0;
  for (const auto& [object, series] : missing) {
    for (size_t i = 0; i + 1 < series.size(); ++i) {
      missed += series[i] ? 1 : 0;
      again += series[i] && series[i + 1] ? 1 : 0;
    }
  }
  // Without bursts it would be the rate itself, about 0.13.
  EXPECT_GT(again, 0.4 * missed);
  EXPECT_GT(missed, 100);
}

}  // namespace
}  // namespace s3lam
