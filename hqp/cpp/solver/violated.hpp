// The amount by which a constraint may be off before it counts as violated.
#pragma once

#include <cmath>
#include <cstddef>

#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

// Return true if row i of a level, w off its bounds at x (n), is violated; allowed: by how much it may be off besides.
template <class Level>
inline bool violated(const Level& level, int i, double w, double allowed, const double* x, int n) {
  const double bound = w > 0.0 ? level.upper[i] : level.lower[i];
  const double rest = std::fabs(w) - kViolated * (1.0 + std::fabs(bound)) - allowed;
  if (!(rest > 0.0)) return false;
  double length = 0.0, size = 0.0;
  for (int j = 0; j < n; ++j) {
    const double a = level.A               ? level.A[static_cast<std::ptrdiff_t>(i) * n + j]
                     : level.index[i] == j ? level.scale[i]
                                           : 0.0;
    length += a * a;
    size += x[j] * x[j];
  }
  return rest > kMet * std::sqrt(length * size);
}

}  // namespace HQP_ISA
}  // namespace hqp
