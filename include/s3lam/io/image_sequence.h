#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/geometry/camera.h"

namespace s3lam {

enum class SequenceFormat { kAuto, kTum, kKitti, kKittiRaw, kEuroc, kFolder, kVideo };

/// "auto", "tum", "kitti", "kitti-raw", "euroc", "folder", "video".
std::optional<SequenceFormat> SequenceFormatFromName(std::string_view name);

/// Frames first, first + step, ... below end (negative end: to the last).
struct FrameRange {
  int first = 0;
  int end = -1;
  int step = 1;
};
/// Parses "A:B:STEP", "A:B", ":B", "A:" (Python's slice rules for what is left out). Throws
/// UsageError.
FrameRange ParseFrameRange(const std::string& text);

struct SequenceFrame {
  double time_s = 0.0;
  std::string name;            // Relative to image_root, unique, as written into the model.
  std::filesystem::path path;  // Of the image file; empty for frames of a video.
  int index = 0;               // Position in the whole sequence, before the frame range.
};

/// An image sequence opened but not read: what frames there are, when, and with which camera.
struct ImageSequence {
  SequenceFormat format = SequenceFormat::kFolder;
  std::filesystem::path image_root;   // What the names are relative to; of a video, its file.
  std::vector<SequenceFrame> frames;  // By increasing time.
  std::optional<Camera> camera;       // What the sequence brings, in COLMAP's pixel convention.
};

/// Whether the camera that a sequence brings is read, or another one will be given.
enum class OwnCamera { kRead, kIgnored };

/// What becomes of listed images that do not exist: an error, or frames for LeaveOutUnusable.
enum class MissingImages { kRefused, kKept };

/// Lists a sequence:
///   tum        rgb.txt ("timestamp path") and the files it names
///   kitti      image_0 (or image_2 ...), times.txt, calib.txt (P0; principal point + 0.5)
///   kitti-raw  image_00/data, image_00/timestamps.txt, calib_cam_to_cam.txt beside or above
///   euroc      mav0/cam0/data.csv, data, sensor.yaml (principal point + 0.5)
///   folder     images in natural order, sub-folders included; times from camera.json's fps, else
///              30 Hz
///   video      any file OpenCV opens
/// kAuto takes the first of these that fits. A camera.json in the folder (or beside the images)
/// wins over what the format brings. Throws InputError naming what is missing or malformed: a
/// listed image that does not exist (unless kept), an empty range, times that do not increase
/// within the range.
ImageSequence OpenSequence(const std::filesystem::path& path, SequenceFormat format,
                           const FrameRange& range = {}, OwnCamera camera = OwnCamera::kRead,
                           MissingImages missing = MissingImages::kRefused);

/// The same, but what frames a video has is for the caller to say; their numbers and times
/// included. A program that calls only this one does not load what decodes videos, which takes most
/// of the time of starting.
using VideoLister = std::function<ImageSequence(const std::filesystem::path&)>;
ImageSequence OpenSequence(const std::filesystem::path& path, SequenceFormat format,
                           const FrameRange& range, const VideoLister& list_video,
                           OwnCamera camera = OwnCamera::kRead,
                           MissingImages missing = MissingImages::kRefused);

/// Of a frame of a video, counted from 0.
std::string NameOfVideoFrame(const std::filesystem::path& video, int index);

/// Reads single frames as 8-bit images. A video is decoded forwards: reading its frames out of
/// order is correct but starts again from its beginning.
class FrameReader {
 public:
  explicit FrameReader(const ImageSequence& sequence);
  ~FrameReader();

  /// 8-bit BGR (three channels) or gray (one), as stored; 16-bit images are scaled to 8, all by
  /// what some frames of the sequence tell of the bits in use: 8, 10, 12, 14 or 16. The index is
  /// that of sequence.frames. Throws InputError naming the file if it cannot be decoded, is cut
  /// short, or is not of the size of sequence.camera.
  [[nodiscard]] cv::Mat Read(size_t frame_index) const;
  /// The same in gray (one channel), which is quicker: a JPEG's colours are not even decoded.
  [[nodiscard]] cv::Mat ReadGray(size_t frame_index) const;
  /// True if Read may be called from several threads at once.
  [[nodiscard]] bool IsThreadSafe() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Decodes every image and takes those out of the sequence that cannot be, or are not of the size
/// of its camera (without one: of most of those that can be decoded). Returns what is wrong with
/// each, a line naming it. Throws the first of these as InputError if no image is left.
std::vector<std::string> LeaveOutUnusable(int num_threads, ImageSequence& sequence);

/// camera.json: {"model": "SIMPLE_RADIAL", "width": 640, "height": 480, "params": [...], "fps": 30}
/// with COLMAP's names, order and pixel convention. Throws InputError naming the file and the key.
struct CameraFile {
  Camera camera;
  std::optional<double> fps;
};
CameraFile ReadCameraJson(const std::filesystem::path& path);
void WriteCameraJson(const CameraFile& file, const std::filesystem::path& path);

}  // namespace s3lam
