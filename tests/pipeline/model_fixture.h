#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "pipeline/program_test_support.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/synthetic/synthetic_map.h"

namespace s3lam::testing {

/// A small model with its semantic map and with masks of one segment each, for s3-lift and
/// s3-refine. Unspoiled, both programs accept it.
class ModelTest : public RefusedTest {
 protected:
  ModelTest() {
    SyntheticMapOptions options;
    options.num_images = 8;
    options.num_points = 500;
    const SyntheticMap map = MakeSyntheticMap("desk", 1, options);
    std::filesystem::create_directories(model());
    std::filesystem::create_directories(semantics());
    std::filesystem::create_directories(masks());
    WriteColmapModel(map.estimate, model());
    WriteSemanticMap(map.semantics, semantics());
    for (const auto& [id, image] : map.estimate.images) {
      const Camera& camera = map.estimate.cameras.at(image.camera_id);
      mask_size_ = cv::Size(camera.width, camera.height);
      mask_names_.push_back(std::filesystem::path(image.name).replace_extension(".png").string());
      WriteMask(mask_names_.back(), mask_size_, kRoad);
    }
  }

  [[nodiscard]] std::filesystem::path model() const { return inputs_ / "model"; }
  [[nodiscard]] std::filesystem::path semantics() const { return inputs_ / "semantics"; }
  [[nodiscard]] std::filesystem::path masks() const { return inputs_ / "masks"; }

  /// KITTI-STEP: everything is of one class.
  void WriteMask(const std::string& name, const cv::Size& size, int train_id) const {
    cv::imwrite((masks() / name).string(), cv::Mat(size, CV_8UC3, cv::Scalar(0, 0, train_id)));
  }

  [[nodiscard]] std::vector<std::string> LiftArguments() const {
    return {"--model",        model().string(), "--masks",
            masks().string(), "--classes",      (kClasses / "cityscapes.json").string()};
  }
  [[nodiscard]] std::vector<std::string> RefineArguments() const {
    return {"--model", model().string(), "--semantics", semantics().string()};
  }
  void ExpectLiftRefused(const std::vector<std::string>& parts) {
    ExpectRefusedWithoutTrace("s3-lift", LiftArguments(), kBadInput, parts);
  }
  void ExpectRefineRefused(const std::vector<std::string>& parts) {
    ExpectRefusedWithoutTrace("s3-refine", RefineArguments(), kBadInput, parts);
  }

  /// Cuts a file down to a part of its bytes.
  static void Truncate(const std::filesystem::path& path, double part) {
    const auto size = static_cast<double>(std::filesystem::file_size(path));
    std::filesystem::resize_file(path, static_cast<uintmax_t>(size * part));
  }

  static constexpr int kRoad = 0;
  TempDir inputs_;
  cv::Size mask_size_;
  std::vector<std::string> mask_names_;
};

}  // namespace s3lam::testing
