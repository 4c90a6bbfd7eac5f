#include "s3lam/refine/ground.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "s3lam/base/rng.h"
#include "s3lam/base/statistics.h"
#include "s3lam/refine/camera_heights.h"
#include "s3lam/robust/plane_fit.h"

namespace s3lam {
namespace {

constexpr std::array<std::string_view, 3> kModeNames{"auto", "on", "off"};
constexpr std::array<std::string_view, 3> kRefinedWithHeightsNames{"none", "distortion", "all"};
/// Cameras that are looked at for a first guess of the height.
constexpr size_t kMaxCamerasForGuess = 60;
/// A ground point may lie this many heights of path beyond the cameras that see it.
constexpr double kReachHeights = 40.0;
/// A camera takes no part if the ground under it is less certain than this [sigma of the height]:
/// its ground points lie aside or far ahead.
constexpr double kMaxFootSigmas = 2.0;
/// Cameras nearer to each other along the path than this [camera heights] ride on the same bump: a
/// car heaves and pitches once or twice a second, which is half a wave every few metres.
constexpr double kBumpHeights = 4.0;
constexpr uint64_t kGroundSeed = 0x67726f756e64ULL;

/// Cameras in the order of their images and how far along the path each is.
struct CameraPath {
  std::vector<int> poses;
  std::vector<Eigen::Vector3d> centers;
  std::vector<double> at;  // [map units]
};

CameraPath PathOf(const BundleProblem& problem) {
  const std::vector<uint8_t> used = problem.UsedPoses();
  CameraPath path;
  for (size_t i = 0; i < problem.poses.size(); ++i) {
    if (used[i] == 0) continue;
    const Eigen::Vector3d center = problem.CenterOf(static_cast<int>(i));
    path.at.push_back(path.at.empty() ? 0.0
                                      : path.at.back() + (center - path.centers.back()).norm());
    path.poses.push_back(static_cast<int>(i));
    path.centers.push_back(center);
  }
  return path;
}

/// Points of clusters of the ground's class that are in use, ascending.
std::vector<int> GroundPoints(const SemanticMap& semantics, int class_index, const BundleMap& map,
                              const PlaneModel& model) {
  std::vector<int> points;
  for (const auto& [id, cluster] : semantics.clusters) {
    if (cluster.class_index != class_index) continue;
    for (const PointId point : cluster.points) {
      const int index = map.IndexOfPoint(point);
      if (index >= 0 && model.keypoint_size[index] > 0.0) points.push_back(index);
    }
  }
  std::sort(points.begin(), points.end());
  points.erase(std::unique(points.begin(), points.end()), points.end());
  return points;
}

/// The plane of some points, its normal towards the cameras.
std::optional<PlaneFit> FitGround(const std::vector<int>& indices, const Eigen::Vector3d& camera,
                                  double sigma_px, uint64_t seed, const PlaneModel& model,
                                  const BundleProblem& problem) {
  std::vector<UncertainPoint> points;
  for (const int i : indices) {
    const double sigma = sigma_px * model.keypoint_size[i];
    points.push_back(
        {problem.points[i], model.covariances[i] + sigma * sigma * Eigen::Matrix3d::Identity()});
  }
  Rng rng(kGroundSeed + seed);
  auto fit = FitPlaneRobustly(points, PlaneFitOptions(), NormalBand(), rng);
  if (fit && fit->plane.SignedDistance(camera) < 0.0) {
    fit->plane = {-fit->plane.normal, -fit->plane.offset};
  }
  return fit;
}

/// Median height of single cameras over the ground points that each of them sees.
double GuessHeight(const CameraHeightOptions& options, const CameraPath& path,
                   const std::vector<int>& ground, double sigma_px, const PlaneModel& model,
                   const BundleProblem& problem) {
  std::vector<std::vector<int>> seen(problem.poses.size());
  for (const BundleObservation& o : problem.observations) {
    if (!std::binary_search(ground.begin(), ground.end(), o.point)) continue;
    if (seen[o.pose].empty() || seen[o.pose].back() != o.point) seen[o.pose].push_back(o.point);
  }
  std::vector<double> heights;
  const size_t step = 1 + path.poses.size() / kMaxCamerasForGuess;
  for (size_t i = 0; i < path.poses.size(); i += step) {
    const std::vector<int>& points = seen[path.poses[i]];
    if (static_cast<int>(points.size()) < options.min_points) continue;
    const auto fit = FitGround(points, path.centers[i], sigma_px, options.seed, model, problem);
    if (fit) heights.push_back(fit->plane.SignedDistance(path.centers[i]));
  }
  return Median(std::move(heights));
}

/// One stretch of the path with the ground under it.
struct Stretch {
  std::vector<int> points;
  std::vector<size_t> cameras;  // Indices into the path.
  std::optional<PlaneFit> fit;
};

class GroundBuilder {
 public:
  GroundBuilder(const CameraHeightOptions& options, const SemanticMap& semantics, double sigma_px,
                PlaneModel& model, BundleMap& map)
      : options_(options), semantics_(semantics), sigma_px_(sigma_px), model_(model), map_(map) {}

