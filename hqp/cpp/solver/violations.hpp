// Violated rows and variables outside a working set at the solution of its equalities.
#pragma once

#include "equality_problem.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Violations {
  std::int8_t* row = nullptr;       // (rows,) the side that is violated, kFree if none is
  std::int8_t* variable = nullptr;  // (n,)
  bool overlooked = false;          // a bound is exceeded within the rounding of rows that reach far beyond x

  void layout(Arena& arena, int n, int rows) {
    arena.place(row, rows);
    arena.place(variable, n);
  }

  // Their number.
  int find(const EqualityProblem& problem) {
    const Table& table = problem.table;
    const WorkingSet& set = problem.set;
    const double* x = problem.tableau.x;
    const double size = table.span(x), near = table.largest(x);
    overlooked = near < size && exceeded(problem, near);
    int number = 0;
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      row[r] = kFree;
      if (set.W[r]) continue;
      const double value = problem.values[r];
      if (table.is_over(r, value - table.upper[r], table.upper[r], size, x)) row[r] = kUpper;
      else if (table.is_over(r, table.lower[r] - value, table.lower[r], size, x)) row[r] = kLower;
      number += row[r] != kFree;
    }
    const double tolerance = table.tolerance;
    for (int i = 0; i < table.n; ++i) {
      variable[i] = kFree;
      if (set.F[i]) continue;
      const double lo = table.lo[i], hi = table.hi[i];
      if (x[i] > hi && x[i] > hi + tolerance * (std::fabs(hi) + size)) variable[i] = kUpper;
      else if (x[i] < lo && x[i] < lo - tolerance * (std::fabs(lo) + size)) variable[i] = kLower;
      number += variable[i] != kFree;
    }
    return number;
  }

 private:
  // Return true if a row or variable outside the working set exceeds a bound, with `size` as the size of x.
  static bool exceeded(const EqualityProblem& problem, double size) {
    const Table& table = problem.table;
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      const double out = table.beyond(r, problem.values[r]), bound = out > 0.0 ? table.upper[r] : table.lower[r];
      if (!problem.set.W[r] && std::fabs(out) > table.slackness(r, bound, size)) return true;
    }
    for (int i = 0; i < table.n; ++i) {
      const double x = problem.tableau.x[i], bound = table.inside_box(i, x);
      if (!problem.set.F[i] && std::fabs(x - bound) > table.tolerance * (std::fabs(bound) + size)) return true;
    }
    return false;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
