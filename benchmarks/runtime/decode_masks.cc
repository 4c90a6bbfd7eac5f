// Decodes the PNG masks listed in a file, and nothing else: what lifting is measured against. On
// all cores (0 threads), or as a plain loop does (1).

#include <atomic>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "s3lam/base/parallel.h"

int main(int argc, char** argv) {
  if (argc != 2 && argc != 3) {
    std::cerr << "usage: s3-decode-masks LIST [THREADS]\n";
    return 2;
  }
  const int num_threads = argc == 3 ? std::stoi(argv[2]) : 0;
  std::ifstream list(argv[1]);
  std::vector<std::string> paths;
  for (std::string line; std::getline(list, line);) paths.push_back(line);
  std::atomic<size_t> pixels{0};
  s3lam::ParallelFor(paths.size(), num_threads, [&](size_t i) {
    pixels += cv::imread(paths[i], cv::IMREAD_UNCHANGED).total();
  });
  std::cout << paths.size() << " masks, " << pixels << " pixels\n";
  return pixels > 0 ? 0 : 1;
}
