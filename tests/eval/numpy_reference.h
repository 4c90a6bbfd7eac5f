#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "s3lam/eval/trajectory_error.h"
#include "support/run_program.h"

namespace s3lam::testing {

/// A Python that has numpy: the first on the path, or the system's own.
inline std::optional<std::string> PythonWithNumpy() {
  for (const char* python : {"python3", "/usr/bin/python3"}) {
    if (RunProgram({python, "-c", "import numpy"}).exit_code == 0) return python;
  }
  return std::nullopt;
}

constexpr double kAgreement = 1e-9;

inline void ExpectSame(const nlohmann::json& reference, const char* name,
                       const ErrorStatistics& statistics) {
  const auto& expected = reference[name];
  EXPECT_EQ(expected["count"], statistics.count) << name;
  const double values[] = {statistics.rmse, statistics.mean, statistics.median,
                           statistics.std,  statistics.min,  statistics.max};
  const char* keys[] = {"rmse", "mean", "median", "std", "min", "max"};
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(expected[keys[i]].get<double>(), values[i], kAgreement) << name << " " << keys[i];
  }
}

inline void ExpectSame(const nlohmann::json& reference, const char* name,
                       const Eigen::Vector3d& value) {
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(reference[name][static_cast<size_t>(i)].get<double>(), value[i], kAgreement)
        << name;
  }
}

inline void ExpectSame(const nlohmann::json& reference, const SegmentErrors& errors) {
  EXPECT_EQ(reference[0].get<double>(), errors.length);
  EXPECT_EQ(reference[1], errors.count);
  EXPECT_NEAR(reference[2].get<double>(), errors.translation_percent / 100.0, kAgreement);
  EXPECT_NEAR(reference[3].get<double>(), errors.rotation_deg_per_length, kAgreement);
}

/// Holds `errors` of two TUM files against tests/eval/trajectory_reference.py on the same files.
inline void ExpectAgreesWithNumpy(const std::string& python, const std::filesystem::path& estimate,
                                  const std::filesystem::path& truth,
                                  const TrajectoryErrors& errors) {
  const TrajectoryErrorOptions& options = errors.options;
  std::vector<std::string> words = {python,
                                    S3LAM_TEST_SOURCE_DIR "/tests/eval/trajectory_reference.py",
                                    estimate.string(),
                                    truth.string(),
                                    std::string(TrajectoryAlignmentName(options.align)),
                                    std::to_string(options.max_dt_s),
                                    std::to_string(options.rpe_delta_frames),
                                    std::to_string(options.rpe_delta_m),
                                    std::to_string(options.segment_step_frames)};
  for (const double length : options.segment_lengths_m) words.push_back(std::to_string(length));
  const ProgramResult result = RunProgram(words);
  ASSERT_EQ(result.exit_code, 0) << result.output;
  const auto reference = nlohmann::json::parse(result.output);
  EXPECT_EQ(reference["num_pairs"], errors.num_pairs);
  EXPECT_NEAR(reference["path_length"].get<double>(), errors.path_length, kAgreement);
  ExpectSame(reference, "ate_translation", errors.ate_translation);
  ExpectSame(reference, "ate_rotation_deg", errors.ate_rotation_deg);
  ExpectSame(reference, "ate_rmse_per_axis", errors.ate_rmse_per_axis);
  ExpectSame(reference, "ate_rmse_in_camera", errors.ate_rmse_in_camera);
  EXPECT_NEAR(reference["ate_rmse_along"].get<double>(), errors.ate_rmse_along, kAgreement);
  EXPECT_NEAR(reference["ate_rmse_across"].get<double>(), errors.ate_rmse_across, kAgreement);
  ExpectSame(reference, "rpe_translation", errors.rpe_translation);
  ExpectSame(reference, "rpe_rotation_deg", errors.rpe_rotation_deg);
  ExpectSame(reference, "rpe_per_length_translation", errors.rpe_per_length.translation);
  ExpectSame(reference, "rpe_per_length_rotation_deg", errors.rpe_per_length.rotation_deg);
  const auto& rows = reference["segments"]["by_length"];
  ASSERT_EQ(rows.size(), errors.segments.by_length.size());
  for (size_t i = 0; i < rows.size(); ++i) ExpectSame(rows[i], errors.segments.by_length[i]);
  ExpectSame(reference["segments"]["all"], errors.segments.all);
}

}  // namespace s3lam::testing
