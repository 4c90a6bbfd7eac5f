#include "street_line.h"

#include <cmath>
#include <numbers>

#include "s3lam/base/rng.h"

namespace s3lam::synthetic {
namespace {

Eigen::Vector2d Unit(double heading) { return {std::cos(heading), std::sin(heading)}; }

}  // namespace

StreetLine::StreetLine(uint64_t seed) {
  constexpr double kRadius = 12.0;
  Rng rng(seed);
  const double quarter = 0.5 * std::numbers::pi * kRadius;
  const double first = rng.Below(2) == 0 ? 1.0 : -1.0;  // Left or right.
  const double lengths[] = {rng.Uniform(32.0, 44.0), quarter * rng.Uniform(0.8, 1.0),
                            rng.Uniform(30.0, 40.0), quarter * rng.Uniform(0.75, 0.95),
                            rng.Uniform(24.0, 32.0)};
  const double curvatures[] = {0.0, first / kRadius, 0.0, -first / kRadius, 0.0};
  Piece piece{0.0, 0.0, 0.0, Eigen::Vector2d::Zero(),
              rng.Uniform(-std::numbers::pi, std::numbers::pi)};
  for (int i = 0; i < 5; ++i) {
    piece.length = lengths[i];
    piece.curvature = curvatures[i];
    pieces_.push_back(piece);
    const Eigen::Vector3d next = At(piece.begin + piece.length, 0.0, 0.0);
    piece.heading += piece.curvature * piece.length;
    piece.start = next.head<2>();
    piece.begin += piece.length;
  }
  drive_length_ = piece.begin;
  for (int k = 0; k < 4; ++k) phases_[k] = rng.Uniform(0.0, 2.0 * std::numbers::pi);
}

const StreetLine::Piece& StreetLine::PieceAt(double s) const {
  size_t i = 0;
  while (i + 1 < pieces_.size() && s > pieces_[i].begin + pieces_[i].length) ++i;
  return pieces_[i];
}

bool StreetLine::IsTurn(double s) const { return PieceAt(s).curvature != 0.0; }

double StreetLine::Heading(double s) const {
  const Piece& piece = PieceAt(s);
  return piece.heading + piece.curvature * (s - piece.begin);
}

double StreetLine::Ground(double x, double y) const {
  // A few centimetres over tens of metres: what a flat residential street has.
  return 0.035 * std::sin(x / 9.0 + phases_[0]) + 0.03 * std::sin(y / 11.0 + phases_[1]) +
         0.01 * std::sin((x + y) / 4.0 + phases_[2]);
}

Eigen::Vector3d StreetLine::At(double s, double side, double up) const {
  const Piece& piece = PieceAt(s);
  const double along = s - piece.begin;
  const double heading = piece.heading + piece.curvature * along;
  Eigen::Vector2d point = piece.start + along * Unit(piece.heading);
  if (piece.curvature != 0.0) {
    const Eigen::Vector2d left(-std::sin(piece.heading), std::cos(piece.heading));
    const Eigen::Vector2d left_now(-std::sin(heading), std::cos(heading));
    point = piece.start + (left - left_now) / piece.curvature;
  }
  point += side * Eigen::Vector2d(-std::sin(heading), std::cos(heading));
  return {point.x(), point.y(), Ground(point.x(), point.y()) + up};
}

}  // namespace s3lam::synthetic
