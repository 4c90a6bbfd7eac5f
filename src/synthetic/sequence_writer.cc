#include "s3lam/synthetic/sequence_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <utility>
#include <vector>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/progress.h"
#include "s3lam/base/timer.h"
#include "s3lam/io/file.h"
#include "s3lam/io/image_sequence.h"
#include "s3lam/io/trajectory.h"
#include "s3lam/synthetic/render.h"
#include "truth_json.h"

namespace s3lam {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Folder names of the two kinds of masks, clean and noisy.
struct Layout {
  const char* images;
  const char* mask_folders[2];
  const char* frame_format;
};
Layout LayoutOf(const Scene& scene) {
  if (scene.layout == SequenceLayout::kKittiStep) {
    return {"image_0", {"panoptic", "panoptic_noisy"}, "{:06d}"};
  }
  return {"rgb", {"panoptic_clean", "panoptic_noisy"}, "frame-{:06d}"};
}
constexpr const char* kTruthFiles[2] = {"truth_clean.json", "truth_noisy.json"};

// Without parameters OpenCV writes PNGs with one filter and run lengths; a compression level, even
// the lowest, makes it try all filters for every row.
const std::vector<int> kFastPng;

// What remains of a frame when its files are written.
struct FrameRecord {
  std::array<json, 2> annotations;
  std::array<json, 2> truth;
  std::vector<int> missed;
  std::array<size_t, 2> num_segments{};
  size_t num_things = 0;
  size_t num_wrong_class = 0;
};

std::string FrameName(const Layout& layout, int frame) {
  return fmt::format(fmt::runtime(layout.frame_format), frame);
}

void WriteEncoded(const fs::path& path, const cv::Mat& image, const std::vector<int>& parameters) {
  std::vector<uint8_t> bytes;
  S3LAM_CHECK(cv::imencode(path.extension().string(), image, bytes, parameters));
  WriteFile(path, [&](std::ostream& stream) {
    stream.write(reinterpret_cast<const char*>(bytes.data()),
                 static_cast<std::streamsize>(bytes.size()));
  });
}

// Id = R + 256 G + 65536 B; void is 0 (COCO) or R = 255 (KITTI-STEP).
cv::Mat EncodeMask(const SegmentImage& ids, SequenceLayout layout) {
  const uint32_t no_segment = layout == SequenceLayout::kKittiStep ? 255 : 0;
  cv::Mat image(static_cast<int>(ids.rows()), static_cast<int>(ids.cols()), CV_8UC3);
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<cv::Vec3b>(y);
    for (int x = 0; x < image.cols; ++x) {
      const uint32_t id = ids(y, x) == kNoSegment ? no_segment : ids(y, x);
      row[x] = cv::Vec3b(static_cast<uint8_t>(id >> 16), static_cast<uint8_t>(id >> 8),
                         static_cast<uint8_t>(id));
    }
  }
  return image;
}

class Writer {
 public:
  Writer(const Scene& scene, const SequenceWriterOptions& options, const fs::path& directory)
      : scene_(scene), options_(options), layout_(LayoutOf(scene)), directory_(directory) {}

  void MakeFolders() const {
    fs::create_directory(directory_ / layout_.images);
    for (const char* folder : layout_.mask_folders) fs::create_directory(directory_ / folder);
  }
  [[nodiscard]] FrameRecord WriteFrame(const Renderer& renderer, int frame) const;
  void WriteCameraAndTimes() const;
  void WriteMaskFiles(const std::vector<FrameRecord>& records) const;

 private:
  [[nodiscard]] std::string ImageName(int frame) const {
    return fmt::format("{}/{}.{}", layout_.images, FrameName(layout_, frame),
                       options_.image_format);
  }

  const Scene& scene_;
  const SequenceWriterOptions& options_;
  Layout layout_;
  const fs::path& directory_;
};

