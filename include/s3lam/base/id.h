#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>

namespace s3lam {

/// An integer id that cannot be mixed up with an id of another kind.
template <typename Tag, typename Rep>
class Id {
 public:
  using Value = Rep;

  constexpr Id() = default;
  constexpr explicit Id(Rep value) : value_(value) {}

  [[nodiscard]] constexpr Rep value() const { return value_; }
  [[nodiscard]] constexpr bool valid() const { return value_ != std::numeric_limits<Rep>::max(); }
  constexpr auto operator<=>(const Id&) const = default;

 private:
  Rep value_ = std::numeric_limits<Rep>::max();
};

using CameraId = Id<struct CameraTag, uint32_t>;
using ImageId = Id<struct ImageTag, uint32_t>;
using PointId = Id<struct PointTag, uint64_t>;
using ClusterId = Id<struct ClusterTag, uint32_t>;
using PlaneId = Id<struct PlaneTag, uint32_t>;

inline constexpr ImageId kInvalidImageId{};
inline constexpr PointId kInvalidPointId{};
inline constexpr ClusterId kInvalidClusterId{};

}  // namespace s3lam

template <typename Tag, typename Rep>
struct std::hash<s3lam::Id<Tag, Rep>> {
  size_t operator()(const s3lam::Id<Tag, Rep>& id) const noexcept {
    return std::hash<Rep>()(id.value());
  }
};
