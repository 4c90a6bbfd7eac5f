#include <fmt/format.h>

#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "common/config_files.h"
#include "common/program.h"
#include "common/provenance.h"
#include "lift/ignore_masks.h"
#include "lift/mask_arguments.h"
#include "s3lam/base/error.h"
#include "s3lam/base/log.h"
#include "s3lam/base/output_directory.h"
#include "s3lam/base/parallel.h"
#include "s3lam/io/colmap_model.h"
#include "s3lam/io/descriptors.h"
#include "s3lam/io/file.h"
#include "s3lam/io/npy.h"
#include "s3lam/io/panoptic_masks.h"
#include "s3lam/io/semantic_map_io.h"
#include "s3lam/report/keyframe_pictures.h"
#include "s3lam/semantics/pipeline.h"

namespace s3lam::tools {
namespace {

namespace fs = std::filesystem;
namespace po = boost::program_options;
using nlohmann::json;

constexpr const char* kDescription =
    "Stage 2: lifts panoptic masks onto the points of a COLMAP model.\n\n"
    "Reads a COLMAP model (binary or text; descriptors.bin beside it if there), a folder of\n"
    "panoptic masks whose names match the images, and a class table (configs/classes/).\n"
    "Writes semantics.json (clusters, planes), distributions.npy (float32, points x classes, rows\n"
    "as \"points\" of semantics.json), planes.ply, points.ply, report.json, config.json, and the\n"
    "model coloured by class and by cluster in model_by_class/ and model_by_cluster/; with\n"
    "--confusion or fusion.confusion=estimated, confusion.npy, the matrix used (float32, true\n"
    "class x class in the masks, rows sum to one); with --overlays, pictures of images in\n"
    "overlays/: keypoints in the colours of their classes, planes with their outlines, normals\n"
    "and axes.\n\n"
    "With --sequence in place of a model: writes gray PNGs, 0 on what moves and 255 elsewhere, of\n"
    "the size of the images, as <image name>.png; report.json, config.json.";

po::options_description Arguments() {
  po::options_description description("s3-lift");
  auto add = description.add_options();
  add("model", po::value<std::string>()->value_name("DIR"), "COLMAP model");
  add("sequence", po::value<std::string>()->value_name("DIR"),
      "instead of a model: write what to ignore in its images, for s3-slam --ignore-masks or "
      "COLMAP's --ImageReader.mask_path; of a video, those frames that masks are named after "
      "(clip.mp4: clip_000000.png). Of the configuration, lookup.lenient alone has an effect on "
      "it");
  add("ignore-margin", po::value<int>()->default_value(3)->value_name("PX"),
      "around what is ignored [mask px]");
  add("masks", po::value<std::string>()->value_name("DIR"), "panoptic masks");
  add("mask-format", po::value<std::string>()->default_value("auto"),
      "auto, coco, kitti-step, cityscapes, scannet, labels, label-divisor, segments, "
      "probabilities");
  add("mask-json", po::value<std::string>()->default_value("")->value_name("FILE"),
      "COCO panoptic JSON (default: <masks>.json, or the one in the folder)");
  add("label-map", po::value<std::string>()->default_value("")->value_name("FILE"),
      "what the labels in the masks are in the class table (configs/label_maps/, ScanNet's .tsv); "
      "with tables of things and of stuff where these are numbered apart, as by detectron2's "
      "Panoptic FPN (coco_separated)");
  add("label-divisor", po::value<int>()->default_value(1000)->value_name("N"),
      "of the format label-divisor: N * label + instance");
  add("confusion", po::value<std::string>()->default_value("")->value_name("FILE.npy"),
      "confusion matrix of the masks, float32, true class x class in the masks");
  add("classes", po::value<std::string>()->value_name("FILE.json"),
      "class table: a file, or a name such\nas coco or cityscapes");
  add("output", po::value<std::string>()->value_name("DIR"), "folder to write");
  add("overlays", po::value<std::string>()->default_value("0")->value_name("N|all|NAME,..."),
      "draw keypoints and planes onto so many images, all, or those named");
  add("images", po::value<std::string>()->default_value("")->value_name("DIR"),
      "where they are (default: what the model's project.ini says, if relative from here or from "
      "the model)");
  add("lenient", po::bool_switch(), "skip and count masks that cannot be used");
  return description;
}

/// The masks of a model's images.
class MaskSource {
 public:
  MaskSource(const PanopticMasks& masks, const Reconstruction& model) : masks_(masks) {
    std::vector<std::string> names;
    std::vector<ImageId> ids;
    for (const auto& [id, image] : model.images) {
      names.push_back(image.name);
      ids.push_back(id);
    }
    const auto matches = MatchMasksToImages(names, masks_.names());
    for (size_t i = 0; i < ids.size(); ++i) {
      if (matches[i]) mask_of_image_.emplace(ids[i], *matches[i]);
    }
  }

