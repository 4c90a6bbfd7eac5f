#include "s3lam/scene/probability_volume.h"

#include <cmath>
#include <cstring>
#include <limits>

#include "s3lam/base/error.h"

namespace s3lam {
namespace {

float FromHalf(uint16_t half) {
  const int exponent = half >> 10 & 0x1F;
  const int mantissa = half & 0x3FF;
  const float sign = half >> 15 != 0 ? -1.0F : 1.0F;
  if (exponent == 0x1F) {
    return mantissa != 0 ? std::numeric_limits<float>::quiet_NaN()
                         : sign * std::numeric_limits<float>::infinity();
  }
  if (exponent == 0) return sign * std::ldexp(static_cast<float>(mantissa), -24);
  return sign * std::ldexp(static_cast<float>(mantissa + 1024), exponent - 25);
}

const std::vector<float>& HalfTable() {
  static const std::vector<float> table = [] {
    std::vector<float> values(1U << 16U);
    for (size_t i = 0; i < values.size(); ++i) values[i] = FromHalf(static_cast<uint16_t>(i));
    return values;
  }();
  return table;
}

template <typename Item>
Item Load(const char* data, size_t index) {
  Item item;
  std::memcpy(&item, data + index * sizeof(Item), sizeof(Item));
  return item;
}

/// Item `index` counted from `data`.
float Value(ProbabilityVolume::Type type, const char* data, size_t index) {
  switch (type) {
    case ProbabilityVolume::Type::kFloat32:
      return Load<float>(data, index);
    case ProbabilityVolume::Type::kFloat16:
      return HalfTable()[Load<uint16_t>(data, index)];
    case ProbabilityVolume::Type::kUint8:
      break;
  }
  return static_cast<float>(Load<uint8_t>(data, index)) / 255.0F;
}

/// What a sum of probabilities may miss one by: rounding of each item, and a network's own.
float SumTolerance(const ProbabilityVolume& volume) {
  constexpr float kOwn = 0.01F;
  return volume.type == ProbabilityVolume::Type::kUint8
             ? kOwn + static_cast<float>(volume.channels) * 0.5F / 255.0F
             : kOwn;
}

}  // namespace

float ProbabilityVolume::At(int channel, Eigen::Index row, Eigen::Index col) const {
  const auto plane = static_cast<size_t>(rows) * static_cast<size_t>(cols);
  const size_t index = static_cast<size_t>(channel) * plane +
                       static_cast<size_t>(row) * static_cast<size_t>(cols) +
                       static_cast<size_t>(col);
  return Value(type, bytes.data() + offset, index);
}

std::vector<float> ProbabilityVolume::ClassDistribution(Eigen::Index row, Eigen::Index col,
                                                        int num_classes) const {
  std::vector<float> result(static_cast<size_t>(num_classes), 0.0F);
  float sum = 0.0F;
  for (int c = 0; c < channels; ++c) {
    const int class_index = class_of_channel[static_cast<size_t>(c)];
    if (class_index < 0) continue;
    const float p = At(c, row, col);
    result[static_cast<size_t>(class_index)] += p;
    sum += p;
  }
  for (float& p : result) p = sum > 0.0F ? p / sum : 1.0F / static_cast<float>(num_classes);
  return result;
}

ChannelImage MostLikelyChannels(const ProbabilityVolume& volume, const std::string& source) {
  const auto plane = static_cast<size_t>(volume.rows) * static_cast<size_t>(volume.cols);
  std::vector<float> best(plane, -1.0F);
  std::vector<float> sums(plane, 0.0F);
  ChannelImage result = ChannelImage::Zero(volume.rows, volume.cols);
  const auto fail = [&](size_t pixel, const std::string& what) {
    const auto cols = static_cast<size_t>(volume.cols);
    ThrowInputError("{}: pixel ({}, {}): {}", source, pixel % cols, pixel / cols, what);
  };
  const char* data = volume.bytes.data() + volume.offset;
  for (int c = 0; c < volume.channels; ++c) {
    const size_t base = static_cast<size_t>(c) * plane;
    for (size_t i = 0; i < plane; ++i) {
      const float p = Value(volume.type, data, base + i);
      if (!(p >= 0.0F)) fail(i, fmt::format("probability {} of channel {}", p, c));
      sums[i] += p;
      if (p <= best[i]) continue;
      best[i] = p;
      result.data()[i] = c;
    }
  }
  const float tolerance = SumTolerance(volume);
  for (size_t i = 0; i < plane; ++i) {
    if (!(std::abs(sums[i] - 1.0F) <= tolerance)) {
      fail(i, fmt::format("probabilities sum to {}, not to one", sums[i]));
    }
  }
  return result;
}

}  // namespace s3lam
