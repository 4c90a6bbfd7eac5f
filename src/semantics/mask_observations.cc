#include "s3lam/semantics/mask_observations.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <numeric>
#include <string>
#include <utility>

#include "s3lam/base/error.h"
#include "s3lam/base/natural_order.h"
#include "s3lam/base/parallel.h"
#include "s3lam/base/progress.h"

namespace s3lam {
namespace {

/// One image's mask, reduced to what the points and the following frames need.
struct FrameLookup {
  const Image* image = nullptr;
  bool has_mask = false;
  bool is_bad = false;
  bool is_scaled = false;
  std::vector<std::pair<uint32_t, PanopticSegment>> segments;       // By segment id.
  std::vector<std::pair<uint32_t, PointObservation>> observations;  // By row of the model's points;
                                                                    // segment: index into segments.
  std::vector<PixelDistribution> pixel_distributions;
  SegmentImage indices;         // Index into segments per pixel; kept for overlaps only.
  std::vector<uint32_t> areas;  // Pixels per segment; for overlaps only.
};

std::vector<const Image*> ImagesInOrder(const Reconstruction& reconstruction) {
  std::vector<const Image*> images;
  for (const auto& [id, image] : reconstruction.images) images.push_back(&image);
  std::stable_sort(images.begin(), images.end(),
                   [](const Image* a, const Image* b) { return NaturalLess(a->name, b->name); });
  return images;
}

/// True if a pixel of another segment lies within `radius` of pixel (x, y).
bool IsNearBorder(const SegmentImage& ids, Eigen::Index x, Eigen::Index y, double radius) {
  const auto reach = static_cast<Eigen::Index>(std::floor(radius));
  const uint32_t id = ids(y, x);
  for (Eigen::Index v = std::max<Eigen::Index>(0, y - reach);
       v <= std::min(ids.rows() - 1, y + reach); ++v) {
    for (Eigen::Index u = std::max<Eigen::Index>(0, x - reach);
         u <= std::min(ids.cols() - 1, x + reach); ++u) {
      const auto squared = static_cast<double>((u - x) * (u - x) + (v - y) * (v - y));
      if (ids(v, u) != id && squared <= radius * radius) return true;
    }
  }
  return false;
}

/// Looks pixels of one image up in its mask.
class PixelLookup {
 public:
  PixelLookup(const PanopticFrame& frame, const Camera& camera, double border_px,
              FrameLookup& lookup)
      : frame_(frame),
        scale_x_(static_cast<double>(frame.segment_ids.cols()) / camera.width),
        scale_y_(static_cast<double>(frame.segment_ids.rows()) / camera.height),
        border_px_(border_px),
        lookup_(lookup) {
    if (frame.probabilities) {
      for (const int c : frame.probabilities->class_of_channel) {
        num_classes_ = std::max(num_classes_, c + 1);
      }
    }
    lookup.is_scaled =
        frame.segment_ids.cols() != camera.width || frame.segment_ids.rows() != camera.height;
  }

  /// Adds an observation of the point, if the pixel lies in the mask.
  void Add(uint32_t row, const Eigen::Vector2d& xy, bool predicted) {
    const SegmentImage& ids = frame_.segment_ids;
    const auto x = static_cast<Eigen::Index>(std::floor(xy.x() * scale_x_));
    const auto y = static_cast<Eigen::Index>(std::floor(xy.y() * scale_y_));
    if (x < 0 || y < 0 || x >= ids.cols() || y >= ids.rows()) return;
    PointObservation observation;
    observation.predicted = predicted;
    if (const uint32_t id = ids(y, x); id != kNoSegment) {
      observation.segment = IndexOf(id);
      observation.near_border = IsNearBorder(ids, x, y, border_px_);
      if (frame_.probabilities && !predicted) AddPixel(y, x, observation);
    }
    lookup_.observations.emplace_back(row, observation);
  }

 private:
  void AddPixel(Eigen::Index y, Eigen::Index x, PointObservation& observation) {
    observation.pixel = static_cast<int32_t>(lookup_.pixel_distributions.size());
    lookup_.pixel_distributions.push_back(
        Compress(frame_.probabilities->ClassDistribution(y, x, num_classes_)));
  }