  /// Whoever makes masks of every n-th frame meets few of the keyframes; the masks of the others
  /// come to nothing. Where none fits at all, lifting says so.
  void WarnIfMostAreOfOthers(const Reconstruction& model) const {
    const size_t num_images = model.images.size();
    const size_t num_found = mask_of_image_.size();
    const size_t num_unused = masks_.names().size() - num_found;
    if (num_found == 0 || num_unused == 0 || 2 * num_found >= num_images) return;
    spdlog::warn(
        "{} of the model's {} images have no mask, and {} of {} masks belong to no image of the "
        "model: make masks of the model's images (of a sequence, its keyframes); images_unmasked "
        "in report.json names those without one",
        num_images - num_found, num_images, num_unused, masks_.names().size());
  }

  [[nodiscard]] std::vector<std::string> NamesWithoutMask(const Reconstruction& model) const {
    std::vector<std::string> names;
    for (const auto& [id, image] : model.images) {
      if (!mask_of_image_.contains(id)) names.push_back(image.name);
    }
    return names;
  }

  [[nodiscard]] std::optional<PanopticFrame> Read(const Image& image) const {
    const auto it = mask_of_image_.find(image.id);
    if (it == mask_of_image_.end()) return std::nullopt;
    return masks_.Read(it->second);
  }

