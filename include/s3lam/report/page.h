#pragma once

#include <string>
#include <vector>

#include "s3lam/report/pipeline.h"
#include "s3lam/report/viewer_data.h"

namespace s3lam::report {

struct PageContent {
  std::string title;
  std::vector<std::string> doubts;
  std::vector<std::string> missing;
  Table summary;
  ViewerData viewer;
  std::vector<Table> tables;
  std::vector<Figure> figures;
  /// Name and effective configuration of each stage.
  std::vector<std::pair<std::string, nlohmann::json>> configurations;
  int jpeg_quality = 85;
};

/// The whole page: it loads nothing, from the network or from files.
std::string MakePage(const PageContent& content);

}  // namespace s3lam::report
