#include "s3lam/robust/flat_cells.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

/// Standard deviation of the median of a normal sample, relative to that of the mean.
constexpr double kMedianLoss = 1.2533;

struct Member {
  Eigen::Vector2d uv;
  double distance = 0.0;
  double weight = 0.0;  // 1 / variance of the distance.
};

class CellJudge {
 public:
  CellJudge(const FlatCellOptions& options, std::span<const UncertainPoint> points,
            const Plane& plane)
      : options_(options), is_flat_(points.size(), 1) {
    const auto [u, v] = PlaneAxes(plane.normal);
    for (const UncertainPoint& point : points) {
      const double sigma = DistanceSigma(point, plane.normal);
      members_.push_back({{u.dot(point.xyz), v.dot(point.xyz)},
                          plane.SignedDistance(point.xyz),
                          sigma > 0.0 ? 1.0 / (sigma * sigma) : 0.0});
    }
  }

  std::vector<uint8_t> Run() {
    std::vector<size_t> all(members_.size());
    std::iota(all.begin(), all.end(), size_t{0});
    Judge(all);
    return std::move(is_flat_);
  }

 private:
  void Judge(std::span<size_t> cell) {
    const auto min_points = static_cast<size_t>(options_.min_points);
    if (cell.size() >= 2 * min_points) {
      const size_t half = cell.size() / 2;
      const int axis = LongAxis(cell);
      const auto order = [&](size_t a, size_t b) {
        return std::pair(members_[a].uv[axis], a) < std::pair(members_[b].uv[axis], b);
      };
      std::nth_element(cell.begin(), cell.begin() + static_cast<std::ptrdiff_t>(half), cell.end(),
                       order);
      Judge(cell.first(half));
      Judge(cell.subspan(half));
      return;
    }
    if (cell.size() < min_points || LiesOnPlane(cell)) return;
    for (const size_t i : cell) is_flat_[i] = 0;
  }

  [[nodiscard]] int LongAxis(std::span<const size_t> cell) const {
    Eigen::Vector2d low = members_[cell.front()].uv;
    Eigen::Vector2d high = low;
    for (const size_t i : cell) {
      low = low.cwiseMin(members_[i].uv);
      high = high.cwiseMax(members_[i].uv);
    }
    const Eigen::Vector2d extent = high - low;
    return extent.x() >= extent.y() ? 0 : 1;
  }

  [[nodiscard]] bool LiesOnPlane(std::span<size_t> cell) const {
    std::sort(cell.begin(), cell.end(), [&](size_t a, size_t b) {
      return std::pair(members_[a].distance, a) < std::pair(members_[b].distance, b);
    });
    double total = 0.0;
    for (const size_t i : cell) total += members_[i].weight;
    if (!(total > 0.0)) return true;
    double below = 0.0;
    for (const size_t i : cell) {
      below += members_[i].weight;
      if (below < 0.5 * total) continue;
      return std::abs(members_[i].distance) * std::sqrt(total) <= options_.max_sigmas * kMedianLoss;
    }
    return true;
  }

  const FlatCellOptions& options_;
  std::vector<Member> members_;
  std::vector<uint8_t> is_flat_;
};

}  // namespace

void FlatCellOptions::Visit(OptionVisitor& v) {
  v.Value("min_points", min_points, "least number of points of a cell", 3, 1000000);
  v.Value("max_sigmas", max_sigmas,
          "a cell whose median distance is farther off does not lie on the plane [sigma of that "
          "median]",
          0.1, 1e6);
}

std::vector<uint8_t> FlatCells(const FlatCellOptions& options,
                               std::span<const UncertainPoint> points, const Plane& plane) {
  S3LAM_CHECK(options.min_points > 0);
  return CellJudge(options, points, plane).Run();
}

}  // namespace s3lam
