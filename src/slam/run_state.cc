#include "s3lam/slam/run_state.h"

#include <algorithm>

#include "s3lam/base/archive.h"
#include "s3lam/base/log.h"

namespace s3lam::slam {
namespace {

constexpr const char* kFeatures = "features";
constexpr const char* kState = "state";

template <typename A>
void TransferCamera(A& archive, Camera& camera) {
  archive(camera.model, camera.width, camera.height, camera.params);
}

/// What the steps write into the report; their times are those of each run.
template <typename A>
void TransferReport(A& archive, Report& report) {
  bool has_focal = report.focal.has_value();
  archive(report.remapping, report.num_merged_maps, report.camera_was_refined,
          report.calibration_was_checked, report.distortion_cost_share, report.pinhole_cost_share,
          report.better_pinhole, has_focal);
  if (!has_focal) return;
  if constexpr (A::kReads) report.focal.emplace();
  archive(*report.focal);
}

template <typename A>
void TransferBuilder(A& archive, const MapBuilderFactory& make,
                     std::unique_ptr<MapBuilder>& builder) {
  bool is_there = builder != nullptr;
  archive(is_there);
  if (!is_there) return;
  if constexpr (A::kReads) builder = make({});
  archive(*builder);
}

template <typename A>
void TransferMaps(A& archive, const MapBuilderFactory& make, Submaps& maps) {
  size_t size = maps.size();
  archive(size);
  maps.resize(size);
  for (std::unique_ptr<MapBuilder>& map : maps) TransferBuilder(archive, make, map);
}

}  // namespace

std::vector<FrameFeatures> KeptFeatures(
    StepStore* store, const std::function<std::vector<FrameFeatures>()>& extract) {
  if (store == nullptr) return extract();
  std::vector<FrameFeatures> frames;
  if (const auto kept = store->Recall(kFeatures)) {
    ArchiveReader archive(*kept);
    archive(frames);
    return frames;
  }
  frames = extract();
  ArchiveWriter archive;
  archive(frames);
  store->Keep(kFeatures, archive.bytes());
  return frames;
}

Steps::Steps(StepStore* store, double interval_s, const MapBuilderFactory& make_builder,
             RunState& state)
    : store_(store),
      interval_s_(interval_s),
      make_builder_(make_builder),
      state_(state),
      camera_(state.undistorter.camera()) {
  if (store_ == nullptr) return;
  const auto kept = store_->Recall(kState);
  if (!kept) return;
  ArchiveReader archive(*kept);
  Transfer(archive);
  num_left_out_ = num_done_;
  spdlog::info("{} steps are done already", num_done_);
}

void Steps::Do(const std::function<void()>& step) {
  if (num_left_out_ > 0) {
    --num_left_out_;
    return;
  }
  step();
  ++num_done_;
  Keep();
}

void Steps::KeepNowAndThen() {
  if (since_kept_.Seconds() >= interval_s_) Keep();
}

void Steps::Keep() {
  if (store_ == nullptr) return;
  ArchiveWriter archive;
  Transfer(archive);
  store_->Keep(kState, archive.bytes());
  since_kept_ = Timer();
}

/// Tracking leaves the features as they were; later steps change those of keyframes, and those of
/// all frames when they refine the camera.
template <typename A>
void Steps::TransferFeatures(A& archive) {
  Camera camera = state_.undistorter.camera();
  TransferCamera(archive, camera);
  const bool is_refined = camera.model != camera_.model || camera.params != camera_.params;
  if constexpr (A::kReads) {
    if (is_refined) state_.undistorter = Undistorter(camera);
  }
  std::vector<uint8_t> is_kept(state_.frames.size(), is_refined ? 1 : 0);
  for (const auto& builder : state_.maps) {
    const Map& map = builder->map();
    for (int k = 0; k < map.num_keyframes(); ++k) is_kept[map.keyframe(k).frame] = 1;
  }
  for (size_t i = 0; i < is_kept.size(); ++i) {
    if (is_kept[i] != 0) archive(state_.frames[i]);
  }
}

template <typename A>
void Steps::Transfer(A& archive) {
  archive(num_done_, state_.tracking.is_done, state_.loops, state_.camera_stays);
  TransferMaps(archive, make_builder_, state_.tracking.maps);
  TransferBuilder(archive, make_builder_, state_.tracking.growing);
  TransferMaps(archive, make_builder_, state_.maps);
  TransferReport(archive, state_.report);
  TransferFeatures(archive);
}

}  // namespace s3lam::slam