FrameRecord Writer::WriteFrame(const Renderer& renderer, int frame) const {
  constexpr int kJpegQuality = 95;
  const RenderedFrame rendered = renderer.Render(frame);
  const bool is_jpeg = options_.image_format == "jpg";
  WriteEncoded(directory_ / ImageName(frame), rendered.image,
               is_jpeg ? std::vector<int>{cv::IMWRITE_JPEG_QUALITY, kJpegQuality} : kFastPng);
  const SyntheticPanoptic masks[2] = {
      MakePanoptic(scene_, frame, rendered.labels),
      MakeCorruptedPanoptic(scene_, frame, rendered.labels, options_.masks)};
  FrameRecord record;
  const std::string mask_name = FrameName(layout_, frame) + ".png";
  for (int kind = 0; kind < 2; ++kind) {
    WriteEncoded(directory_ / layout_.mask_folders[kind] / mask_name,
                 EncodeMask(masks[kind].frame.segment_ids, scene_.layout), kFastPng);
    record.annotations[kind] = synthetic::AnnotationJson(scene_, masks[kind], frame, mask_name);
    record.truth[kind] = synthetic::FrameTruthJson(scene_, masks[kind]);
    record.num_segments[kind] = masks[kind].frame.segments.size();
  }
  for (const auto& [id, segment] : masks[0].frame.segments) {
    record.num_things +=
        scene_.class_table.classes[static_cast<size_t>(segment.class_index)].is_thing ? 1 : 0;
  }
  for (const auto& [id, truth] : masks[1].truth) {
    const bool wrong = std::any_of(truth.corruption.begin(), truth.corruption.end(),
                                   [](const CorruptionNote& n) { return n.type == "class"; });
    record.num_wrong_class += wrong ? 1 : 0;
  }
  // Only what the clean mask shows can be missed.
  std::set<int> shown;
  for (const auto& [id, truth] : masks[0].truth) shown.insert(truth.object);
  for (const int object : masks[1].missed) {
    if (shown.count(object) > 0) record.missed.push_back(object);
  }
  return record;
}

void Writer::WriteCameraAndTimes() const {
  if (scene_.layout == SequenceLayout::kTumCoco) {
    WriteCameraJson({scene_.camera, scene_.fps}, directory_ / "camera.json");
    WriteFile(directory_ / "rgb.txt", [&](std::ostream& stream) {
      stream << "# timestamp filename\n";
      for (int i = 0; i < scene_.num_frames; ++i) {
        stream << fmt::format("{:.6f} {}\n", scene_.TimeOf(i), ImageName(i));
      }
    });
    return;
  }
  WriteFile(directory_ / "calib.txt", [&](std::ostream& stream) {
    const Camera& camera = scene_.camera;  // KITTI counts the centre of the first pixel as 0.
    stream << fmt::format(
        "P0: {0:.12e} {4:.12e} {2:.12e} {4:.12e} {4:.12e} {1:.12e} {3:.12e} "
        "{4:.12e} {4:.12e} {4:.12e} {5:.12e} {4:.12e}\n",
        camera.FocalX(), camera.FocalY(), camera.PrincipalX() - 0.5, camera.PrincipalY() - 0.5, 0.0,
        1.0);
  });
  WriteFile(directory_ / "times.txt", [&](std::ostream& stream) {
    for (int i = 0; i < scene_.num_frames; ++i) {
      stream << fmt::format("{:.6e}\n", scene_.TimeOf(i));
    }
  });
}

