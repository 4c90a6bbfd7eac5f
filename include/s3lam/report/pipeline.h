#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/core/mat.hpp>
#include <string>
#include <utility>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/eval/trajectory_error.h"
#include "s3lam/report/drawing.h"
#include "s3lam/report/overlay.h"
#include "s3lam/report/run_folder.h"

namespace s3lam::report {

struct Options {
  TrajectoryAlignment align = TrajectoryAlignment::kSim3;
  double max_dt_s = 0.02;
  int histogram_bins = 60;
  int view_width = 620;     // px, of the views of the map
  int gallery_images = 12;  // At most so many keyframes, evenly spread.
  int gallery_width = 480;  // px
  int jpeg_quality = 85;    // Of the keyframes in the page.
  void Visit(OptionVisitor& v);
};

struct Input {
  RunFolder run;
  Trajectory truth;                       // Empty: none was given.
  std::filesystem::path image_directory;  // Empty: the one the run noted, if it is still there.
};

/// One picture of the report: strokes, or pixels (8-bit BGR).
struct Figure {
  std::string section;  // "trust", "trajectory", "residuals", "map", "keyframes"
  std::string name;     // Of its file, without extension.
  std::string caption;
  std::variant<Drawing, cv::Mat> picture;
};

struct Table {
  std::string title;
  std::vector<std::string> header;
  std::vector<std::vector<std::string>> rows;
  size_t num_text_columns = 1;  // The first columns hold text, the others numbers.
};

struct Report {
  std::vector<std::string> doubts;   // Sentences: what is not to be relied on.
  std::vector<std::string> missing;  // Sentences: what is not in the report, and why.
  size_t num_points = 0;
  size_t num_figures = 0;
  Table summary;  // One column per arm.
};

struct Output {
  std::string html;             // The whole page.
  std::vector<Figure> figures;  // All pictures of the page but the 3D view.
};

/// Puts all arms into one frame, measures and draws them, and writes the page. Throws InputError
/// for images that were asked for and cannot be read.
Report Run(const Options& options, const Input& input, Output& output);

nlohmann::json ToJson(const Report& report);
/// A few lines for people.
std::string ToText(const Report& report);

}  // namespace s3lam::report
