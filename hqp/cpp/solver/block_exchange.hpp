// The first phase of a search: everything that is violated joins, everything of a wrong sign leaves, at once.
#pragma once

#include <utility>

#include "order.hpp"
#include "search_state.hpp"

namespace hqp {
inline namespace HQP_ISA {

// The lexicographically best point of the exchanges, and its working set: start of the descent.
struct Start {
  WorkingSet set;
  double* x = nullptr;      // (n,)
  double* slack = nullptr;  // (blocks,) norms of the slacks of the levels
  bool current = false;     // the equality problem and its multipliers are still those of this set

  void layout(Arena& arena, int n, int rows, int blocks) {
    set.layout(arena, n, rows);
    arena.place(x, n);
    arena.place(slack, blocks);
  }

  // Set another point and keep the working set.
  void set_to(SearchState& state, const double* from) {
    const Table& table = state.problem.table;
    for (int i = 0; i < table.n; ++i) x[i] = table.inside_box(i, from[i]);
    table.product(x, state.point.v);
    for (int k = 0; k + 1 < table.blocks; ++k) slack[k] = table.outside(k, state.point.v);
    set.restore(table, state.problem.set);
    current = false;
  }

  // The state's point, if it is the best so far.
  void offer(SearchState& state, int outside) {
    const EqualityProblem& problem = state.problem;
    const Table& table = problem.table;
    state.go_to_solution();
    table.product(state.point.x, state.point.v);
    current = false;
    const auto now = [&](int k) { return table.outside(k, state.point.v); };
    const auto best = [&](int k) { return slack[k]; };
    if (lexicographic_order(table.blocks - 1, now, best) >= 0) return;
    for (int k = 0; k + 1 < table.blocks; ++k) slack[k] = now(k);
    current = outside == 0 && state.iterations == 1;
    set.restore(table, problem.set);
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      if (state.violations.row[r]) set.W[r] = state.violations.row[r];
    }
    for (int i = 0; i < table.n; ++i) {
      if (state.violations.variable[i]) set.F[i] = state.violations.variable[i];
      x[i] = state.point.x[i];
    }
  }
};

class BlockExchange {
 public:
  Start start;

  explicit BlockExchange(SearchState& state) : state_(state) {}

  // True if that ends the search: at the optimum, or out of time at the best point.  last: the answer before.
  bool run(const double* last) {
    EqualityProblem& problem = state_.problem;
    const Table& table = problem.table;
    const Multipliers& multipliers = state_.multipliers;
    int exchanges_left = state_.options->exchanges, fewest = 1 << 30;
    bool known = false;  // the best point so far, which costs a product with the rows
    for (;;) {
      state_.solve();
      const int outside = state_.violations.find(problem);
      state_.multipliers.judge(problem.set.W, problem.set.F, problem.values);
      const int infeasibilities = outside + multipliers.count;
      if (infeasibilities == 0) {
        if (problem.tableau.has_released && state_.doubtful()) {
          problem.set.changes.forget();  // judged on a tableau of its own
          continue;
        }
        state_.accept();
        return true;
      }
      if (!std::exchange(known, true)) start.set_to(state_, last);
      start.offer(state_, outside);
      if (start.current) return false;  // a descent keeps it feasible, an exchange would not
      if (infeasibilities < fewest) fewest = infeasibilities;
      else if (--exchanges_left < 0 || infeasibilities > 2 * fewest) return false;
      if (state_.iterations > 1 && state_.out_of_time()) {
        for (int i = 0; i < table.n; ++i) state_.point.x[i] = start.x[i];
        return true;
      }
      exchange();
    }
  }

 private:
  SearchState& state_;

  void exchange() {
    WorkingSet& set = state_.problem.set;
    const Table& table = state_.problem.table;
    const Multipliers& multipliers = state_.multipliers;
    set.changes.start(multipliers.count ? multipliers.highest() : -1);
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      if (state_.violations.row[r]) set.join(r, state_.violations.row[r]);
    }
    for (int i = 0; i < table.n; ++i)
      if (state_.violations.variable[i]) set.hold(table, i, state_.violations.variable[i]);
    for (int q = 0; q < multipliers.count; ++q) set.release(table, multipliers.to_release[q]);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
