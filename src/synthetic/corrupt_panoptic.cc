#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "piece_map.h"
#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"
#include "s3lam/base/rng.h"
#include "s3lam/synthetic/panoptic.h"
#include "scene_builder.h"

namespace s3lam {
namespace synthetic {
namespace {

// Each kind of error has its own stream, so that changing one rate leaves the others' draws alone.
enum Kind : uint64_t { kWarp, kMissed, kClass, kMerge, kSplit, kCut, kScore };

struct ClassPair {
  int from, to;
};
// What networks take for what.
constexpr std::array<ClassPair, 24> kCocoConfusions{{
    {coco::kBook, coco::kPaper},
    {coco::kPaper, coco::kBook},
    {coco::kDiningTable, coco::kCabinet},
    {coco::kCabinet, coco::kWallOther},
    {coco::kWallOther, coco::kCabinet},
    {coco::kFloorOther, coco::kFloorWood},
    {coco::kFloorWood, coco::kRug},
    {coco::kRug, coco::kFloorWood},
    {coco::kCardboard, coco::kCabinet},
    {coco::kTv, coco::kLaptop},
    {coco::kLaptop, coco::kTv},
    {coco::kKeyboard, coco::kLaptop},
    {coco::kChair, coco::kCouch},
    {coco::kCouch, coco::kChair},
    {coco::kCup, coco::kBowl},
    {coco::kBowl, coco::kCup},
    {coco::kBottle, coco::kVase},
    {coco::kPlant, coco::kVase},
    {coco::kDoor, coco::kWallOther},
    {coco::kShelf, coco::kCabinet},
    {coco::kCeiling, coco::kWallOther},
    {coco::kSportsBall, coco::kBowl},
    {coco::kMouse, coco::kCup},
    {coco::kVase, coco::kBottle},
}};
constexpr std::array<ClassPair, 10> kCityscapesConfusions{{
    {cityscapes::kRoad, cityscapes::kSidewalk},
    {cityscapes::kSidewalk, cityscapes::kRoad},
    {cityscapes::kBuilding, cityscapes::kWall},
    {cityscapes::kWall, cityscapes::kBuilding},
    {cityscapes::kFence, cityscapes::kWall},
    {cityscapes::kPole, cityscapes::kSign},
    {cityscapes::kSign, cityscapes::kBuilding},
    {cityscapes::kVegetation, cityscapes::kTerrain},
    {cityscapes::kTerrain, cityscapes::kSidewalk},
    {cityscapes::kCar, cityscapes::kBuilding},
}};

template <size_t N>
int FindConfusion(const std::array<ClassPair, N>& pairs, int class_id) {
  for (const ClassPair& pair : pairs) {
    if (pair.from == class_id) return pair.to;
  }
  return class_id;
}

// Fills pieces with errors, one kind after the other.
class Corruptor {
 public:
  Corruptor(const Scene& scene, int frame, const MaskCorruptionOptions& options, PieceMap& map)
      : scene_(scene), frame_(frame), options_(options), map_(map) {}

  std::vector<int> Run() {
    if (options_.level <= 0.0) return {};
    WarpBorders();
    Measure();
    std::vector<int> missed = MissThings();
    MergeThings();
    SplitThings();
    ConfuseClasses();
    CutStuff();
    DrawScores();
    return missed;
  }

 private:
  struct Presence {
    int area = 0;
    cv::Rect box;
  };

  // A number in [0, 1) that belongs to this kind of error, object and frame.
  [[nodiscard]] Rng Draw(Kind kind, int object, int frame) const {
    return Rng(scene_.seed)
        .Fork(kCorruptionStream + kind)
        .Fork(static_cast<uint64_t>(object))
        .Fork(static_cast<uint64_t>(frame));
  }
  [[nodiscard]] bool Happens(Kind kind, int object, double rate) const {
    return Draw(kind, object, frame_).Uniform() < rate * options_.level;
  }
  [[nodiscard]] bool HappensInBurst(Kind kind, int object, double rate) const;

  void WarpBorders();
  void Measure();
  std::vector<int> MissThings();
  void MergeThings();
  void SplitThings();
  void ConfuseClasses();
  void CutStuff();
  void DrawScores();

  [[nodiscard]] std::map<std::pair<int, int>, int> Contacts() const;
  void Absorb(int object, int by);
  int SeparatePart(int object, double share, Rng rng);
  Piece& PieceOf(int index) { return map_.pieces[static_cast<size_t>(index)]; }

