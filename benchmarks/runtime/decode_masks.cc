// Decodes the PNG masks listed in a file, and nothing else: what lifting is measured against.

#include <atomic>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "s3lam/base/parallel.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::cerr << "usage: s3-decode-masks LIST\n";
    return 2;
  }
  std::ifstream list(argv[1]);
  std::vector<std::string> paths;
  for (std::string line; std::getline(list, line);) paths.push_back(line);
  std::atomic<size_t> pixels{0};
  s3lam::ParallelFor(paths.size(), 0, [&](size_t i) {
    pixels += cv::imread(paths[i], cv::IMREAD_UNCHANGED).total();
  });
  std::cout << paths.size() << " masks, " << pixels << " pixels\n";
  return pixels > 0 ? 0 : 1;
}
