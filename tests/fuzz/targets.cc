#include "fuzz/targets.h"

#include <array>
#include <cstdlib>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <sstream>
#include <string>

#include "fuzz/scratch.h"
#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"
#include "s3lam/io/camera_guess.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/descriptors.h"
#include "s3lam/io/file.h"
#include "s3lam/io/frame_observations.h"
#include "s3lam/io/image_file.h"
#include "s3lam/io/image_sequence.h"
#include "s3lam/io/keypoint_sigmas.h"
#include "s3lam/io/label_map.h"
#include "s3lam/io/npy.h"
#include "s3lam/io/panoptic_masks.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/io/trajectory.h"
#include "support/temp_dir.h"

namespace s3lam::fuzz {
namespace {

namespace fs = std::filesystem;

/// What was accepted has to have this property.
void Require(bool holds, const char* what) {
  if (holds) return;
  std::cerr << "fuzz: does not hold: " << what << std::endl;
  std::abort();
}

using ModelReader = void (*)(std::istream&, const std::string&, Reconstruction&);
using ModelWriter = void (*)(const Reconstruction&, std::ostream&);

/// What is read comes out again the same: read(write(x)) writes the same bytes as x.
template <ModelReader read, ModelWriter write>
void ModelFile(std::string_view bytes) {
  std::istringstream stream{std::string(bytes)};
  Reconstruction model;
  read(stream, "input", model);
  std::ostringstream once;
  write(model, once);
  std::istringstream again(once.str());
  Reconstruction reread;
  read(again, "written", reread);
  std::ostringstream twice;
  write(reread, twice);
  Require(once.str() == twice.str(), "a model is read as it was written");
}

/// Three files behind one another, each with its length before it in two bytes.
void WholeModel(std::string_view bytes) {
  static const testing::TempDir scratch;
  const fs::path& directory = scratch.path();
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    size_t size = bytes.size() < 2 ? 0
                                   : static_cast<uint8_t>(bytes[0]) +
                                         256 * static_cast<size_t>(static_cast<uint8_t>(bytes[1]));
    bytes.remove_prefix(std::min<size_t>(bytes.size(), 2));
    size = std::min(size, bytes.size());
    WriteFile(directory / name, [&](std::ostream& stream) { stream << bytes.substr(0, size); });
    bytes.remove_prefix(size);
  }
  Reconstruction model = ReadColmapModel(directory);
  UpdatePointErrors(model);
  ComputeReprojectionStatistics(model);
  for (const auto& [id, image] : model.images) {
    Require(IsNameWithin(image.name), "an image's name stays within its folder");
  }
}

void Descriptors(std::string_view bytes) {
  std::istringstream stream{std::string(bytes)};
  std::ostringstream written;
  WriteDescriptors(ReadDescriptors(stream, "input"), written);
  Require(written.str() == bytes, "descriptors are written as they were read");
}

void Npy(std::string_view bytes) {
  std::istringstream stream{std::string(bytes)};
  const MatrixXfRow matrix = ReadNpy(stream, "input");
  Require(static_cast<size_t>(matrix.size()) * sizeof(float) <= bytes.size(),
          "an array is no larger than its file");
}

void TrajectoryFile(std::string_view bytes) {
  const Trajectory trajectory = ReadTrajectory(PathOf(bytes));
  std::stringstream stream;
  WriteTumTrajectory(trajectory, stream);
  Require(ReadTumTrajectory(stream, "written").size() == trajectory.size(),
          "a trajectory is read as it was written");
}

void ClassTableFile(std::string_view bytes) {
  Require(ReadClassTable(PathOf(bytes)).size() > 0, "a class table has classes");
}

void CameraFileJson(std::string_view bytes) {
  const Camera camera = ReadCameraJson(PathOf(bytes)).camera;
  camera.Check("camera");
  const auto ray = camera.CameraFromImage(Eigen::Vector2d(0.5, 0.5));
  Require(!ray || ray->allFinite(), "a ray is finite");
}

enum class Mode { kOff, kOn };
struct InnerOptions {
  int count = 3;
  double size = 0.5;
  Mode mode = Mode::kOff;
  void Visit(OptionVisitor& v) {
    static constexpr std::array<std::string_view, 2> kNames = {"off", "on"};
    v.Value("count", count, "a count", 1, 100);
    v.Value("size", size, "a size [m]", 0.0, 1.0);
    v.Choice("mode", mode, kNames, "a choice");
  }
};
struct OuterOptions {
  bool enabled = true;
  std::string name = "x";
  std::vector<std::string> names = {"a"};
  std::vector<double> numbers = {1.0};
  InnerOptions inner;
  void Visit(OptionVisitor& v) {
    v.Value("enabled", enabled, "a switch");
    v.Value("name", name, "a name");
    v.Value("names", names, "names");
    v.Value("numbers", numbers, "numbers");
    v.Group("inner", inner, "a group");
  }
};

void CheckReadBack(const OuterOptions& options) {
  CheckOptions(options);
  OuterOptions again;
  OptionsFromJson(OptionsToJson(options), again, "written");
  Require(OptionsToJson(again) == OptionsToJson(options), "options are read as they were written");
}

void ConfigJson(std::string_view bytes) {
  OuterOptions options;
  OptionsFromJson(ReadJson(PathOf(bytes)), options, "input");
  CheckReadBack(options);
}

void SetArgument(std::string_view bytes) {
  OuterOptions options;
  SetOption(bytes, options);
  ParseFrameRange("1:2:3");
  CheckReadBack(options);
}

void FrameRangeArgument(std::string_view bytes) {
  const FrameRange range = ParseFrameRange(std::string(bytes));
  Require(range.first >= 0 && range.step > 0, "a frame range goes forwards");
}

/// A folder with a valid distributions.npy of two points and two classes.
void SemanticsJson(std::string_view bytes) {
  static const testing::TempDir scratch;
  const fs::path& directory = scratch.path();
  static const bool once [[maybe_unused]] = [&] {
    WriteNpy(MatrixXfRow::Constant(2, 2, 0.5F), directory / "distributions.npy");
    return true;
  }();
  WriteFile(directory / "semantics.json", [&](std::ostream& stream) { stream << bytes; });
  const SemanticMap map = ReadSemanticMap(directory);
  WritePlanesPly(map, PathOf({}));
}

ClassTable SmallTable() {
  ClassTable table;
  table.name = "small";
  for (const int id : {0, 1, 7}) {
    SemanticClass c;
    c.id = id;
    c.name = std::to_string(id);
    c.is_thing = id == 1;
    table.classes.push_back(c);
  }
  return table;
}

/// A folder of one mask, a.png, and its JSON beside it; either of the two is the input.
struct MaskFolder {
  testing::TempDir scratch;
  fs::path directory = scratch / "masks";
  fs::path json = scratch / "masks.json";

