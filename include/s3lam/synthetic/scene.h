#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "s3lam/base/options.h"
#include "s3lam/geometry/camera.h"
#include "s3lam/geometry/plane.h"
#include "s3lam/scene/semantic_map.h"
#include "s3lam/synthetic/camera_path.h"
#include "s3lam/synthetic/texture.h"

namespace s3lam {

enum class SurfaceShape { kPolygon, kCylinder, kEllipsoid };

/// One textured patch, seen from both sides. World axes: z up, metres.
struct Surface {
  SurfaceShape shape = SurfaceShape::kPolygon;
  int object = 0;  // Index into Scene::objects.

  /// Polygon: three or four coplanar corners of a convex outline, counter-clockwise as seen from
  /// its front. Texture coordinates (m) have their origin in corner 0 and u towards corner 1.
  std::vector<Eigen::Vector3d> corners;

  /// Curved: the unit cylinder x^2 + y^2 = 1, z in [z_min, z_max], or the unit sphere cut at these
  /// z, scaled by `radii` (for the cylinder radii.z is the unit of z) and moved into the world; cut
  /// to azimuths [angle_min, angle_max] (rad, within [-pi, pi]).
  Rigid3 world_from_local;
  Eigen::Vector3d radii = Eigen::Vector3d::Ones();
  double z_min = -1.0;
  double z_max = 1.0;
  double angle_min = -4.0;
  double angle_max = 4.0;

  TextureSpec texture;
};

/// A thing, or one stretch of stuff (a segment of a mask holds all stretches of its class).
struct SceneObject {
  int id = 0;  // Positive; 0 is the background.
  std::string name;
  int class_id = 0;
  bool is_thing = false;
  /// The plane of its main face (normal towards the free side) if the object is planar; parts such
  /// as a book's edges or a table's legs do not lie on it.
  std::optional<Plane> plane_in_world;
  double flatness_m = 0.0;  // Largest distance of its main face from that plane.
};

/// How the sensor spoils the picture.
struct Imaging {
  double noise_sigma = 2.0;        // Gray levels at mid gray (a shot-noise part included).
  double vignetting = 0.25;        // Loss of light in the corners, 0..1.
  double exposure_swing = 0.08;    // Relative amplitude of slow exposure changes.
  double exposure_time_s = 0.008;  // Motion blur.
  double readout_time_s = 0.0;     // Rolling shutter: from the first row's exposure to the last's.
  bool color = true;               // BGR, else gray.
};

/// Which kind of data set the sequence is written as.
enum class SequenceLayout { kTumCoco, kKittiStep };

/// Everything that is seen, and by whom: a pure function of name, seed and options.
struct Scene {
  std::string name;
  uint64_t seed = 0;
  SequenceLayout layout = SequenceLayout::kTumCoco;
  ClassTable class_table;
  Camera camera;
  double fps = 30.0;
  int num_frames = 0;
  CameraPath path;
  Imaging imaging;
  std::vector<SceneObject> objects;  // objects[i].id == i + 1.
  std::vector<Surface> surfaces;
  Rgb background{205, 200, 190};  // Colour of what no surface covers.
  int background_class_id = -1;   // Class of it; -1 leaves it void.

  [[nodiscard]] double TimeOf(int frame) const { return frame / fps; }
  /// Pose at the middle of the frame's exposure, of the middle row if the shutter is a rolling one.
  [[nodiscard]] Rigid3 WorldFromCamera(int frame) const {
    return path.WorldFromCamera(TimeOf(frame));
  }
};

struct SceneOptions {
  int num_frames = 0;         // 0: as many as the scene has by default.
  double noise_factor = 1.0;  // Multiplies sensor noise.
  double motion_blur = 1.0;   // Multiplies the exposure time.
  double readout_s = 0.0;     // Of a rolling shutter, see Imaging.
  double speed = 1.0;         // Multiplies the speed along the path.
  void Visit(OptionVisitor& v) {
    v.Value("num_frames", num_frames, "frames to render; 0: the scene's own number", 0, 1000000);
    v.Value("noise_factor", noise_factor, "multiplies the sensor noise", 0.0, 20.0);
    v.Value("motion_blur", motion_blur, "multiplies the exposure time", 0.0, 20.0);
    v.Value("readout_s", readout_s,
            "rolling shutter: time from the exposure of the first row to that of the last; poses "
            "are those of the middle row [s]",
            0.0, 1.0);
    v.Value("speed", speed, "multiplies the camera's speed (fewer frames for the same path)", 0.05,
            20.0);
  }
};

/// "desk", "floor", "posters", "room", "street".
const std::vector<std::string>& SceneNames();

/// Throws UsageError naming the nearest known scene for an unknown name.
Scene MakeScene(const std::string& name, uint64_t seed, const SceneOptions& options = {});

}  // namespace s3lam
