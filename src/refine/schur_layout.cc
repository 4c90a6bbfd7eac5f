#include "s3lam/refine/schur_layout.h"

#include <algorithm>
#include <atomic>
#include <limits>

#include "s3lam/base/error.h"
#include "s3lam/base/parallel.h"

namespace s3lam {
namespace {

/// Chunks are the unit of parallel work on points. Their number depends on the problem alone, since
/// sums over poses are taken chunk by chunk: with it the result would change in the last digits.
constexpr size_t kObservationsPerChunk = 4096;
constexpr size_t kMaxChunks = 16;

template <typename Items>
std::vector<size_t> RangesOfPoints(const Items& items, size_t num_points) {
  std::vector<size_t> begin(num_points + 1, 0);
  int previous = 0;
  for (const auto& item : items) {
    S3LAM_CHECK(item.point >= previous);
    previous = item.point;
    ++begin[static_cast<size_t>(item.point) + 1];
  }
  for (size_t p = 0; p < num_points; ++p) begin[p + 1] += begin[p];
  return begin;
}

void FindVariables(const BundleProblem& problem, const std::vector<StructureTerm>& terms,
                   SchurLayout& layout) {
  const std::vector<uint8_t> pose_used = problem.UsedPoses();
  std::vector<uint8_t> plane_used(problem.planes.size(), 0);
  bool height_used = false;
  for (const PointOnPlane& term : problem.points_on_planes) {
    if (layout.IsUsed(static_cast<size_t>(term.point))) plane_used[term.plane] = 1;
  }
  for (const StructureTerm& term : terms) {
    for (const StructureBlock& block : term.blocks) {
      if (block.kind == StructureBlock::Kind::kPlane) plane_used[block.index] = 1;
      height_used |= block.kind == StructureBlock::Kind::kHeight;
    }
  }
  layout.variable_of_pose.assign(problem.poses.size(), -1);
  layout.variable_of_plane.assign(problem.planes.size(), -1);
  for (size_t i = 0; i < pose_used.size(); ++i) {
    const bool held = static_cast<int>(i) == problem.gauge.fixed_pose;
    if (pose_used[i] == 0 || problem.pose_is_constant[i] != 0 || held) continue;
    layout.variable_of_pose[i] = layout.num_variables();
    layout.pose_of_variable.push_back(static_cast<int>(i));
    layout.size.push_back(6);
  }
  layout.num_poses = layout.num_variables();
  const Gauge& gauge = problem.gauge;
  const bool holds_scale =
      gauge.fixed_pose >= 0 && pose_used[gauge.fixed_pose] != 0 && gauge.scale_pose >= 0;
  if (holds_scale) layout.held_pose = layout.variable_of_pose[gauge.scale_pose];
  for (size_t k = 0; k < plane_used.size(); ++k) {
    if (plane_used[k] == 0 || problem.planes[k].is_constant) continue;
    layout.variable_of_plane[k] = layout.num_variables();
    layout.plane_of_variable.push_back(static_cast<int>(k));
    layout.size.push_back(3);
  }
  layout.num_planes = layout.num_variables() - layout.num_poses;
  if (height_used) {
    layout.height_variable = layout.num_variables();
    layout.size.push_back(1);
  }
  layout.variable_of_camera.assign(problem.cameras.size(), -1);
  for (size_t i = 0; i < pose_used.size(); ++i) {
    const int camera = problem.camera_of_pose[i];
    const int num_free = problem.NumFreeParams(camera);
    if (pose_used[i] == 0 || num_free == 0 || layout.variable_of_camera[camera] >= 0) continue;
    layout.variable_of_camera[camera] = layout.num_variables();
    layout.camera_of_variable.push_back(camera);
    layout.size.push_back(num_free);
    ++layout.num_cameras;
  }
  layout.offset.assign(1, 0);
  for (const int size : layout.size) layout.offset.push_back(layout.offset.back() + size);
}

/// Which points are seen with which of the cameras that are variables.
void FindPointsInCameras(const BundleProblem& problem, SchurLayout& layout) {
  if (layout.num_cameras > 0) {
    int point = -1;
    size_t begin = 0;  // Of the point's entries.
    for (const BundleObservation& o : problem.observations) {
      if (o.point != point) begin = layout.seen.size();
      point = o.point;
      const int variable = layout.variable_of_camera[problem.camera_of_pose[o.pose]];
      const bool is_new =
          std::none_of(layout.seen.begin() + static_cast<std::ptrdiff_t>(begin), layout.seen.end(),
                       [&](const PointInCamera& seen) { return seen.variable == variable; });
      if (variable >= 0 && is_new) layout.seen.push_back({point, variable});
    }
  }
  layout.seen_begin = RangesOfPoints(layout.seen, problem.points.size());
}

void CutIntoChunks(size_t num_observations, SchurLayout& layout) {
  const size_t chunks = std::clamp<size_t>(num_observations / kObservationsPerChunk, 1, kMaxChunks);
  layout.chunk_begin.assign(1, 0);
  for (size_t c = 1; c < chunks; ++c) {
    const auto it = std::lower_bound(layout.observation_begin.begin(),
                                     layout.observation_begin.end(), num_observations * c / chunks);
    layout.chunk_begin.push_back(static_cast<size_t>(it - layout.observation_begin.begin()));
  }
  layout.chunk_begin.push_back(layout.observation_begin.size() - 1);
}

/// Sorts item numbers by `variable_of(number)` in [0, num_variables), leaving out -1.
template <typename Function>
void SortByVariable(size_t count, int num_variables, const Function& variable_of,
                    std::vector<size_t>& begin, std::vector<uint32_t>& sorted) {
  S3LAM_CHECK(count < std::numeric_limits<uint32_t>::max());
  begin.assign(static_cast<size_t>(num_variables) + 1, 0);
  for (size_t k = 0; k < count; ++k) {
    const int v = variable_of(k);
    if (v >= 0) ++begin[static_cast<size_t>(v) + 1];
  }
  for (size_t v = 0; v + 1 < begin.size(); ++v) begin[v + 1] += begin[v];
  sorted.resize(begin.back());
  std::vector<size_t> next(begin.begin(), begin.end() - 1);
  for (size_t k = 0; k < count; ++k) {
    const int v = variable_of(k);
    if (v >= 0) sorted[next[static_cast<size_t>(v)]++] = static_cast<uint32_t>(k);
  }
}

/// Later variables seen by the points of variable i, in `found`; `mark` holds i for those.
class CoupledFinder {
 public:
  CoupledFinder(const BundleProblem& problem, const SchurLayout& layout)
      : problem_(problem),
        layout_(layout),
        mark_(static_cast<size_t>(layout.num_variables()), -1) {}