  MaskFolder() {
    fs::create_directory(directory);
    WritePng(PngOfTwoSegments());
    WriteJsonText(R"({"annotations": [{"file_name": "a.png", "segments_info": [
      {"id": 1, "category_id": 1}, {"id": 263, "category_id": 7, "iscrowd": 0, "score": 0.5}]}]})");
  }
  static std::string PngOfTwoSegments() {
    cv::Mat image(4, 5, CV_8UC3, cv::Scalar(0, 0, 1));
    image.row(2).setTo(cv::Scalar(0, 1, 7));
    std::vector<uint8_t> bytes;
    cv::imencode(".png", image, bytes);
    return {bytes.begin(), bytes.end()};
  }
  void WritePng(std::string_view bytes) const {
    WriteFile(directory / "a.png", [&](std::ostream& stream) { stream << bytes; });
  }
  void WriteJsonText(std::string_view bytes) const {
    WriteFile(json, [&](std::ostream& stream) { stream << bytes; });
  }
  void Read(MaskFormat format) const {
    const PanopticMasks masks(directory, format, {}, SmallTable());
    const PanopticFrame frame = masks.Read(0);
    for (Eigen::Index i = 0; i < frame.segment_ids.size(); ++i) {
      const uint32_t id = frame.segment_ids.data()[i];
      Require(id == kNoSegment || frame.segments.contains(id), "every segment is described");
    }
  }
};

