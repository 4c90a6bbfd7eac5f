#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "s3lam/scene/semantic_map.h"

namespace s3lam {

/// {"name": ..., "classes": [...]}, as in configs/classes/.
nlohmann::json ClassTableToJson(const ClassTable& table);

/// Throws InputError with `where`, the entry and the reason.
ClassTable ClassTableFromJson(const nlohmann::json& json, const std::string& where);

}  // namespace s3lam
