#include "s3lam/report/figures.h"

#include <fmt/format.h>

#include <algorithm>

#include "s3lam/base/error.h"
#include "s3lam/base/statistics.h"
#include "s3lam/report/keyframe_pictures.h"
#include "s3lam/report/map_view.h"
#include "s3lam/report/plots.h"
#include "s3lam/report/trust_strip.h"

namespace s3lam::report {
namespace fs = std::filesystem;
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr Rgb kUnlabelled = {185, 185, 185};

/// Above: (x, y); side: (x, z).
std::vector<Vector2d> Flatten(const std::vector<Vector3d>& points, bool from_above) {
  std::vector<Vector2d> flat;
  for (const Vector3d& p : points) flat.emplace_back(p.x(), from_above ? p.y() : p.z());
  return flat;
}

Figure ErrorPathFigure(const Arm& arm, const ArmErrors& errors, const CommonFrame& frame,
                       bool from_above, double max_error) {
  PlotStyle style;
  style.title = fmt::format("{}: trajectory from {}, RMSE {:.4g}", arm.title,
                            from_above ? "above" : "the side", errors.rmse);
  style.x_label = fmt::format("[{}]", frame.unit);
  style.y_label = "colour: error; grey: ground truth";
  ErrorPath path{Flatten(errors.position_in_view, from_above), errors.error};
  return {"trajectory", fmt::format("trajectory_{}_{}", arm.key, from_above ? "top" : "side"), "",
          PlotErrorPath(style, path, Flatten(frame.truth_in_view, from_above), max_error)};
}

/// The class of every point that is in a cluster.
std::unordered_map<PointId, Rgb> ClassColors(const RunFolder& run) {
  std::unordered_map<PointId, Rgb> colors;
  if (!run.semantics) return colors;
  for (const auto& [id, cluster] : run.semantics->clusters) {
    const Rgb& color =
        run.semantics->class_table.classes.at(static_cast<size_t>(cluster.class_index)).color;
    for (const PointId point : cluster.points) colors[point] = color;
  }
  return colors;
}

struct ArmMap {
  std::vector<ColoredPoint> points;
  std::vector<Vector3d> path;
};

ArmMap MapOfArm(const RunFolder& run, size_t k, const Similarity3& view_from_arm,
                const std::unordered_map<PointId, Rgb>& colors) {
  ArmMap map;
  for (const auto& [id, point] : run.arms[k].model.points) {
    const auto color = colors.find(id);
    // Without classes the points' own colours are all there is to tell them by.
    const Rgb own = run.semantics ? kUnlabelled : point.color;
    map.points.push_back({view_from_arm * point.xyz, color == colors.end() ? own : color->second});
  }
  if (!run.arms[k].trajectory.empty()) {  // Images in any order are no path.
    for (const TimedPose& pose : run.arms[k].trajectory) {
      map.path.push_back(view_from_arm * pose.world_from_camera.translation);
    }
  }
  return map;
}

}  // namespace

void AddTrustFigure(const FrameTrust& trust, std::vector<Figure>& figures) {
  if (trust.stretches.empty()) return;
  constexpr const char* kCaption =
      "Line: how many points a frame sees, how much of the image they cover, how well they fit, "
      "whether pairs of keyframes contradict the map, and whether frames that they refute cut it "
      "off; 1 is full trust. Band: stretches of frames; a few frames that differ are counted with "
      "those around them.";
  figures.push_back(
      {"trust", "trust", trust.frames.empty() ? "" : kCaption, DrawTrustStrip(trust)});
}

void AddTrajectoryFigures(const RunFolder& run, const Measures& measures,
                          std::vector<Figure>& figures) {
  const CommonFrame& frame = measures.frame;
  if (frame.errors.empty()) return;
  double max_error = 0.0;  // Of all arms, so that colours can be compared.
  std::vector<Series> along_time;
  for (size_t k = 0; k < run.arms.size(); ++k) {
    const ArmErrors& errors = frame.errors[k];
    Series series{run.arms[k].title, {}};
    for (size_t i = 0; i < errors.error.size(); ++i) {
      max_error = std::max(max_error, errors.error[i]);
      series.points.emplace_back(errors.time_s[i], errors.error[i]);
    }
    along_time.push_back(std::move(series));
  }
  for (size_t k = 0; k < run.arms.size(); ++k) {
    for (const bool from_above : {true, false}) {
      figures.push_back(
          ErrorPathFigure(run.arms[k], frame.errors[k], frame, from_above, max_error));
    }
  }
  PlotStyle style;
  style.title = "Trajectory error (ATE) along time";
  style.x_label = "time [s]";
  style.y_label = fmt::format("[{}]", frame.unit);
  figures.push_back({"trajectory", "ate_along_time", "", PlotCurves(style, along_time)});
}

