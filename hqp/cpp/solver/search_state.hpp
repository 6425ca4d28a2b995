// Shared state of the phases of a search: the present equality problem, its multipliers and violations, and the point.
#pragma once

#include "deadline.hpp"
#include "multipliers.hpp"
#include "violations.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Point {
  double* x = nullptr;   // (n,) in the box
  double* v = nullptr;   // (rows,) A x
  bool current = false;  // v is up to date

  void layout(Arena& arena, int n, int rows) {
    arena.place(x, n);
    arena.place(v, rows);
  }
};

struct SearchState {
  static constexpr double kTurns = 2.0;  // one more turn like the last, and the remaining work after it

  EqualityProblem problem;
  Multipliers multipliers;
  Violations violations;
  Point point;
  Deadline* deadline = nullptr;
  const Options* options = nullptr;
  int iterations = 0, cap = 0;
  Outcome outcome = Outcome::optimal;

  // blocks, m: sizes of the table, including the blocks that complete the problem.
  void layout(Arena& arena, int n, int rows, int most, int blocks, const int* m) {
    problem.layout(arena, n, rows, blocks, m);
    multipliers.layout(arena, n, rows, most);
    violations.layout(arena, n, rows);
    point.layout(arena, n, rows);
  }

  void wire() {
    problem.start();
    multipliers.table = &problem.table;
    multipliers.tableau = &problem.tableau;
  }

  void start(const Options& given, bool warm) {
    Table& table = problem.table;
    options = &given;
    table.tolerance = given.feasibility_tolerance;
    problem.tableau.rank_tolerance = given.rank_tolerance;
    multipliers.tolerance = given.multiplier_tolerance;
    problem.factorisations = iterations = 0;
    outcome = Outcome::optimal;
    cap = given.max_iterations > 0 ? given.max_iterations : 100 + 10 * (table.rows + table.n);
    problem.levels.choose_bias();
    problem.tableau.recording = false;
    problem.set.start(table, warm);
  }

  void solve() {
    problem.solve();
    ++iterations;
  }

  // To the point of the box next to the equality problem's solution.
  void go_to_solution() {
    const Table& table = problem.table;
    for (int i = 0; i < table.n; ++i) point.x[i] = table.inside_box(i, problem.tableau.x[i]);
  }

  void accept() {
    go_to_solution();
    if (problem.tableau.closest < kEither * kEither) outcome = Outcome::rank_uncertain;
  }

  // Return true if the solution may depend on rounding or on a rank decision.
  bool doubtful() const {
    const Tableau& tableau = problem.tableau;
    return tableau.closest < kClear || tableau.growth * kUncertain > 1.0 || multipliers.doubted ||
           violations.overlooked || problem.table.uneven;
  }

  // A x; the equality problem's own where x is its solution to the bit.
  const double* values() {
    for (int i = 0; i < problem.table.n; ++i)
      if (point.x[i] != problem.tableau.x[i]) {
        problem.table.product(point.x, point.v);
        return point.v;
      }
    return problem.values;
  }

  bool out_of_time() {
    if (iterations >= cap) outcome = Outcome::iteration_limit;
    else if (deadline->too_near(kTurns)) outcome = Outcome::time_limit;
    else return false;
    return true;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
