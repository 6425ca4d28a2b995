// The problem in which a working set's rows are equalities: factorised, or updated where few changes are known.
#pragma once

#include "updates.hpp"
#include "working_set.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct EqualityProblem {
  Table table;
  Tableau tableau;  // tableau.x is the solution
  Levels levels{tableau};
  Updates updates{tableau, levels};
  WorkingSet set;
  double* values = nullptr;  // (rows,) A tableau.x
  bool updating = true;      // false: every working set is factorised
  int progress = -1;         // first level that the last step changed
  int factorisations = 0;

  EqualityProblem() = default;
  EqualityProblem(const EqualityProblem&) = delete;  // `levels` and `updates` refer to `tableau`

  void layout(Arena& arena, int n, int rows, int blocks, const int* m) {
    tableau.layout(arena, n, blocks, m);
    set.layout(arena, n, rows);
    arena.place(values, rows);
  }

  void start() {
    table.start();
    tableau.table = &table;
  }

  void solve() {
    if (!update()) factorise();
    set.changes.forget();
    table.product(tableau.x, values);
  }

  void factorise() {
    levels.factorise(set.W, set.F);
    ++factorisations;
  }

 private:
  // Without a factorisation, where the changes are known: a leaving row leaves in front of the level that requested it;
  // a joining row joins in front of the level that ended the tableau, or else of the one that the last step aimed at.
  bool update() {
    const Changes& changes = set.changes;
    if (!updating || !changes.known) return false;
    if (changes.front >= 0) return updates.rewind(changes.front) && leave_all() && join_all();
    if (changes.joined == 0) return false;
    const int last = tableau.gram_level, before = tableau.newcomers;
    if (last >= 0 && updates.rewind(last) && join_all()) return true;
    tableau.newcomers = before;
    if (changes.joined > 1 || progress == last || !updates.rewind(progress)) return false;
    return join_all();
  }

  bool join_all() {
    for (int q = 0; q < set.changes.joined; ++q) {
      const int what = set.changes.join[q], i = what - table.rows;
      const bool upper = set.changes.side[q] > 0;
      if (i < 0 ? !updates.meet(what, upper ? table.upper[what] : table.lower[what])
                : !updates.hold(i, upper ? table.hi[i] : table.lo[i]))
        return false;
    }
    updates.resume(set.W);
    return true;
  }

  bool leave_all() {
    for (int q = 0; q < set.changes.left; ++q)
      if (!updates.let_go(set.changes.leave[q])) return false;
    return true;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
