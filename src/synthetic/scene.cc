#include "s3lam/synthetic/scene.h"

#include <algorithm>
#include <cmath>

#include "s3lam/base/error.h"
#include "s3lam/base/options_json.h"
#include "s3lam/base/rng.h"
#include "scene_builder.h"

namespace s3lam {
namespace {

// A hand-held camera with visible barrel distortion, a little different for each seed.
Camera HandheldCamera(uint64_t seed) {
  Rng rng = Rng(seed).Fork(3);
  Camera camera;
  camera.id = CameraId(1);
  camera.model = CameraModel::kOpenCv;
  camera.width = 640;
  camera.height = 480;
  const double focal = rng.Uniform(505.0, 535.0);
  camera.params = {focal,
                   focal * rng.Uniform(0.998, 1.002),
                   320.0 + rng.Uniform(-6.0, 6.0),
                   240.0 + rng.Uniform(-6.0, 6.0),
                   rng.Uniform(-0.18, -0.10),
                   rng.Uniform(0.02, 0.06),
                   rng.Uniform(-5e-4, 5e-4),
                   rng.Uniform(-5e-4, 5e-4)};
  return camera;
}

struct SceneEntry {
  const char* name;
  void (*build)(Scene&);
};
constexpr SceneEntry kScenes[] = {
    {"desk", synthetic::BuildDesk},       {"floor", synthetic::BuildFloor},
    {"posters", synthetic::BuildPosters}, {"room", synthetic::BuildRoom},
    {"street", synthetic::BuildStreet},
};

}  // namespace

const std::vector<std::string>& SceneNames() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const SceneEntry& entry : kScenes) all.emplace_back(entry.name);
    return all;
  }();
  return names;
}

Scene MakeScene(const std::string& name, uint64_t seed, const SceneOptions& options) {
  const auto* entry = std::find_if(std::begin(kScenes), std::end(kScenes),
                                   [&](const SceneEntry& e) { return name == e.name; });
  if (entry == std::end(kScenes)) {
    throw UsageError(fmt::format("unknown scene '{}', did you mean '{}'? (there are {})", name,
                                 NearestWord(name, SceneNames()), fmt::join(SceneNames(), ", ")));
  }
  Scene scene;
  scene.name = name;
  scene.seed = seed;
  scene.camera = HandheldCamera(seed);
  entry->build(scene);
  scene.imaging.noise_sigma *= options.noise_factor;
  scene.imaging.exposure_time_s *= options.motion_blur;
  scene.imaging.readout_time_s = options.readout_s;
  scene.path.SetDuration(scene.path.duration_s() / options.speed);
  const double whole_path = std::round(scene.path.duration_s() * scene.fps);
  scene.num_frames =
      options.num_frames > 0 ? options.num_frames : std::max(1, static_cast<int>(whole_path));
  return scene;
}

}  // namespace s3lam
