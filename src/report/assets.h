#pragma once

#include <string_view>

/// Files that become part of every page, built into the library by assets.cmake.
namespace s3lam::report::assets {

extern const std::string_view kThree;
extern const std::string_view kThreeLicense;
extern const std::string_view kViewer;
extern const std::string_view kStyle;

}  // namespace s3lam::report::assets
