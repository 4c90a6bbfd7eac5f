#pragma once

#include <concepts>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

namespace s3lam {

/// Values as bytes and back, for states that only the same program reads again (StepStore): not a
/// file format. Both archives take the same things in the same order:
///   numbers, enumerations and bare bytes; strings; vectors; Eigen's matrices of fixed size and
///   quaternions; classes with a member `template <typename A> void Transfer(A& archive)` that
///   hands over its own members.

namespace internal {

/// Eigen's objects of fixed size are their coefficients.
template <typename T>
concept FixedCoefficients = requires(T value) {
  value.coeffs().data();
}
|| requires(T value) {
  value.data();
  requires T::SizeAtCompileTime >
  0;
};

template <FixedCoefficients T>
auto* Coefficients(T& value) {
  if constexpr (requires { value.coeffs(); }) {
    return value.coeffs().data();
  } else {
    return value.data();
  }
}

}  // namespace internal

class ArchiveWriter {
 public:
  static constexpr bool kReads = false;

  template <typename... T>
  void operator()(const T&... values) {
    (Put(values), ...);
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  void Raw(const void* data, size_t size) { bytes_.append(static_cast<const char*>(data), size); }

  template <typename T>
  void Put(const T& value) {
    if constexpr (internal::FixedCoefficients<const T>) {
      Raw(internal::Coefficients(value), sizeof(T));
    } else if constexpr (std::is_trivially_copyable_v<T>) {
      Raw(&value, sizeof(T));
    } else {
      const_cast<T&>(value).Transfer(*this);  // Which only reads its members here.
    }
  }
  void Put(const std::string& text) {
    Put<uint64_t>(text.size());
    Raw(text.data(), text.size());
  }
  template <typename T>
  void Put(const std::vector<T>& values) {
    Put<uint64_t>(values.size());
    if constexpr (std::is_trivially_copyable_v<T>) {
      Raw(values.data(), values.size() * sizeof(T));
    } else {
      for (const T& value : values) Put(value);
    }
  }

  std::string bytes_;
};

/// Throws std::runtime_error where the bytes end too early.
class ArchiveReader {
 public:
  static constexpr bool kReads = true;

  explicit ArchiveReader(std::string_view bytes) : bytes_(bytes) {}

  template <typename... T>
  void operator()(T&... values) {
    (Get(values), ...);
  }
  [[nodiscard]] bool AtEnd() const { return bytes_.empty(); }

 private:
  void Raw(void* data, size_t size) {
    if (size > bytes_.size()) throw std::runtime_error("a saved state is cut short");
    if (size > 0) std::memcpy(data, bytes_.data(), size);
    bytes_.remove_prefix(size);
  }
  /// Of things of at least a byte each.
  size_t Count() {
    uint64_t count = 0;
    Get(count);
    if (count > bytes_.size()) throw std::runtime_error("a saved state is cut short");
    return count;
  }

  template <typename T>
  void Get(T& value) {
    if constexpr (internal::FixedCoefficients<T>) {
      Raw(internal::Coefficients(value), sizeof(T));
    } else if constexpr (std::is_trivially_copyable_v<T>) {
      Raw(&value, sizeof(T));
    } else {
      value.Transfer(*this);
    }
  }
  void Get(std::string& text) {
    text.resize(Count());
    Raw(text.data(), text.size());
  }
  template <typename T>
  void Get(std::vector<T>& values) {
    values.resize(Count());
    if constexpr (std::is_trivially_copyable_v<T>) {
      Raw(values.data(), values.size() * sizeof(T));
    } else {
      for (T& value : values) Get(value);
    }
  }

  std::string_view bytes_;
};

}  // namespace s3lam