  std::vector<int> Find(int i) {
    found_.clear();
    if (layout_.IsPose(i)) {
      for (size_t k = layout_.pose_begin[i]; k < layout_.pose_begin[i + 1]; ++k) {
        VisitPoint(problem_.observations[layout_.of_pose[k]].point, i);
      }
    } else if (layout_.IsPlane(i)) {
      const int plane = i - layout_.num_poses;
      for (size_t k = layout_.plane_begin[plane]; k < layout_.plane_begin[plane + 1]; ++k) {
        VisitPoint(problem_.points_on_planes[layout_.of_plane[k]].point, i);
      }
    } else if (layout_.IsCamera(i)) {
      const int camera = i - layout_.first_camera();
      for (size_t k = layout_.camera_begin[camera]; k < layout_.camera_begin[camera + 1]; ++k) {
        VisitPoint(layout_.seen[layout_.of_camera[k]].point, i);
      }
    }
    return found_;
  }

 private:
  void VisitPoint(int point, int i) {
    for (size_t k = layout_.observation_begin[point]; k < layout_.observation_begin[point + 1];
         ++k) {
      Add(layout_.variable_of_pose[problem_.observations[k].pose], i);
    }
    for (size_t k = layout_.term_begin[point]; k < layout_.term_begin[point + 1]; ++k) {
      Add(layout_.variable_of_plane[problem_.points_on_planes[k].plane], i);
    }
    for (size_t k = layout_.seen_begin[point]; k < layout_.seen_begin[point + 1]; ++k) {
      Add(layout_.seen[k].variable, i);
    }
  }
  void Add(int j, int i) {
    if (j <= i || mark_[j] == i) return;
    mark_[j] = i;
    found_.push_back(j);
  }

