// Sums of rows; built once per instruction set.
#pragma once

#ifndef HQP_ISA
#define HQP_ISA generic
#endif

namespace hqp {
inline namespace HQP_ISA {

static inline void scale(double* a, int size, double factor) {
  for (int k = 0; k < size; ++k) a[k] *= factor;
}

static inline void subtract(double* __restrict a, double factor, const double* __restrict b, int size) {
  for (int k = 0; k < size; ++k) a[k] -= factor * b[k];
}

// a += sign * sum of f[r * step] b[r], count rows b of a width, four at a time: a is then read and written less.
static inline void add_rows(double* __restrict a, double sign, const double* f, int step, const double* __restrict b,
                            int width, int count, int size) {
  int r = 0;
  for (; r + 4 <= count; r += 4) {
    const double f0 = sign * f[r * step], f1 = sign * f[(r + 1) * step];
    const double f2 = sign * f[(r + 2) * step], f3 = sign * f[(r + 3) * step];
    if (f0 == 0.0 && f1 == 0.0 && f2 == 0.0 && f3 == 0.0) continue;  // joints of another branch
    const double *b0 = b + r * width, *b1 = b0 + width, *b2 = b1 + width, *b3 = b2 + width;
    for (int k = 0; k < size; ++k) a[k] += (f0 * b0[k] + f1 * b1[k]) + (f2 * b2[k] + f3 * b3[k]);
  }
  for (; r < count; ++r) subtract(a, -sign * f[r * step], b + r * width, size);
}

}  // namespace HQP_ISA
}  // namespace hqp