void CocoJson(std::string_view bytes) {
  static const MaskFolder folder;
  folder.WriteJsonText(bytes);
  folder.Read(MaskFormat::kCoco);
}

void CocoPng(std::string_view bytes) {
  static const MaskFolder folder;
  folder.WritePng(bytes);
  folder.Read(MaskFormat::kCoco);
}

void KittiStepPng(std::string_view bytes) {
  static const MaskFolder folder;
  folder.WritePng(bytes);
  folder.Read(MaskFormat::kKittiStep);
}

/// A folder whose one mask is the input, in a format that needs no JSON.
template <MaskFormat format>
void SingleMask(std::string_view bytes, const char* name) {
  static const testing::TempDir scratch;
  scratch.Write(name, bytes);
  const PanopticMasks masks(scratch.path(), format, {}, SmallTable());
  const PanopticFrame frame = masks.Read(0);
  Require(frame.segment_ids.size() > 0, "a mask has pixels");
}
void CityscapesPng(std::string_view bytes) { SingleMask<MaskFormat::kCityscapes>(bytes, "a.png"); }
void LabelsPng(std::string_view bytes) { SingleMask<MaskFormat::kLabels>(bytes, "a.png"); }
void DivisorNpy(std::string_view bytes) { SingleMask<MaskFormat::kLabelDivisor>(bytes, "a.npy"); }
void VolumeNpz(std::string_view bytes) { SingleMask<MaskFormat::kProbabilities>(bytes, "a.npz"); }

/// A PNG of the segments 1 and 263 and the JSON beside it, which is the input.
void SegmentsJson(std::string_view bytes) {
  static const testing::TempDir scratch;
  scratch.Write("a.png", MaskFolder::PngOfTwoSegments());
  scratch.Write("a.json", bytes);
  const PanopticMasks masks(scratch.path(), MaskFormat::kSegments, {}, SmallTable());
  Require(masks.Read(0).segment_ids.size() > 0, "a mask has pixels");
}

void LabelMapJson(std::string_view bytes) {
  Require(!ReadLabelMap(PathOf(bytes)).IsIdentity(), "a label map is not empty");
}

void Observations(std::string_view bytes) {
  std::istringstream stream{std::string(bytes)};
  std::ostringstream written;
  WriteFrameObservations(ReadFrameObservations(stream, "input"), written);
  Require(written.str() == bytes, "observations are written as they were read");
}

void Sigmas(std::string_view bytes) {
  std::istringstream stream{std::string(bytes)};
  std::ostringstream written;
  WriteKeypointSigmas(ReadKeypointSigmas(stream, "input"), written);
  Require(written.str() == bytes, "sigmas are written as they were read");
}

void ImageFileBytes(std::string_view bytes) {
  const fs::path path = PathOf(bytes);
  const cv::Mat image = ReadImageFile(path, cv::IMREAD_ANYCOLOR);
  Require(!image.empty() && image.depth() == CV_8U, "an image has pixels of 8 bits");
  const cv::Size size = ReadImageSize(path);
  Require(size == image.size(), "an image has the size that its header says");
}

/// A sequence whose one file of text is the input; its images are named 0.png, 1.png, 2.png.
class SequenceFolder {
 public:
  SequenceFolder(SequenceFormat format, const fs::path& images, fs::path input)
      : format_(format), input_(std::move(input)) {
    fs::create_directories(root_.path() / images);
    for (const char* image : {"0.png", "1.png", "2.png"}) {
      Write(images / image, MaskFolder::PngOfTwoSegments());
    }
  }
  const SequenceFolder& Write(const fs::path& name, std::string_view bytes) const {
    fs::create_directories((root_ / name).parent_path());
    WriteFile(root_ / name, [&](std::ostream& stream) { stream << bytes; });
    return *this;
  }
  void Open(std::string_view bytes) const {
    Write(input_, bytes);
    const ImageSequence sequence = OpenSequence(root_.path(), format_);
    Require(!sequence.frames.empty(), "a sequence has frames");
    for (const SequenceFrame& frame : sequence.frames) {
      Require(IsNameWithin(frame.name), "a frame's name stays within its folder");
    }
    if (sequence.camera) sequence.camera->Check("camera");
  }