  const BundleProblem& problem_;
  const SchurLayout& layout_;
  std::vector<int> mark_;
  std::vector<int> found_;
};

}  // namespace

int SchurLayout::VariableOf(const StructureBlock& block) const {
  switch (block.kind) {
    case StructureBlock::Kind::kPose:
      return variable_of_pose[block.index];
    case StructureBlock::Kind::kPlane:
      return variable_of_plane[block.index];
    case StructureBlock::Kind::kHeight:
      break;
  }
  return height_variable;
}

SchurLayout MakeSchurLayout(const BundleProblem& problem, const std::vector<StructureTerm>& terms) {
  SchurLayout layout;
  layout.observation_begin = RangesOfPoints(problem.observations, problem.points.size());
  layout.term_begin = RangesOfPoints(problem.points_on_planes, problem.points.size());
  FindVariables(problem, terms, layout);
  FindPointsInCameras(problem, layout);
  CutIntoChunks(problem.observations.size(), layout);
  SortByVariable(
      problem.observations.size(), layout.num_poses,
      [&](size_t k) { return layout.variable_of_pose[problem.observations[k].pose]; },
      layout.pose_begin, layout.of_pose);
  SortByVariable(
      problem.points_on_planes.size(), layout.num_planes,
      [&](size_t k) {
        const PointOnPlane& term = problem.points_on_planes[k];
        const int v = layout.variable_of_plane[term.plane];
        return v < 0 || !layout.IsUsed(static_cast<size_t>(term.point)) ? -1 : v - layout.num_poses;
      },
      layout.plane_begin, layout.of_plane);
  SortByVariable(
      layout.seen.size(), layout.num_cameras,
      [&](size_t k) { return layout.seen[k].variable - layout.first_camera(); },
      layout.camera_begin, layout.of_camera);
  return layout;
}

std::vector<std::vector<int>> FindCoupledVariables(const BundleProblem& problem,
                                                   const std::vector<StructureTerm>& terms,
                                                   const SchurLayout& layout, size_t max_values,
                                                   int num_threads) {
  const int n = layout.num_variables();
  std::vector<std::vector<int>> coupled(static_cast<size_t>(n));
  for (const StructureTerm& term : terms) {
    for (const StructureBlock& a : term.blocks) {
      for (const StructureBlock& b : term.blocks) {
        const int i = layout.VariableOf(a);
        const int j = layout.VariableOf(b);
        if (i >= 0 && j > i) coupled[i].push_back(j);
      }
    }
  }
  constexpr int kVariablesPerItem = 64;
  std::atomic<size_t> num_values{0};
  const auto items = static_cast<size_t>((n + kVariablesPerItem - 1) / kVariablesPerItem);
  ParallelFor(items, num_threads, [&](size_t item) {
    if (num_values > max_values) return;
    CoupledFinder finder(problem, layout);
    const int first = static_cast<int>(item) * kVariablesPerItem;
    for (int i = first; i < std::min(n, first + kVariablesPerItem); ++i) {
      std::vector<int>& columns = coupled[i];
      const std::vector<int> found = finder.Find(i);
      columns.insert(columns.end(), found.begin(), found.end());
      std::sort(columns.begin(), columns.end());
      columns.erase(std::unique(columns.begin(), columns.end()), columns.end());
      size_t rows = static_cast<size_t>(layout.size[i]);
      for (const int j : columns) rows += static_cast<size_t>(layout.size[j]);
      num_values += rows * static_cast<size_t>(layout.size[i]);
    }
  });
  if (num_values > max_values) coupled.clear();
  return coupled;
}

}  // namespace s3lam