  [[nodiscard]] int32_t IndexOf(uint32_t id) const {
    const auto it =
        std::lower_bound(lookup_.segments.begin(), lookup_.segments.end(), id,
                         [](const auto& s, uint32_t wanted) { return s.first < wanted; });
    S3LAM_CHECK_MSG(it != lookup_.segments.end() && it->first == id, "{}: segment {} is not listed",
                    frame_.source, id);
    return static_cast<int32_t>(it - lookup_.segments.begin());
  }

  const PanopticFrame& frame_;
  double scale_x_;
  double scale_y_;
  double border_px_;
  int num_classes_ = 0;
  FrameLookup& lookup_;
};

void LookUpPoints(const PanopticFrame& frame, const Camera& camera, const PointRows& rows,
                  const VisibilityPredictor& visibility, double border_px, FrameLookup& lookup) {
  PixelLookup pixels(frame, camera, border_px, lookup);
  for (const Point2D& keypoint : lookup.image->points2D) {
    if (keypoint.point_id.valid()) pixels.Add(rows.RowOf(keypoint.point_id), keypoint.xy, false);
  }
  for (const auto& prediction : visibility.Predict(*lookup.image)) {
    pixels.Add(prediction.row, prediction.xy, true);
  }
}

/// Replaces segment ids by indices into the frame's segments and counts their pixels.
void IndexPixels(SegmentImage&& ids, FrameLookup& lookup) {
  lookup.areas.assign(lookup.segments.size(), 0);
  lookup.indices = std::move(ids);
  uint32_t last_id = kNoSegment;
  uint32_t last_index = kNoSegment;
  for (uint32_t& value : lookup.indices.reshaped<Eigen::RowMajor>()) {
    if (value != last_id) {
      last_id = value;
      const auto it =
          std::lower_bound(lookup.segments.begin(), lookup.segments.end(), value,
                           [](const auto& s, uint32_t wanted) { return s.first < wanted; });
      const bool found = it != lookup.segments.end() && it->first == value;
      last_index = found ? static_cast<uint32_t>(it - lookup.segments.begin()) : kNoSegment;
    }
    value = last_index;
    if (last_index != kNoSegment) ++lookup.areas[last_index];
  }
}

FrameLookup LookUpImage(const Reconstruction& reconstruction, const Image& image,
                        const PointRows& rows, const VisibilityPredictor& visibility,
                        const MaskProvider& masks, const LookupOptions& options, bool keep_pixels) {
  FrameLookup lookup;
  lookup.image = &image;
  try {
    std::optional<PanopticFrame> frame = masks(image);
    if (!frame) return lookup;
    const Camera& camera = reconstruction.CameraOf(image);
    CheckMaskShape(*frame, camera, image.name);
    lookup.segments.assign(frame->segments.begin(), frame->segments.end());
    LookUpPoints(*frame, camera, rows, visibility, options.border_px, lookup);
    if (keep_pixels) IndexPixels(std::move(frame->segment_ids), lookup);
    lookup.has_mask = true;
  } catch (const InputError&) {
    if (!options.lenient) throw;
    lookup = FrameLookup{};
    lookup.image = &image;
    lookup.is_bad = true;
  }
  return lookup;
}

/// IoU of every pair of segments of the same class of two frames of the same size.
std::vector<SegmentOverlap> CompareFrames(const FrameLookup& later, const FrameLookup& earlier,
                                          uint32_t frames_apart) {
  std::vector<SegmentOverlap> overlaps;
  if (later.indices.rows() != earlier.indices.rows() ||
      later.indices.cols() != earlier.indices.cols()) {
    return overlaps;
  }
  const size_t columns = earlier.segments.size();
  std::vector<uint32_t> common(later.segments.size() * columns, 0);
  for (Eigen::Index i = 0; i < later.indices.size(); ++i) {
    const uint32_t a = later.indices.data()[i];
    const uint32_t b = earlier.indices.data()[i];
    if (a != kNoSegment && b != kNoSegment) ++common[a * columns + b];
  }
  for (uint32_t a = 0; a < later.segments.size(); ++a) {
    for (uint32_t b = 0; b < columns; ++b) {
      const uint32_t shared = common[a * columns + b];
      if (shared == 0 ||
          later.segments[a].second.class_index != earlier.segments[b].second.class_index) {
        continue;
      }
      const double all = static_cast<double>(later.areas[a]) + earlier.areas[b] - shared;
      overlaps.push_back({a, b, frames_apart, shared / all});
    }
  }
  return overlaps;
}

/// True for the size of the camera's images scaled, to a pixel of the coarser of the two.
bool HasShapeOf(const Camera& camera, double width, double height) {
  const double scale = width / camera.width;
  return std::abs(height - scale * camera.height) <= std::max(1.0, scale);
}

/// Collects the frames' results in order.
class Collector {
 public:
  Collector(const PointRows& rows, MaskObservations& result) : rows_(rows), result_(result) {}

