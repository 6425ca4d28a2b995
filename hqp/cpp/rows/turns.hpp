// Derivatives of a rotation vector. See tasks/turns.py.
#pragma once

#include <cmath>

#include "../dynamics/spatial.hpp"

namespace hqp {

// Change of a rotation vector: its rate is B omega.
class RotationVector {
 public:
  explicit RotationVector(const Vec3& turn) : turn_(turn) {
    const double square = dot(turn, turn), t = std::sqrt(square);
    if (t < 0.1) {
      b_ = 1.0 / 12.0 + square / 720.0 + square * square / 30240.0;
      slope_ = 1.0 / 360.0 + square / 7560.0;
      return;
    }
    const double cot = 1.0 / std::tan(0.5 * t), sine = std::sin(0.5 * t);
    b_ = (1.0 - 0.5 * t * cot) / square;
    slope_ = (-2.0 / (t * square) + cot / (2.0 * square) + 1.0 / (4.0 * t * sine * sine)) / t;
  }
  Vec3 rate(const Vec3& omega) const {  // B omega
    const Vec3 across = cross(turn_, omega);
    return omega - 0.5 * across + b_ * cross(turn_, across);
  }
  Vec3 change(const Vec3& r, const Vec3& omega) const {  // dB/dt omega where the vector changes at r
    const Vec3 across = cross(turn_, omega);
    return slope_ * dot(turn_, r) * cross(turn_, across) - 0.5 * cross(r, omega) +
           b_ * (cross(r, across) + cross(turn_, cross(r, omega)));
  }

 private:
  Vec3 turn_;
  double b_ = 0.0, slope_ = 0.0;
};

}  // namespace hqp
