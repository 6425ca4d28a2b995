// Checks of given numbers: finite, a rotation or a pose.
#pragma once

#include <cmath>
#include <limits>

#include "../dynamics/spatial.hpp"

namespace hqp {

inline double squared(const double* a, int size) {
  double sum = 0.0;
  for (int i = 0; i < size; ++i) sum += a[i] * a[i];
  return sum;
}
inline bool finite(const double* a, int size) { return squared(a, size) < std::numeric_limits<double>::infinity(); }

constexpr double kOrthonormal = 1e-5;  // ORTHONORMAL of tasks/rotations.py

// Return true if the leading 3 by 3 of rows of that width is a rotation; false for values that are not finite.
inline bool rotation(const double* A, int width, double tolerance = kOrthonormal) {
  const Vec3 x = load(A), y = load(A + width), z = load(A + 2 * width);
  const double off[] = {dot(x, x) - 1.0, dot(y, y) - 1.0, dot(z, z) - 1.0, dot(x, y), dot(x, z), dot(y, z)};
  for (const double error : off)
    if (!(std::fabs(error) <= tolerance)) return false;
  return dot(x, cross(y, z)) > 0.0;
}

// Return true if 4 by 4 numbers are a homogeneous matrix with a rotation.
inline bool pose(const double* A, double tolerance = kOrthonormal) {
  const double* last = A + 12;
  return last[0] == 0.0 && last[1] == 0.0 && last[2] == 0.0 && last[3] == 1.0 && finite(A, 12) &&
         rotation(A, 4, tolerance);
}

}  // namespace hqp
