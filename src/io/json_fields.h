#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>

#include "s3lam/base/error.h"
#include "s3lam/base/id.h"

namespace s3lam {

/// Typed access to the fields of a JSON object. Everything throws InputError with `where` (a file
/// and a place in it) and the field's name.
class JsonFields {
 public:
  JsonFields(const nlohmann::json& object, std::string where)
      : object_(object), where_(std::move(where)) {
    if (!object.is_object()) ThrowInputError("{}: expected an object", where_);
  }

  [[nodiscard]] const std::string& where() const { return where_; }
  [[nodiscard]] bool Has(const char* key) const { return object_.contains(key); }

  [[nodiscard]] const nlohmann::json& At(const char* key) const {
    const auto it = object_.find(key);
    if (it == object_.end()) ThrowInputError("{}: '{}' is missing", where_, key);
    return *it;
  }

  [[nodiscard]] const nlohmann::json& List(const char* key) const {
    const nlohmann::json& list = At(key);
    if (!list.is_array()) ThrowInputError("{}: '{}' is not a list", where_, key);
    return list;
  }

  [[nodiscard]] std::string String(const char* key) const {
    const nlohmann::json& value = At(key);
    if (!value.is_string()) ThrowInputError("{}: '{}' is not a text", where_, key);
    return value.get<std::string>();
  }

  [[nodiscard]] bool Bool(const char* key) const {
    const nlohmann::json& value = At(key);
    if (!value.is_boolean()) ThrowInputError("{}: '{}' is not true or false", where_, key);
    return value.get<bool>();
  }

  [[nodiscard]] double Number(const char* key) const { return AsNumber(At(key), key); }

  template <typename Integer = int>
  [[nodiscard]] Integer Int(const char* key) const {
    return AsInteger<Integer>(At(key), key);
  }

  /// A list of exactly `Rows` numbers.
  template <int Rows>
  [[nodiscard]] Eigen::Matrix<double, Rows, 1> Vector(const char* key) const {
    return AsVector<Rows>(List(key), key);
  }

  template <int Rows>
  [[nodiscard]] Eigen::Matrix<double, Rows, 1> AsVector(const nlohmann::json& list,
                                                        const char* key) const {
    if (!list.is_array() || list.size() != Rows) {
      ThrowInputError("{}: '{}' needs {} numbers", where_, key, Rows);
    }
    Eigen::Matrix<double, Rows, 1> vector;
    for (int i = 0; i < Rows; ++i) vector[i] = AsNumber(list[static_cast<size_t>(i)], key);
    return vector;
  }

  [[nodiscard]] double AsNumber(const nlohmann::json& value, const char* key) const {
    const double number = value.is_number() ? value.get<double>() : std::nan("");
    if (!std::isfinite(number)) ThrowInputError("{}: '{}' is not a finite number", where_, key);
    return number;
  }

  template <typename Integer>
  [[nodiscard]] Integer AsInteger(const nlohmann::json& value, const char* key) const {
    using Limits = std::numeric_limits<Integer>;
    bool fits = false;
    if (value.is_number_unsigned()) {
      fits = value.get<uint64_t>() <= static_cast<uint64_t>(Limits::max());
    } else if (value.is_number_integer()) {  // Negative.
      fits = std::is_signed_v<Integer> &&
             value.get<int64_t>() >= static_cast<int64_t>(Limits::lowest());
    }
    if (!fits) ThrowInputError("{}: '{}' is not an integer in range", where_, key);
    return value.get<Integer>();
  }

 private:
  const nlohmann::json& object_;
  std::string where_;
};

}  // namespace s3lam
