#include "s3lam/synthetic/panoptic.h"

#include <algorithm>
#include <set>
#include <utility>

#include "piece_map.h"
#include "s3lam/base/error.h"
#include "s3lam/base/rng.h"

namespace s3lam {
namespace synthetic {

namespace {

constexpr int kMinSegmentPixels = 100;

// Segments are told apart by class and, for things, by piece group.
using SegmentKey = std::pair<int, int>;

struct Segment {
  int class_id = 0;
  bool is_thing = false;
  int instance = 0;
  int area = 0;
  double score = 1.0;
  SegmentTruth truth;
};

// Random ids as converters of COCO panoptic draw them: half of them below 256.
uint32_t DrawCocoId(Rng& rng, std::set<uint32_t>& taken) {
  while (true) {
    const uint64_t limit = rng.Below(2) == 0 ? 255 : (1U << 24U) - 1U;
    const auto id = static_cast<uint32_t>(1 + rng.Below(limit));
    if (taken.insert(id).second) return id;
  }
}

uint32_t KittiStepId(int class_id, int instance) {
  return static_cast<uint32_t>(class_id + 256 * (instance / 256) + 65536 * (instance % 256));
}

SegmentKey KeyOf(const Piece& piece) { return {piece.class_id, piece.is_thing ? piece.group : -1}; }

// One entry per key, in the order of keys.
std::map<SegmentKey, Segment> CollectSegments(const PieceMap& map, const cv::Mat& clean_labels) {
  std::map<SegmentKey, Segment> segments;
  std::vector<Segment*> segment_of_piece(map.pieces.size(), nullptr);
  for (size_t i = 0; i < map.pieces.size(); ++i) {
    const Piece& piece = map.pieces[i];
    if (piece.class_id < 0) continue;
    Segment& segment = segments[KeyOf(piece)];
    segment.class_id = piece.class_id;
    segment.is_thing = piece.is_thing;
    segment.instance = piece.is_thing ? piece.group : 0;
    segment.score = std::min(segment.score, piece.score);
    segment.truth.corruption.insert(segment.truth.corruption.end(), piece.notes.begin(),
                                    piece.notes.end());
    segment_of_piece[i] = &segment;
  }
  for (int y = 0; y < map.image.rows; ++y) {
    const int* piece = map.image.ptr<int>(y);
    const int* object = clean_labels.ptr<int>(y);
    // Runs of equal pixels keep the number of map look-ups small.
    for (int x = 0; x < map.image.cols;) {
      int end = x + 1;
      while (end < map.image.cols && piece[end] == piece[x] && object[end] == object[x]) ++end;
      if (Segment* segment = segment_of_piece[static_cast<size_t>(piece[x])]) {
        segment->area += end - x;
        segment->truth.object_pixels[object[x]] += end - x;
      }
      x = end;
    }
  }
  return segments;
}

PanopticSegment Describe(const Scene& scene, const Segment& segment) {
  PanopticSegment described;
  described.class_index = *scene.class_table.IndexOfId(segment.class_id);
  described.score = segment.score;
  return described;
}

}  // namespace

SyntheticPanoptic AssemblePanoptic(const Scene& scene, int frame, const PieceMap& map,
                                   const cv::Mat& clean_labels) {
  SyntheticPanoptic result;
  std::map<SegmentKey, Segment> segments = CollectSegments(map, clean_labels);
  Rng rng = Rng(scene.seed).Fork(kIdStream).Fork(static_cast<uint64_t>(frame));
  std::set<uint32_t> taken;
  std::map<SegmentKey, uint32_t> ids;
  for (auto& [key, segment] : segments) {
    if (segment.area < kMinSegmentPixels) continue;
    const uint32_t id = scene.layout == SequenceLayout::kKittiStep
                            ? KittiStepId(segment.class_id, segment.instance)
                            : DrawCocoId(rng, taken);
    ids[key] = id;
    result.frame.segments[id] = Describe(scene, segment);
    const auto most =
        std::max_element(segment.truth.object_pixels.begin(), segment.truth.object_pixels.end(),
                         [](const auto& a, const auto& b) { return a.second < b.second; });
    segment.truth.object = most->first;
    result.truth[id] = std::move(segment.truth);
  }
  std::vector<uint32_t> id_of_piece;
  for (const Piece& piece : map.pieces) {
    const auto id = piece.class_id < 0 ? ids.end() : ids.find(KeyOf(piece));
    id_of_piece.push_back(id == ids.end() ? kNoSegment : id->second);
  }
  result.frame.segment_ids.resize(map.image.rows, map.image.cols);
  for (int y = 0; y < map.image.rows; ++y) {
    const int* piece = map.image.ptr<int>(y);
    for (int x = 0; x < map.image.cols; ++x) {
      result.frame.segment_ids(y, x) = id_of_piece[static_cast<size_t>(piece[x])];
    }
  }
  return result;
}

PieceMap MakePieces(const Scene& scene, const cv::Mat& labels) {
  S3LAM_CHECK(labels.type() == CV_32S);
  PieceMap map;
  // Piece i shows object i; piece 0 is the background.
  Piece background;
  background.class_id = scene.background_class_id;
  map.pieces.push_back(background);
  for (const SceneObject& object : scene.objects) {
    Piece piece;
    piece.object = object.id;
    piece.class_id = object.class_id;
    piece.is_thing = object.is_thing;
    piece.group = object.id;
    map.pieces.push_back(piece);
  }
  map.image = labels.clone();
  return map;
}

}  // namespace synthetic

SyntheticPanoptic MakePanoptic(const Scene& scene, int frame, const cv::Mat& labels) {
  return synthetic::AssemblePanoptic(scene, frame, synthetic::MakePieces(scene, labels), labels);
}

}  // namespace s3lam
