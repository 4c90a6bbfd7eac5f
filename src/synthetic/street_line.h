#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

namespace s3lam::synthetic {

/// Centre line of a street: straights and arcs by arc length, on gently undulating ground.
class StreetLine {
 public:
  explicit StreetLine(uint64_t seed);

  /// The street reaches from begin() (before the drive's start at 0) to end() (beyond its end).
  [[nodiscard]] double begin() const { return -14.0; }
  [[nodiscard]] double end() const { return drive_length_ + 45.0; }
  [[nodiscard]] double drive_length() const { return drive_length_; }

  /// The point `side` metres to the left of the line at arc length s, `up` metres above the ground.
  [[nodiscard]] Eigen::Vector3d At(double s, double side, double up) const;
  /// Direction of the street at s, from the x axis [rad].
  [[nodiscard]] double Heading(double s) const;
  [[nodiscard]] bool IsTurn(double s) const;

 private:
  struct Piece {
    double begin, length, curvature;
    Eigen::Vector2d start;
    double heading;
  };
  [[nodiscard]] const Piece& PieceAt(double s) const;
  [[nodiscard]] double Ground(double x, double y) const;

  std::vector<Piece> pieces_;
  double drive_length_ = 0.0;
  Eigen::Vector4d phases_;
};

}  // namespace s3lam::synthetic