  GroundReport Run() {
    report_.reason = Find();
    if (!report_.reason.empty()) return report_;
    report_.in_use = true;
    AddPlanes();
    AddHeights();
    report_.spread_before = HeightSpread(map_.problem);
    return report_;
  }

 private:
  /// Empty if the ground was found and is good enough, else why not.
  std::string Find() {
    class_index_ = -1;
    const auto& classes = semantics_.class_table.classes;
    for (size_t c = 0; c < classes.size(); ++c) {
      if (classes[c].name == options_.ground_class) class_index_ = static_cast<int>(c);
    }
    if (class_index_ < 0) return "the class table has no " + options_.ground_class;
    path_ = PathOf(map_.problem);
    const std::vector<int> ground = GroundPoints(semantics_, class_index_, map_, model_);
    height_ = GuessHeight(options_, path_, ground, sigma_px_, model_, map_.problem);
    if (!(height_ > 0.0)) return "too few points on " + options_.ground_class;
    CutIntoStretches(ground);
    std::vector<double> heights;
    std::vector<double> deviations;
    for (Stretch& stretch : stretches_) FitStretch(stretch, heights, deviations);
    report_.num_cameras = heights.size();
    if (heights.empty()) return "too few points on " + options_.ground_class;
    report_.height = Median(heights);
    if (options_.mode == CameraHeightMode::kOn) return {};
    return Doubts(heights, Median(deviations));
  }

  /// Why the camera's height should not be trusted to be constant, or need not be, if so.
  [[nodiscard]] std::string Doubts(const std::vector<double>& heights,
                                   double median_deviation) const {
    const double coverage =
        static_cast<double>(heights.size()) / static_cast<double>(path_.poses.size());
    if (coverage < options_.auto_min_coverage) {
      return fmt::format("ground under {:.0f} % of the cameras only", 100.0 * coverage);
    }
    if (path_.at.back() < options_.plane_length_heights * height_) return "the path is short";
    const double spread = median_deviation / kMedianOfAbsoluteNormal;
    if (spread > options_.auto_max_spread) {
      return fmt::format("the camera's height varies by {:.1f} % within stretches", 100.0 * spread);
    }
    const double overall = RelativeSpread(heights);
    if (options_.value == 0.0 && overall <= options_.sigma_relative) {
      return fmt::format("the camera's height varies by {:.1f} % only: there is nothing to mend",
                         100.0 * overall);
    }
    return {};
  }

  void CutIntoStretches(const std::vector<int>& ground) {
    const double length = options_.plane_length_heights * height_;
    const auto count =
        std::max<size_t>(1, static_cast<size_t>(std::lround(path_.at.back() / length)));
    stretches_.resize(count);
    const auto index_at = [&](double at) {
      const double part = at / std::max(path_.at.back(), 1e-300);
      return std::min(count - 1, static_cast<size_t>(part * static_cast<double>(count)));
    };
    for (size_t i = 0; i < path_.poses.size(); ++i) {
      stretches_[index_at(path_.at[i])].cameras.push_back(i);
    }
    const std::vector<std::pair<size_t, size_t>> seen_by = ObserverRanges();
    for (const int point : ground) {
      stretches_[index_at(path_.at[NearestCamera(point, seen_by[point])])].points.push_back(point);
    }
  }