void AddResidualFigures(const Options& options, const RunFolder& run, const Measures& measures,
                        std::vector<Figure>& figures) {
  const auto series_of = [&](const std::vector<std::vector<double>>& values, const char* unit) {
    std::vector<ValueSeries> series;
    for (size_t k = 0; k < run.arms.size(); ++k) {
      series.push_back(
          {fmt::format("{}, RMS {:.4g}{}", run.arms[k].title, RootMeanSquare(values[k]), unit),
           values[k]});
    }
    return series;
  };
  PlotStyle style;
  style.title = "Reprojection error of the common observations";
  style.x_label = "[px]; the last bin holds all larger ones";
  style.y_label = "observations";
  if (!measures.reprojection_px.front().empty()) {
    figures.push_back(
        {"residuals", "reprojection_error", "",
         PlotHistogram(style, series_of(measures.reprojection_px, " px"), options.histogram_bins)});
  }
  if (measures.planes.empty()) return;
  style.title = "Distance of points from the plane fitted to them";
  style.x_label = fmt::format("[{}]; the last bin holds all larger ones", measures.frame.unit);
  style.y_label = "points";
  figures.push_back(
      {"residuals", "plane_distance", "",
       PlotHistogram(style, series_of(measures.plane_distances, ""), options.histogram_bins)});
}

void AddMapFigures(const Options& options, const RunFolder& run, const Measures& measures,
                   std::vector<Figure>& figures) {
  const auto colors = ClassColors(run);
  std::vector<ArmMap> maps;
  for (size_t k = 0; k < run.arms.size(); ++k) {
    maps.push_back(MapOfArm(run, k, measures.frame.view_from_arm[k], colors));
  }
  for (const MapView view : kMapViews) {
    const ViewBounds bounds = BoundsOfView(view, maps.back().points, maps.back().path);
    for (size_t k = 0; k < run.arms.size(); ++k) {
      figures.push_back(
          {"map", fmt::format("map_{}_{}", run.arms[k].key, MapViewName(view)),
           fmt::format("{}, {}", run.arms[k].title, MapViewName(view)),
           DrawMapView(view, bounds, maps[k].points, maps[k].path, options.view_width)});
    }
  }
}

void AddKeyframeFigures(const Options& options, const RunFolder& run,
                        const fs::path& image_directory, std::vector<Figure>& figures,
                        std::vector<std::string>& missing) {
  if (!run.semantics || options.gallery_images == 0) return;
  const bool was_asked = !image_directory.empty();
  const fs::path directory = was_asked ? image_directory : run.image_directory;
  if (was_asked && !fs::is_directory(directory)) {
    ThrowInputError("{}: no such folder", directory.string());
  }
  if (directory.empty()) {
    missing.emplace_back("No folder of images is known (--images): no keyframes are shown.");
    return;
  }
  const RowOfPoint rows = RowsOfPoints(*run.semantics);
  size_t num_absent = 0;
  const Arm& arm = run.arms.back();
  for (const Image* image : SpreadImages(arm.model, options.gallery_images)) {
    const fs::path path = directory / image->name;
    if (!was_asked && !fs::exists(path)) {
      ++num_absent;
      continue;
    }
    figures.push_back({"keyframes", fmt::format("keyframe_{:06d}", image->id.value()), image->name,
                       DrawKeyframe(arm.model, *image, path, *run.semantics, rows, arm.planes,
                                    options.gallery_width)});
  }
  if (num_absent > 0) {
    missing.push_back(fmt::format(
        "{} images are not where the run read them (--images): they are not shown.", num_absent));
  }
}

}  // namespace s3lam::report