  /// Adds a frame; `overlaps` (with indices local to their frames) compare it with those before.
  void Add(const FrameLookup& lookup, const std::vector<SegmentOverlap>& overlaps) {
    if (lookup.is_bad) ++result_.num_images_with_bad_mask;
    if (!lookup.has_mask && !lookup.is_bad) ++result_.num_images_without_mask;
    if (!lookup.has_mask) return;
    const auto frame = static_cast<uint32_t>(result_.frames.size());
    const auto base = static_cast<uint32_t>(result_.segments.size());
    result_.frames.push_back(lookup.image->id);
    const size_t first_pixel = result_.pixel_distributions.size();
    result_.pixel_distributions.insert(result_.pixel_distributions.end(),
                                       lookup.pixel_distributions.begin(),
                                       lookup.pixel_distributions.end());
    if (lookup.is_scaled) ++result_.num_scaled_masks;
    for (const auto& [id, label] : lookup.segments) {
      result_.segments.push_back({{lookup.image->id, id}, frame, label, {}});
    }
    for (auto [row, observation] : lookup.observations) {
      observation.frame = frame;
      if (observation.pixel >= 0) observation.pixel += static_cast<int32_t>(first_pixel);
      if (observation.segment != kVoidSegment) observation.segment += static_cast<int32_t>(base);
      observations_.emplace_back(row, observation);
    }
    for (const SegmentOverlap& o : overlaps) {
      const uint32_t other_base = frame_base_[frame - o.frames_apart];
      result_.overlaps.push_back({o.segment + base, o.other + other_base, o.frames_apart, o.iou});
    }
    frame_base_.push_back(base);
  }

  void Finish() {
    std::vector<uint32_t> place = PlaceRows();
    for (const auto& [row, observation] : observations_) {
      if (place[row] != kNowhere) result_.observations[place[row]++] = observation;
    }
    for (uint32_t row = 0; row < result_.points.size(); ++row) {
      for (const PointObservation& observation : result_.ObservationsOf(row)) {
        if (observation.segment == kVoidSegment) continue;
        // A point may have two keypoints in one image.
        auto& rows = result_.segments[static_cast<size_t>(observation.segment)].points;
        if (rows.empty() || rows.back() != row) rows.push_back(row);
      }
    }
    std::stable_sort(result_.overlaps.begin(), result_.overlaps.end(),
                     [](const auto& a, const auto& b) { return a.segment < b.segment; });
  }

 private:
  static constexpr uint32_t kNowhere = std::numeric_limits<uint32_t>::max();

  /// Makes a row of the result of every point with a label. Returns for every row of the model
  /// where its observations begin; kNowhere for those left out.
  std::vector<uint32_t> PlaceRows() {
    std::vector<uint32_t> counts(rows_.size(), 0);
    std::vector<bool> is_labelled(rows_.size(), false);
    for (const auto& [row, observation] : observations_) {
      ++counts[row];
      if (observation.segment != kVoidSegment && !observation.predicted) is_labelled[row] = true;
    }
    std::vector<uint32_t> place(rows_.size(), kNowhere);
    uint32_t begin = 0;
    result_.first_observation.push_back(begin);
    for (uint32_t row = 0; row < rows_.size(); ++row) {
      if (!is_labelled[row]) continue;
      place[row] = begin;
      begin += counts[row];
      result_.points.push_back(rows_.IdOf(row));
      result_.first_observation.push_back(begin);
    }
    result_.observations.resize(begin);
    return place;
  }

