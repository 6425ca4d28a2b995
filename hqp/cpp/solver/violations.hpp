// Violated rows and variables outside a working set at the solution of its equalities.
#pragma once

#include "equality_problem.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Violations {
  std::int8_t* row = nullptr;       // (rows,) the side that is violated, kFree if none is
  std::int8_t* variable = nullptr;  // (n,)
  bool overlooked = false;          // a bound is exceeded by more than rounding of its row

  void layout(Arena& arena, int n, int rows) {
    arena.place(row, rows);
    arena.place(variable, n);
  }

  // Their number.
  int find(const EqualityProblem& problem) {
    const Table& table = problem.table;
    const WorkingSet& set = problem.set;
    const double* x = problem.tableau.x;
    const double size = table.span(x);
    overlooked = false;
    int number = 0;
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      row[r] = kFree;
      if (set.W[r]) continue;
      const double over = problem.values[r] - table.upper[r], under = table.lower[r] - problem.values[r];
      if (table.is_over(r, over, table.upper[r], size, x)) row[r] = kUpper;
      else if (table.is_over(r, under, table.lower[r], size, x)) row[r] = kLower;
      else if (over > 0.0 || under > 0.0)
        overlooked = overlooked || larger(over, under) > kOnRow * (table.norm[r] + table.terms(r, x));
      number += row[r] != kFree;
    }
    const double tolerance = table.tolerance;
    for (int i = 0; i < table.n; ++i) {
      variable[i] = kFree;
      if (set.F[i]) continue;
      const double lo = table.lo[i], hi = table.hi[i];
      if (x[i] > hi && x[i] > hi + tolerance * (std::fabs(hi) + size)) variable[i] = kUpper;
      else if (x[i] < lo && x[i] < lo - tolerance * (std::fabs(lo) + size)) variable[i] = kLower;
      else if (x[i] > hi || x[i] < lo)
        overlooked = overlooked || larger(x[i] - hi, lo - x[i]) > kOnRow * (1.0 + std::fabs(x[i]));
      number += variable[i] != kFree;
    }
    return number;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