void Writer::WriteMaskFiles(const std::vector<FrameRecord>& records) const {
  json images = json::array();
  json annotations[2] = {json::array(), json::array()};
  json truth[2];
  for (size_t i = 0; i < records.size(); ++i) {
    const int frame = static_cast<int>(i);
    const std::string mask_name = FrameName(layout_, frame) + ".png";
    images.push_back({{"id", frame},
                      {"file_name", fs::path(ImageName(frame)).filename().string()},
                      {"width", scene_.camera.width},
                      {"height", scene_.camera.height}});
    for (int kind = 0; kind < 2; ++kind) {
      annotations[kind].push_back(records[i].annotations[kind]);
      truth[kind]["frames"][mask_name] = records[i].truth[kind];
    }
    truth[1]["missed"][mask_name] = records[i].missed;
  }
  const auto write = [&](const std::string& name, const json& content) {
    WriteFile(directory_ / name, [&](std::ostream& stream) { stream << content.dump() << "\n"; });
  };
  for (int kind = 0; kind < 2; ++kind) {
    write(kTruthFiles[kind], truth[kind]);
    if (scene_.layout != SequenceLayout::kTumCoco) continue;
    write(
        std::string(layout_.mask_folders[kind]) + ".json",
        {{"info",
          {{"description", fmt::format("synthetic scene {}, seed {}", scene_.name, scene_.seed)}}},
         {"images", images},
         {"annotations", annotations[kind]},
         {"categories", synthetic::CategoriesJson(scene_.class_table)}});
  }
}

Trajectory GroundTruth(const Scene& scene) {
  Trajectory trajectory;
  for (int i = 0; i < scene.num_frames; ++i) {
    trajectory.push_back({scene.TimeOf(i), scene.WorldFromCamera(i)});
  }
  return trajectory;
}

void Summarise(const Scene& scene, const Trajectory& trajectory,
               const std::vector<FrameRecord>& records, SequenceWriterReport& report) {
  report.num_frames = scene.num_frames;
  report.num_objects = static_cast<int>(scene.objects.size());
  for (const SceneObject& object : scene.objects) {
    report.num_planar_objects += object.plane_in_world ? 1 : 0;
  }
  for (size_t i = 1; i < trajectory.size(); ++i) {
    report.path_length_m += (trajectory[i].world_from_camera.translation -
                             trajectory[i - 1].world_from_camera.translation)
                                .norm();
  }
  double things = 0.0;
  double missed = 0.0;
  double wrong = 0.0;
  for (const FrameRecord& record : records) {
    report.segments_clean += static_cast<double>(record.num_segments[0]);
    report.segments_noisy += static_cast<double>(record.num_segments[1]);
    things += static_cast<double>(record.num_things);
    missed += static_cast<double>(record.missed.size());
    wrong += static_cast<double>(record.num_wrong_class);
  }
  report.missed_share = missed / std::max(1.0, things);
  report.wrong_class_share = wrong / std::max(1.0, report.segments_noisy);
  report.segments_clean /= static_cast<double>(records.size());
  report.segments_noisy /= static_cast<double>(records.size());
}

}  // namespace

SequenceWriterReport WriteSequence(const Scene& scene, const SequenceWriterOptions& options,
                                   const fs::path& directory, int num_threads) {
  if (options.image_format != "jpg" && options.image_format != "png") {
    throw UsageError(
        fmt::format("image_format: '{}' is unknown, expected jpg or png", options.image_format));
  }
  SequenceWriterReport report;
  const Timer setup_timer;
  const Renderer renderer(scene, num_threads);
  report.setup_seconds = setup_timer.Seconds();

  const Timer render_timer;
  const Writer writer(scene, options, directory);
  writer.MakeFolders();
  std::vector<FrameRecord> records(static_cast<size_t>(scene.num_frames));
  Progress progress("rendering", scene.num_frames);
  const size_t batch = 4 * static_cast<size_t>(ResolveThreads(num_threads));
  for (size_t begin = 0; begin < records.size(); begin += batch) {
    const size_t count = std::min(batch, records.size() - begin);
    ParallelFor(count, num_threads, [&](size_t i) {
      records[begin + i] = writer.WriteFrame(renderer, static_cast<int>(begin + i));
    });
    progress.Update(static_cast<int64_t>(begin + count));
  }
  report.render_seconds = render_timer.Seconds();

  const Trajectory trajectory = GroundTruth(scene);
  WriteTumTrajectory(trajectory, directory / "groundtruth.txt");
  writer.WriteCameraAndTimes();
  writer.WriteMaskFiles(records);
  WriteJson(directory / "objects.json", synthetic::ObjectsJson(scene));
  Summarise(scene, trajectory, records, report);
  return report;
}

}  // namespace s3lam
