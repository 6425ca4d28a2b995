// A root of a positive semidefinite matrix, for the metric that chooses among optima.
#pragma once

#include <cmath>

#include "dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

// Pivoted Cholesky: metric (n, n) = rows' rows, stopped at 1e-10 of the largest entry; the number of rows (n, n), -1 if
// the metric is not finite.  left (n): to work in, negative for a variable that is a pivot.  pivots (n): the variable
// of each row's pivot, which the rows below it do not have; or null.
static inline int metric_root(const double* metric, int n, double* rows, double* left, int* pivots = nullptr) {
  double largest = 0.0;
  for (int i = 0; i < n; ++i) {  // left: remainder of the diagonal, -1 for a pivot
    const double* row = metric + static_cast<std::ptrdiff_t>(i) * n;
    double zero = 0.0;
    for (int j = 0; j < n; ++j) zero += 0.0 * row[j];
    if (zero != 0.0) return -1;  // 0 times a value that is not finite
    left[i] = row[i];
    largest = larger(largest, row[i]);
  }
  int rank = 0;
  for (; rank < n; ++rank) {
    int p = 0;
    for (int i = 1; i < n; ++i)
      if (left[i] > left[p]) p = i;
    if (!(left[p] > kDirection * largest)) break;
    double* row = rows + static_cast<std::ptrdiff_t>(rank) * n;
    const double* given = metric + static_cast<std::ptrdiff_t>(p) * n;
    for (int j = 0; j < n; ++j) row[j] = 0.5 * (given[j] + metric[static_cast<std::ptrdiff_t>(j) * n + p]);
    add_rows(row, rows, n, rank, -1.0, rows + p, n, n);
    const double d = 1.0 / std::sqrt(row[p]);
    for (int j = 0; j < n; ++j) {
      row[j] = left[j] < 0.0 ? 0.0 : row[j] * d;
      if (left[j] >= 0.0) left[j] = larger(left[j] - row[j] * row[j], 0.0);
    }
    left[p] = -1.0;
    if (pivots) pivots[rank] = p;
  }
  return rank;
}

}  // namespace HQP_ISA
}  // namespace hqp