  /// First and last camera of the path that sees each point.
  [[nodiscard]] std::vector<std::pair<size_t, size_t>> ObserverRanges() const {
    std::vector<size_t> place_of_pose(map_.problem.poses.size(), 0);
    for (size_t i = 0; i < path_.poses.size(); ++i) place_of_pose[path_.poses[i]] = i;
    std::vector<std::pair<size_t, size_t>> ranges(map_.problem.points.size(),
                                                  {path_.poses.size(), 0});
    for (const BundleObservation& o : map_.problem.observations) {
      auto& [first, last] = ranges[o.point];
      first = std::min(first, place_of_pose[o.pose]);
      last = std::max(last, place_of_pose[o.pose]);
    }
    return ranges;
  }

  /// The camera that passes nearest to a point, among those that see it and those a little way on.
  [[nodiscard]] size_t NearestCamera(int point, std::pair<size_t, size_t> seen_by) const {
    const double reach = kReachHeights * height_;
    size_t nearest = seen_by.first;
    double smallest = std::numeric_limits<double>::max();
    const auto begin =
        std::lower_bound(path_.at.begin(), path_.at.end(), path_.at[seen_by.first] - reach);
    for (auto i = static_cast<size_t>(begin - path_.at.begin()); i < path_.poses.size(); ++i) {
      if (path_.at[i] > path_.at[seen_by.second] + reach) break;
      const double distance = (path_.centers[i] - map_.problem.points[point]).squaredNorm();
      if (distance < smallest) {
        smallest = distance;
        nearest = i;
      }
    }
    return nearest;
  }

  /// Fits the plane under a stretch and appends its cameras' heights and their relative deviations
  /// from the stretch's median.
  void FitStretch(Stretch& stretch, std::vector<double>& heights,
                  std::vector<double>& deviations) const {
    if (stretch.cameras.empty() || static_cast<int>(stretch.points.size()) < options_.min_points) {
      return;
    }
    const Eigen::Vector3d& camera = path_.centers[stretch.cameras[stretch.cameras.size() / 2]];
    stretch.fit = FitGround(stretch.points, camera, sigma_px_, options_.seed, model_, map_.problem);
    if (!stretch.fit) return;
    std::erase_if(stretch.cameras, [&](size_t i) {
      return HeightSigma(*stretch.fit, path_.centers[i]) >
             kMaxFootSigmas * options_.sigma_relative * height_;
    });
    if (stretch.cameras.empty()) {
      stretch.fit.reset();
      return;
    }
    std::vector<double> of_stretch;
    for (const size_t i : stretch.cameras) {
      of_stretch.push_back(stretch.fit->plane.SignedDistance(path_.centers[i]));
    }
    const double median = Median(of_stretch);
    if (!(median > 0.3 * height_) || median > 3.0 * height_) {
      stretch.fit.reset();
      return;
    }
    for (const double h : of_stretch) deviations.push_back(std::abs(h - median) / median);
    heights.insert(heights.end(), of_stretch.begin(), of_stretch.end());
  }

  void AddPlanes() {
    for (PlaneState& plane : model_.planes) {
      if (plane.class_index == class_index_) plane.in_use = false;
    }
    const ClusterId cluster_id = LargestCluster();
    int previous = -1;
    for (size_t s = 0; s < stretches_.size(); ++s) {
      const Stretch& stretch = stretches_[s];
      if (!stretch.fit) {
        previous = -1;
        continue;
      }
      PlaneState state;
      state.id = PlaneId(model_.next_id++);
      state.cluster_id = cluster_id;
      state.class_index = class_index_;
      state.is_ground = true;
      state.candidates = stretch.points;
      model_.planes.push_back(std::move(state));
      map_.problem.planes.push_back(
          AnchoredPlane::FromPlane(stretch.fit->plane, stretch.fit->centroid));
      plane_of_stretch_.push_back({s, static_cast<int>(map_.problem.planes.size()) - 1});
      if (previous >= 0) Tie(previous, plane_of_stretch_.back().second, stretch.cameras.front());
      previous = plane_of_stretch_.back().second;
      ++report_.num_planes;
    }
  }

