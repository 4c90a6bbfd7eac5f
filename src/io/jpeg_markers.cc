#include "jpeg_markers.h"

#include <cstdint>

namespace s3lam::internal {
namespace {

// ITU T.81, table B.1.
constexpr uint8_t kStartOfImage = 0xD8;
constexpr uint8_t kEndOfImage = 0xD9;
constexpr uint8_t kStartOfScan = 0xDA;
constexpr uint8_t kApplication1 = 0xE1;

uint8_t ByteAt(std::string_view bytes, size_t i) { return static_cast<uint8_t>(bytes[i]); }

size_t BigEndian16(std::string_view bytes, size_t i) {
  return static_cast<size_t>(ByteAt(bytes, i)) << 8 | ByteAt(bytes, i + 1);
}

/// Markers without a length: TEM and the restart markers.
bool StandsAlone(uint8_t marker) { return marker == 0x01 || (marker >= 0xD0 && marker <= 0xD7); }

bool IsFrameHeader(uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

/// Walks from marker to marker.
class MarkerWalk {
 public:
  explicit MarkerWalk(std::string_view bytes) : bytes_(bytes) {}

  /// Goes to the next marker, over entropy-coded data; false at the end of the file.
  bool Next() {
    while (true) {
      const size_t mark = bytes_.find('\xFF', position_);
      if (mark == std::string_view::npos) return false;
      const size_t code = bytes_.find_first_not_of('\xFF', mark);  // Any number of fill bytes.
      if (code == std::string_view::npos) return false;
      position_ = code + 1;
      marker_ = ByteAt(bytes_, code);
      if (marker_ != 0x00 && !StandsAlone(marker_)) return true;  // 0 is a stuffed data byte.
    }
  }

  /// Skips the segment of the current marker; false if it goes beyond the end.
  bool SkipSegment() {
    if (marker_ == kStartOfImage) return true;
    if (position_ + 2 > bytes_.size()) return false;
    const size_t length = BigEndian16(bytes_, position_);
    if (length < 2 || length > bytes_.size() - position_) return false;
    position_ += length;
    return true;
  }

  [[nodiscard]] uint8_t marker() const { return marker_; }
  /// What follows the marker.
  [[nodiscard]] std::string_view rest() const { return bytes_.substr(position_); }

 private:
  std::string_view bytes_;
  size_t position_ = 0;
  uint8_t marker_ = 0;
};

}  // namespace

bool IsJpeg(std::string_view bytes) { return bytes.starts_with("\xFF\xD8\xFF"); }

bool IsCompleteJpeg(std::string_view bytes) {
  MarkerWalk walk(bytes);
  while (walk.Next()) {
    if (walk.marker() == kEndOfImage) return true;
    if (!walk.SkipSegment()) return false;
  }
  return false;
}

std::optional<cv::Size> JpegSize(std::string_view bytes) {
  MarkerWalk walk(bytes);
  while (walk.Next() && walk.marker() != kStartOfScan && walk.marker() != kEndOfImage) {
    const std::string_view segment = walk.rest();
    if (IsFrameHeader(walk.marker()) && segment.size() >= 7) {
      // Length (2 bytes), precision (1), height (2), width (2).
      return cv::Size(static_cast<int>(BigEndian16(segment, 5)),
                      static_cast<int>(BigEndian16(segment, 3)));
    }
    if (!walk.SkipSegment()) break;
  }
  return std::nullopt;
}

std::string_view ExifSegment(std::string_view bytes) {
  if (!IsJpeg(bytes)) return {};
  constexpr std::string_view kName("Exif\0\0", 6);
  constexpr size_t kLengthBytes = 2;
  MarkerWalk walk(bytes);
  while (walk.Next() && walk.marker() != kStartOfScan && walk.marker() != kEndOfImage) {
    const std::string_view segment = walk.rest();
    if (!walk.SkipSegment()) break;
    if (walk.marker() != kApplication1) continue;
    const std::string_view content = segment.substr(0, segment.size() - walk.rest().size());
    if (content.substr(kLengthBytes).starts_with(kName)) {
      return content.substr(kLengthBytes + kName.size());
    }
  }
  return {};
}

}  // namespace s3lam::internal