  const Scene& scene_;
  int frame_;
  const MaskCorruptionOptions& options_;
  PieceMap& map_;
  std::map<int, Presence> present_;  // By object (= index of its first piece), background left out.
};

// Bursts of one to three frames, at the stated rate per frame: with starts at rate p and lengths
// 1, 2, 3 alike, a frame is outside all bursts with probability (1 - p)(1 - 2p/3)(1 - p/3), which
// is (1 - p)^2 to first order.
bool Corruptor::HappensInBurst(Kind kind, int object, double rate) const {
  const double start = 1.0 - std::sqrt(std::max(0.0, 1.0 - rate * options_.level));
  for (int ago = 0; ago < 3 && ago <= frame_; ++ago) {
    Rng rng = Draw(kind, object, frame_ - ago);
    const bool starts = rng.Uniform() < start;
    if (starts && static_cast<int>(rng.Below(3)) >= ago) return true;
  }
  return false;
}

void Corruptor::WarpBorders() {
  constexpr double kCell_px = 28.0;  // Over which borders wander together.
  Rng rng = Draw(kWarp, 0, frame_);
  const double amplitude =
      options_.border_px * std::sqrt(options_.level / 0.15) * rng.Uniform(0.5, 1.0);
  const cv::Size size = map_.image.size();
  const cv::Size grid(static_cast<int>(size.width / kCell_px) + 2,
                      static_cast<int>(size.height / kCell_px) + 2);
  std::array<cv::Mat, 2> shift;
  for (cv::Mat& axis : shift) {
    cv::Mat coarse(grid, CV_32F);
    for (int y = 0; y < grid.height; ++y) {
      for (int x = 0; x < grid.width; ++x) {
        coarse.at<float>(y, x) = static_cast<float>(amplitude * rng.Uniform(-1.0, 1.0));
      }
    }
    cv::resize(coarse, axis, size, 0.0, 0.0, cv::INTER_CUBIC);
  }
  cv::Mat warped(size, CV_32S);
  for (int y = 0; y < size.height; ++y) {
    int* out = warped.ptr<int>(y);
    const float* dx = shift[0].ptr<float>(y);
    const float* dy = shift[1].ptr<float>(y);
    for (int x = 0; x < size.width; ++x) {
      const int from_x = std::clamp(x + static_cast<int>(std::lround(dx[x])), 0, size.width - 1);
      const int from_y = std::clamp(y + static_cast<int>(std::lround(dy[x])), 0, size.height - 1);
      out[x] = map_.image.at<int>(from_y, from_x);
    }
  }
  map_.image = warped;
}

void Corruptor::Measure() {
  for (int y = 0; y < map_.image.rows; ++y) {
    const int* piece = map_.image.ptr<int>(y);
    for (int x = 0; x < map_.image.cols;) {
      int end = x + 1;
      while (end < map_.image.cols && piece[end] == piece[x]) ++end;
      if (piece[x] != 0) {
        Presence& presence = present_[piece[x]];
        presence.area += end - x;
        const cv::Rect run(x, y, end - x, 1);
        presence.box = presence.box.empty() ? run : presence.box | run;
      }
      x = end;
    }
  }
}

// Length (px) of the border between every two pieces that touch, the smaller index first.
std::map<std::pair<int, int>, int> Corruptor::Contacts() const {
  std::map<std::pair<int, int>, int> contacts;
  for (int y = 0; y + 1 < map_.image.rows; ++y) {
    const int* row = map_.image.ptr<int>(y);
    const int* next = map_.image.ptr<int>(y + 1);
    for (int x = 0; x + 1 < map_.image.cols; ++x) {
      if (row[x] != row[x + 1]) ++contacts[std::minmax(row[x], row[x + 1])];
      if (row[x] != next[x]) ++contacts[std::minmax(row[x], next[x])];
    }
  }
  return contacts;
}

void Corruptor::Absorb(int object, int by) {
  const cv::Rect box = present_.at(object).box;
  for (int y = box.y; y < box.br().y; ++y) {
    int* piece = map_.image.ptr<int>(y);
    std::replace(piece + box.x, piece + box.br().x, object, by);
  }
}

std::vector<int> Corruptor::MissThings() {
  std::vector<int> missed;
  for (const auto& [object, presence] : present_) {
    if (PieceOf(object).is_thing && HappensInBurst(kMissed, object, options_.missed)) {
      missed.push_back(object);
    }
  }
  if (missed.empty()) return missed;
  const auto contacts = Contacts();
  Piece nothing;
  map_.pieces.push_back(nothing);
  const int void_piece = static_cast<int>(map_.pieces.size()) - 1;
  for (const int object : missed) {
    // Its pixels go to what it touches most, or to nothing.
    int by = void_piece;
    int longest = 0;
    for (const auto& [pair, length] : contacts) {
      if (pair.first != object && pair.second != object) continue;
      const int other = pair.first == object ? pair.second : pair.first;
      const bool is_missed = std::find(missed.begin(), missed.end(), other) != missed.end();
      if (length > longest && !is_missed) {
        longest = length;
        by = other;
      }
    }
    Rng rng = Draw(kMissed, object, frame_).Fork(1);
    Absorb(object, rng.Uniform() < 0.3 ? void_piece : by);
    present_.erase(object);
  }
  return missed;
}

void Corruptor::MergeThings() {
  constexpr int kTouching_px = 8;
  for (const auto& [pair, length] : Contacts()) {
    if (length < kTouching_px || pair.first == 0) continue;
    const auto is_object = [&](int index) { return present_.count(index) > 0; };
    if (!is_object(pair.first) || !is_object(pair.second)) continue;
    Piece& a = PieceOf(pair.first);
    Piece& b = PieceOf(pair.second);
    if (!a.is_thing || a.class_id != b.class_id || a.group == b.group) continue;
    // Drawn by the pair, whatever else happens to either.
    const int name = pair.first * 100003 + pair.second;
    if (!Happens(kMerge, name, options_.merged)) continue;
    const int group = std::min(a.group, b.group);
    const int old = std::max(a.group, b.group);
    for (Piece& piece : map_.pieces) {
      if (piece.is_thing && piece.group == old) piece.group = group;
    }
    b.notes.push_back({"merge", pair.second});
  }
}

// Gives the pixels of an object beyond a straight line, about `share` of it, a piece of their own,
// and returns its index.
int Corruptor::SeparatePart(int object, double share, Rng rng) {
  const cv::Rect box = present_.at(object).box;
  const double angle = rng.Uniform(0.0, 2.0 * std::numbers::pi);
  const double nx = std::cos(angle);
  const double ny = std::sin(angle);
  std::vector<std::pair<int, int>> pixels;
  std::vector<float> along;
  for (int y = box.y; y < box.br().y; ++y) {
    const int* piece = map_.image.ptr<int>(y);
    for (int x = box.x; x < box.br().x; ++x) {
      if (piece[x] != object) continue;
      pixels.emplace_back(x, y);
      along.push_back(static_cast<float>(nx * x + ny * y));
    }
  }
  Piece part = PieceOf(object);
  map_.pieces.push_back(part);
  const int index = static_cast<int>(map_.pieces.size()) - 1;
  if (along.empty()) return index;
  std::vector<float> sorted = along;
  const auto rank =
      std::min(sorted.size() - 1, static_cast<size_t>(share * static_cast<double>(sorted.size())));
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<ptrdiff_t>(rank), sorted.end());
  for (size_t i = 0; i < pixels.size(); ++i) {
    if (along[i] < sorted[rank]) map_.image.at<int>(pixels[i].second, pixels[i].first) = index;
  }
  return index;
}

void Corruptor::SplitThings() {
  for (const auto& [object, presence] : present_) {
    if (!PieceOf(object).is_thing || !Happens(kSplit, object, options_.split)) continue;
    Rng rng = Draw(kSplit, object, frame_).Fork(1);
    const int part = SeparatePart(object, rng.Uniform(0.3, 0.7), rng);
    // Instance numbers beyond those of the objects.
    PieceOf(part).group = static_cast<int>(scene_.objects.size()) + object;
    for (const int index : {object, part}) PieceOf(index).notes.push_back({"split", object});
  }
}

void Corruptor::ConfuseClasses() {
  const double large = 0.08 * map_.image.rows * map_.image.cols;
  for (const auto& [object, presence] : present_) {
    if (!HappensInBurst(kClass, object, options_.wrong_class)) continue;
    const int class_id = PieceOf(object).class_id;
    const int wrong = scene_.layout == SequenceLayout::kKittiStep
                          ? FindConfusion(kCityscapesConfusions, class_id)
                          : FindConfusion(kCocoConfusions, class_id);
    if (wrong == class_id) continue;
    Rng rng = Draw(kClass, object, frame_).Fork(1);
    // Of something large, only a part.
    const int index =
        presence.area > large ? SeparatePart(object, rng.Uniform(0.1, 0.35), rng) : object;
    Piece& piece = PieceOf(index);
    piece.class_id = wrong;
    piece.is_thing =
        scene_.class_table.classes[static_cast<size_t>(*scene_.class_table.IndexOfId(wrong))]
            .is_thing;
    piece.notes.push_back({"class", object});
  }
}

void Corruptor::CutStuff() {
  for (const auto& [object, presence] : present_) {
    if (PieceOf(object).is_thing || !HappensInBurst(kCut, object, options_.cut)) continue;
    Rng rng = Draw(kCut, object, frame_).Fork(1);
    Piece& part = PieceOf(SeparatePart(object, rng.Uniform(0.15, 0.4), rng));
    part.class_id = -1;
    PieceOf(object).notes.push_back({"cut", object});
  }
}

void Corruptor::DrawScores() {
  for (size_t i = 0; i < map_.pieces.size(); ++i) {
    Piece& piece = map_.pieces[i];
    Rng rng = Draw(kScore, static_cast<int>(i), frame_);
    piece.score = piece.notes.empty() ? rng.Uniform(0.7, 0.98) : rng.Uniform(0.45, 0.85);
    // What networks print: two decimals.
    piece.score = std::round(100.0 * piece.score) / 100.0;
  }
}

}  // namespace
}  // namespace synthetic

SyntheticPanoptic MakeCorruptedPanoptic(const Scene& scene, int frame, const cv::Mat& labels,
                                        const MaskCorruptionOptions& options) {
  S3LAM_CHECK(frame >= 0);
  synthetic::PieceMap map = synthetic::MakePieces(scene, labels);
  const std::vector<int> missed = synthetic::Corruptor(scene, frame, options, map).Run();
  SyntheticPanoptic result = synthetic::AssemblePanoptic(scene, frame, map, labels);
  result.missed = missed;
  return result;
}

}  // namespace s3lam
