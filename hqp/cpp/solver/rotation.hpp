// One-sided Jacobi: the rotation after which two rows are orthogonal.
#pragma once

#include <cmath>

#include "dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Rotation {
  double c, s;

  // aa, bb, ab: the products a'a, b'b and a'b of rows a and b.
  Rotation(double aa, double bb, double ab) {
    const double zeta = (bb - aa) / (2.0 * ab);
    const double t = (zeta < 0.0 ? -1.0 : 1.0) / (std::fabs(zeta) + std::sqrt(1.0 + zeta * zeta));
    c = 1.0 / std::sqrt(1.0 + t * t);
    s = c * t;
  }

  void turn(double* a, double* b, int n) const {
    for (int i = 0; i < n; ++i) {
      const double p = a[i], q = b[i];
      a[i] = c * p - s * q;
      b[i] = s * p + c * q;
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
