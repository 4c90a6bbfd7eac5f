#include "video_capture.h"

#include <opencv2/videoio/registry.hpp>

namespace s3lam::internal {

bool OpenVideoFile(const std::filesystem::path& path, cv::VideoCapture& capture) {
  for (const cv::VideoCaptureAPIs backend : cv::videoio_registry::getStreamBackends()) {
    if (backend == cv::CAP_GPHOTO2 || backend == cv::CAP_V4L2) continue;
    if (capture.open(path.string(), backend) && capture.isOpened()) return true;
  }
  return false;
}

}  // namespace s3lam::internal