 private:
  const PanopticMasks& masks_;
  std::map<ImageId, size_t> mask_of_image_;
};

json ReportToJson(const LiftReport& report, const ClassTable& table) {
  json classes = json::array();
  for (const auto& [index, counts] : report.classes) {
    const SemanticClass& c = table.classes[static_cast<size_t>(index)];
    classes.push_back({{"id", c.id},
                       {"name", c.name},
                       {"points", counts.points},
                       {"clusters", counts.clusters},
                       {"planes", counts.planes},
                       {"plane_inliers", counts.plane_inliers}});
  }
  return {{"images", report.num_images},
          {"images_with_mask", report.num_images_with_mask},
          {"images_without_mask", report.num_images_without_mask},
          {"images_with_bad_mask", report.num_images_with_bad_mask},
          {"scaled_masks", report.num_scaled_masks},
          {"points", report.num_points},
          {"points_labelled", report.num_points_labelled},
          {"points_clustered", report.num_points_clustered},
          {"segments", report.num_segments},
          {"merged_clusters", report.num_merges},
          {"keypoint_sigma_px", report.keypoint_sigma_px},
          {"mean_entropy_bits", report.mean_entropy_bits},
          {"mean_margin", report.mean_margin},
          {"classes", std::move(classes)},
          {"seconds", report.step_times},
          {"peak_memory_mib", PeakMemoryMiB()}};
}

std::string ReportToTable(const LiftReport& report, const ClassTable& table) {
  std::string text =
      fmt::format("images with masks  {} of {}", report.num_images_with_mask, report.num_images);
  if (report.num_images_with_bad_mask > 0) {
    text += fmt::format(" ({} unusable)", report.num_images_with_bad_mask);
  }
  if (report.num_scaled_masks > 0) text += fmt::format(" ({} scaled)", report.num_scaled_masks);
  text += fmt::format("\npoints labelled    {} of {}, {} in clusters\n\n",
                      report.num_points_labelled, report.num_points, report.num_points_clustered);
  text += fmt::format("{:<24}{:>8}{:>10}{:>8}{:>10}\n", "class", "points", "clusters", "planes",
                      "inliers");
  for (const auto& [index, counts] : report.classes) {
    text += fmt::format("{:<24}{:>8}{:>10}{:>8}{:>10}\n",
                        table.classes[static_cast<size_t>(index)].name, counts.points,
                        counts.clusters, counts.planes, counts.plane_inliers);
  }
  text += "\nseconds ";
  for (const auto& [step, seconds] : report.step_times) {
    text += fmt::format("  {} {:.2f}", step, seconds);
  }
  return text + "\n";
}

void InParallel(int num_threads, const std::vector<std::function<void()>>& tasks) {
  ParallelFor(tasks.size(), num_threads, [&](size_t i) { tasks[i](); });
}

void WriteColoredModel(const Reconstruction& model, const fs::path& directory) {
  fs::create_directory(directory);
  WriteColmapModel(model, directory);
}

void WriteResult(const Reconstruction& model, const LiftResult& result, const json& config,
                 const json& report, int num_threads, const fs::path& directory) {
  InParallel(
      num_threads,
      {[&] { WriteSemanticMap(result.map, directory); },
       [&] { WritePointsPly(result.map, model, directory / "points.ply"); },
       [&] { WriteColoredModel(ColorByClass(model, result.map), directory / "model_by_class"); },
       [&] {
         WriteColoredModel(ColorByCluster(model, result.map), directory / "model_by_cluster");
       }});
  WritePlanesPly(result.map, directory / "planes.ply");
  if (result.confusion) {
    WriteNpy(result.confusion->cast<float>(), directory / "confusion.npy");
  }
  WriteJson(directory / "config.json", config);
  WriteJson(directory / "report.json", report);
}

/// A matrix of counts or shares, its rows scaled to one; empty for an empty path.
std::optional<ConfusionMatrix> ReadConfusion(const std::string& path, const ClassTable& table) {
  if (path.empty()) return std::nullopt;
  ConfusionMatrix matrix = ReadNpy(path).cast<double>();
  if (matrix.rows() != table.size() || matrix.cols() != table.size()) {
    ThrowInputError("{}: {} x {}, but the class table '{}' has {} classes", path, matrix.rows(),
                    matrix.cols(), table.name, table.size());
  }
  if (!matrix.allFinite() || matrix.minCoeff() < 0.0) {
    ThrowInputError("{}: an entry is negative or not finite", path);
  }
  for (Eigen::Index c = 0; c < matrix.rows(); ++c) {
    const double sum = matrix.row(c).sum();
    if (!(sum > 0.0)) ThrowInputError("{}: row {} is empty", path, c);
    matrix.row(c) /= sum;
  }
  return matrix;
}

/// What --overlays asks for.
struct Overlays {
  std::vector<const Image*> images;
  fs::path image_directory;
};

fs::path ImageDirectory(const po::variables_map& arguments) {
  const fs::path given = arguments["images"].as<std::string>();
  if (!given.empty()) return given;
  const auto noted = ReadColmapProject(fs::path(Required(arguments, "model")) / "project.ini");
  if (!noted) throw UsageError("--overlays needs --images: the model has no project.ini");
  return *noted;
}

/// What is missing would be seen only after all has been computed.
void CheckImagesExist(const Overlays& overlays) {
  for (const Image* image : overlays.images) {
    const fs::path path = overlays.image_directory / image->name;
    if (fs::is_regular_file(path)) continue;
    ThrowInputError("{}: no such image to draw an overlay on: --images says where they are",
                    path.string());
  }
}

Overlays ChooseOverlays(const po::variables_map& arguments, const Reconstruction& model) {
  Overlays overlays;
  overlays.images = SelectImages(model, arguments["overlays"].as<std::string>());
  if (overlays.images.empty()) return overlays;
  overlays.image_directory = ImageDirectory(arguments);
  CheckImagesExist(overlays);
  return overlays;
}

Provenance DescribeInputs(const po::variables_map& arguments, const CommonArguments& common,
                          const PanopticMasks& masks, const LiftOptions& options) {
  Provenance provenance("s3-lift", common, OptionsToJson(options));
  provenance.AddFiles("model", Required(arguments, "model"),
                      {"cameras.bin", "images.bin", "points3D.bin", "cameras.txt", "images.txt",
                       "points3D.txt", "descriptors.bin"});
  AddMaskInputs(arguments, masks, provenance);
  provenance.AddFile("confusion", arguments["confusion"].as<std::string>());
  return provenance;
}

void Run(const po::variables_map& arguments, const CommonArguments& common) {
  if (arguments.count("sequence") > 0) {
    WriteIgnoreMasks(arguments, common);
    return;
  }
  if (!arguments["ignore-margin"].defaulted()) {
    throw UsageError("--ignore-margin is of the masks that --sequence writes");
  }
  LiftOptions options = LoadOptions<LiftOptions>(common);
  options.num_threads = common.threads;
  options.seed = common.seed;
  if (arguments["lenient"].as<bool>()) options.lookup.lenient = true;
  const fs::path model_path = Required(arguments, "model");
  const fs::path mask_path = Required(arguments, "masks");
  const fs::path class_path = FindConfigFile(Required(arguments, "classes"), "classes");
  const fs::path output_path = Required(arguments, "output");
  const MaskFormat format = MaskFormatArgument(arguments);
  OutputDirectory output(output_path, common.overwrite);

  const ClassTable table = ReadClassTable(class_path);
  options.confusion = ReadConfusion(arguments["confusion"].as<std::string>(), table);
  Reconstruction model;
  PointDescriptors descriptors;
  std::optional<PanopticMasks> opened;
  InParallel(common.threads, {[&] {
                                model = ReadColmapModel(model_path);
                                if (fs::exists(model_path / "descriptors.bin")) {
                                  descriptors = ReadDescriptors(model_path / "descriptors.bin");
                                }
                              },
                              [&] { opened = OpenMasks(arguments, mask_path, format, table); }});
  const PanopticMasks& masks = *opened;
  spdlog::info("{} images, {} points, {} masks ({})", model.images.size(), model.points.size(),
               masks.names().size(), MaskFormatName(masks.format()));
  const MaskSource source(masks, model);
  source.WarnIfMostAreOfOthers(model);
  const Overlays overlays = ChooseOverlays(arguments, model);

  const MaskProvider read_mask = [&](const Image& image) { return source.Read(image); };
  LiftResult result;
  std::optional<Provenance> provenance;
  InParallel(common.threads,
             {[&] { result = LiftSemantics(model, table, read_mask, descriptors, options); },
              [&] { provenance = DescribeInputs(arguments, common, masks, options); }});
  json report = ReportToJson(result.report, table);
  report["images_unmasked"] = source.NamesWithoutMask(model);
  provenance->AddTo(report);
  WriteResult(model, result, provenance->config(), report, common.threads, output.path());
  WriteKeyframePictures(model, result.map, overlays.images, overlays.image_directory,
                        common.threads, output.path() / "overlays");
  output.Commit();
  for (const char* long_one : {"config", "images_unmasked"}) report.erase(long_one);
  PrintReport(common, ReportToTable(result.report, table), report);
}

}  // namespace
}  // namespace s3lam::tools

int main(int argc, char** argv) {
  s3lam::tools::Program program;
  program.name = "s3-lift";
  program.description = s3lam::tools::kDescription;
  program.arguments.add(s3lam::tools::Arguments());
  s3lam::tools::SetConfiguration(s3lam::LiftOptions{}, program);
  program.run = s3lam::tools::Run;
  return s3lam::tools::RunProgram(argc, argv, program);
}