  /// Of the ground's class; the stretches stand for all of them.
  [[nodiscard]] ClusterId LargestCluster() const {
    ClusterId largest;
    size_t points = 0;
    for (const auto& [id, cluster] : semantics_.clusters) {
      if (cluster.class_index != class_index_ || cluster.points.size() <= points) continue;
      largest = id;
      points = cluster.points.size();
    }
    return largest;
  }

  /// The ground has no step where two stretches meet: under the first camera of the later one.
  void Tie(int a, int b, size_t camera) {
    RelationTerm term;
    term.relation = PlaneRelation::kMeeting;
    term.plane_a = a;
    term.plane_b = b;
    term.sigma_rad = options_.max_bend_deg * std::numbers::pi / 180.0;
    term.sigma_offset = options_.max_step_relative * report_.height;
    term.place_in_world = map_.problem.planes[b].PlaneInWorld().Project(path_.centers[camera]);
    map_.problem.relations.push_back(term);
  }

  void AddHeights() {
    map_.problem.height = report_.height;
    const double num_bumps = std::max(1.0, options_.plane_length_heights / kBumpHeights);
    for (const auto& [s, plane] : plane_of_stretch_) {
      const std::vector<size_t>& cameras = stretches_[s].cameras;
      // So many cameras say no more than one per bump.
      const double repeated = static_cast<double>(cameras.size()) / num_bumps;
      const double sigma = options_.sigma_relative * std::sqrt(std::max(1.0, repeated));
      for (const size_t i : cameras) map_.problem.heights.push_back({path_.poses[i], plane, sigma});
    }
  }

  const CameraHeightOptions& options_;
  const SemanticMap& semantics_;
  double sigma_px_;
  PlaneModel& model_;
  BundleMap& map_;
  GroundReport report_;
  CameraPath path_;
  int class_index_ = -1;
  double height_ = 0.0;
  std::vector<Stretch> stretches_;
  std::vector<std::pair<size_t, int>> plane_of_stretch_;
};

}  // namespace

void CameraHeightOptions::Visit(OptionVisitor& v) {
  v.Choice("mode", mode, kModeNames,
           "constant camera height above the ground: auto asks for evidence, leaves it alone where "
           "it varies by no more than sigma_relative already, and lets go of it where the map does "
           "not follow; on insists");
  v.Value("class", ground_class, "name of the ground's class");
  v.Value("value", value, "the height, if known: makes the result metric; 0 if not [m]", 0.0, 1e6);
  v.Value("sigma_relative", sigma_relative,
          "how much the height varies (suspension, pitch, uneven ground), relative", 1e-6, 10.0);
  v.Value("plane_length_heights", plane_length_heights,
          "length of a stretch of path with one ground plane [camera heights]", 1.0, 1e6);
  v.Value("max_bend_deg", max_bend_deg, "sigma of the bend between two stretches [deg]", 1e-6,
          90.0);
  v.Value("max_step_relative", max_step_relative,
          "sigma of the step between two stretches [camera heights]", 1e-9, 10.0);
  v.Value("auto_max_spread", auto_max_spread,
          "auto: largest relative deviation of the height within stretches", 0.0, 10.0);
  v.Value("auto_min_coverage", auto_min_coverage,
          "auto: least part of the cameras with ground under them", 0.0, 1.0);
  v.Value("min_points", min_points, "least number of ground points of a stretch", 3, 1000000);
  v.Choice("refine_camera", refine_camera, kRefinedWithHeightsNames,
           "where heights vary by more than sigma_relative, what of the cameras is refined with "
           "them (and what else of intrinsics is asked for), as a scale that drifts is mostly a "
           "wrong camera: none, radial distortions, or all, and less of it where the map does not "
           "follow like that");
}

GroundReport AddGround(const CameraHeightOptions& options, const SemanticMap& semantics,
                       double sigma_px, PlaneModel& model, BundleMap& map) {
  return GroundBuilder(options, semantics, sigma_px, model, map).Run();
}

}  // namespace s3lam