  const PointRows& rows_;
  MaskObservations& result_;
  std::vector<uint32_t> frame_base_;  // First segment of each frame.
  std::vector<std::pair<uint32_t, PointObservation>>
      observations_;  // By row of the model, by frame.
};

}  // namespace

PixelDistribution Compress(const std::vector<float>& distribution) {
  std::vector<uint16_t> order(distribution.size());
  std::iota(order.begin(), order.end(), uint16_t{0});
  PixelDistribution result;
  const size_t count = std::min(order.size(), PixelDistribution::kMaxClasses);
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                    [&](uint16_t a, uint16_t b) {
                      return distribution[a] != distribution[b] ? distribution[a] > distribution[b]
                                                                : a < b;
                    });
  float rest = 1.0F;
  for (size_t i = 0; i < count; ++i) {
    result.classes[i] = order[i];
    result.probabilities[i] = distribution[order[i]];
    rest -= distribution[order[i]];
  }
  result.num_classes = static_cast<uint16_t>(count);
  if (order.size() > count) {
    result.each_of_others = std::max(0.0F, rest) / static_cast<float>(order.size() - count);
  }
  return result;
}

void CheckMaskShape(const PanopticFrame& frame, const Camera& camera,
                    const std::string& image_name) {
  const auto width = static_cast<double>(frame.segment_ids.cols());
  const auto height = static_cast<double>(frame.segment_ids.rows());
  if (HasShapeOf(camera, width, height)) return;
  const char* hint = HasShapeOf(camera, height, width)
                         ? "turned by EXIF orientation? images are taken as stored"
                         : "of another size, a mask must have the image's aspect ratio, to a pixel";
  ThrowInputError("{}: the mask is {} x {} px but its image {} is {} x {} px; {}", frame.source,
                  width, height, image_name, camera.width, camera.height, hint);
}

void LookupOptions::Visit(OptionVisitor& v) {
  v.Value("border_px", border_px,
          "A keypoint within this distance of another segment counts as near a border [mask px].",
          0.0, 50.0);
  v.Value("lenient", lenient, "Skip and count masks that cannot be used, instead of failing.");
  v.Group("visibility", visibility, "Points that are visible without being observed.");
}

MaskObservations LookUpMasks(const Reconstruction& reconstruction, const MaskProvider& masks,
                             const LookupOptions& options, bool with_overlaps, int num_threads) {
  constexpr size_t kFramesBefore = 2;
  const std::vector<const Image*> images = ImagesInOrder(reconstruction);
  // Frames that keep their pixels take memory; waiting for the last of a batch takes time.
  const size_t batch_size =
      (with_overlaps ? 4 : 64) * static_cast<size_t>(ResolveThreads(num_threads));
  const PointRows rows(reconstruction);
  const VisibilityPredictor visibility(reconstruction, rows, options.visibility);
  MaskObservations result;
  Collector collector(rows, result);
  std::deque<FrameLookup> before;  // The last frames with masks, latest first.
  Progress progress("masks", static_cast<int64_t>(images.size()));
  for (size_t begin = 0; begin < images.size(); begin += batch_size) {
    std::vector<FrameLookup> batch(std::min(batch_size, images.size() - begin));
    ParallelFor(batch.size(), num_threads, [&](size_t i) {
      batch[i] = LookUpImage(reconstruction, *images[begin + i], rows, visibility, masks, options,
                             with_overlaps);
    });
    for (FrameLookup& lookup : batch) {
      std::vector<SegmentOverlap> overlaps;
      if (with_overlaps && lookup.has_mask) {
        for (size_t k = 0; k < before.size(); ++k) {
          const auto found = CompareFrames(lookup, before[k], static_cast<uint32_t>(k + 1));
          overlaps.insert(overlaps.end(), found.begin(), found.end());
        }
      }
      collector.Add(lookup, overlaps);
      if (!with_overlaps || !lookup.has_mask) continue;
      before.push_front(std::move(lookup));
      if (before.size() > kFramesBefore) before.pop_back();
    }
    progress.Update(static_cast<int64_t>(begin + batch.size()));
  }
  collector.Finish();
  return result;
}

}  // namespace s3lam