 private:
  SequenceFormat format_;
  testing::TempDir root_;
  fs::path input_;
};

void Exif(std::string_view bytes) {
  const auto focal = ExifFocalLength(bytes, 640, 480);
  Require(!focal || (*focal > 100.0 && *focal < 20000.0), "a focal length is that of a lens");
}

void TumList(std::string_view bytes) {
  static const SequenceFolder folder(SequenceFormat::kTum, "rgb", "rgb.txt");
  folder.Open(bytes);
}

void KittiTimes(std::string_view bytes) {
  static const SequenceFolder folder(SequenceFormat::kKitti, "image_0", "times.txt");
  folder.Open(bytes);
}

void KittiCalibration(std::string_view bytes) {
  static const SequenceFolder folder(SequenceFormat::kKitti, "image_0", "calib.txt");
  static const auto& with_times = folder.Write("times.txt", "0\n0.1\n0.2\n");
  with_times.Open(bytes);
}

void KittiRawTimes(std::string_view bytes) {
  static const SequenceFolder folder(SequenceFormat::kKittiRaw, "image_00/data",
                                     "image_00/timestamps.txt");
  folder.Open(bytes);
}

void EurocList(std::string_view bytes) {
  static const SequenceFolder folder(SequenceFormat::kEuroc, "mav0/cam0/data",
                                     "mav0/cam0/data.csv");
  folder.Open(bytes);
}

void EurocSensor(std::string_view bytes) {
  static const SequenceFolder folder(SequenceFormat::kEuroc, "mav0/cam0/data",
                                     "mav0/cam0/sensor.yaml");
  static const auto& with_list =
      folder.Write("mav0/cam0/data.csv", "#\n10,0.png\n20,1.png\n30,2.png\n");
  with_list.Open(bytes);
}

constexpr std::array kTargets = {
    Target{"cameras_bin", ModelFile<ReadCamerasBinary, WriteCamerasBinary>},
    Target{"images_bin", ModelFile<ReadImagesBinary, WriteImagesBinary>},
    Target{"points_bin", ModelFile<ReadPointsBinary, WritePointsBinary>},
    Target{"cameras_txt", ModelFile<ReadCamerasText, WriteCamerasText>},
    Target{"images_txt", ModelFile<ReadImagesText, WriteImagesText>},
    Target{"points_txt", ModelFile<ReadPointsText, WritePointsText>},
    Target{"whole_model", WholeModel},
    Target{"descriptors", Descriptors},
    Target{"npy", Npy},
    Target{"trajectory", TrajectoryFile},
    Target{"class_table", ClassTableFile},
    Target{"camera_json", CameraFileJson},
    Target{"config_json", ConfigJson},
    Target{"set_argument", SetArgument},
    Target{"frame_range", FrameRangeArgument},
    Target{"semantics_json", SemanticsJson},
    Target{"coco_json", CocoJson},
    Target{"coco_png", CocoPng},
    Target{"kitti_step_png", KittiStepPng},
    Target{"cityscapes_png", CityscapesPng},
    Target{"labels_png", LabelsPng},
    Target{"divisor_npy", DivisorNpy},
    Target{"volume_npz", VolumeNpz},
    Target{"segments_json", SegmentsJson},
    Target{"label_map", LabelMapJson},
    Target{"observations", Observations},
    Target{"keypoint_sigmas", Sigmas},
    Target{"image_file", ImageFileBytes},
    Target{"exif", Exif},
    Target{"tum_list", TumList},
    Target{"kitti_times", KittiTimes},
    Target{"kitti_calib", KittiCalibration},
    Target{"kitti_raw_times", KittiRawTimes},
    Target{"euroc_list", EurocList},
    Target{"euroc_sensor", EurocSensor},
};

}  // namespace

std::span<const Target> Targets() { return kTargets; }

const Target& FindTarget(std::string_view name) {
  for (const Target& target : kTargets) {
    if (target.name == name) return target;
  }
  throw std::invalid_argument("no fuzz target is called " + std::string(name));
}

void RunInput(const Target& target, std::string_view bytes) {
  try {
    target.run(bytes);
  } catch (const InputError&) {
  } catch (const UsageError&) {
  }
}

}  // namespace s3lam::fuzz
