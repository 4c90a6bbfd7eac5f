#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "s3lam/synthetic/panoptic.h"
#include "s3lam/synthetic/scene.h"

namespace s3lam::synthetic {

/// Rows of a COCO panoptic JSON's "categories".
nlohmann::json CategoriesJson(const ClassTable& table);

/// One entry of a COCO panoptic JSON's "annotations".
nlohmann::json AnnotationJson(const Scene& scene, const SyntheticPanoptic& panoptic, int image_id,
                              const std::string& mask_name);

/// One entry of truth_*.json's "frames".
nlohmann::json FrameTruthJson(const Scene& scene, const SyntheticPanoptic& panoptic);

/// objects.json.
nlohmann::json ObjectsJson(const Scene& scene);

}  // namespace s3lam::synthetic
