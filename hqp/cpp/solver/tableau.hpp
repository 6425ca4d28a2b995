// The tableau x_basic = c - G x_rest and the result of each level. levels.hpp solves it, updates.hpp changes it.
#pragma once

#include "changes.hpp"
#include "table.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

// Result of one level: its rows, its orthogonal factor, its triangle, and the tableau's pivot columns.
struct Stage {
  enum Kind { kIdle, kReflectors, kGram } kind;
  int m, rank, before;  // rows that took part, pivots, basic variables of the levels above
  int* rows;            // (m,) of the table
  double* V;            // reflector i in V + i * ldv, entries i..m-1
  double* tau;
  double* R;       // (rank, rank), row stride ldr
  double* pivots;  // (before, rank) pivot columns of the tableau when the level was reached
  int* variables;  // (rank,)
  int ldv, ldr;
  double residual;  // norm of the unreachable part

  // y := Q_i y with reflector i.
  void reflect(int i, double* y) const {
    const double* v = V + static_cast<std::ptrdiff_t>(i) * ldv;
    const double f = tau[i] * dot_any(v + i, y + i, m - i);
    add_any(y + i, v + i, -f, m - i);
  }
};

// A constraint joined after the factorisation: the reduced row's pivot, and the tableau's column at that moment.
struct Extra {
  int row, variable;   // row of the table, or the variable it holds; the other is -1
  int pivot, before;   // variable that became basic, basic variables then
  int level;           // in front of which it stands
  double coefficient;  // coefficient of the pivot in the reduced row
  double* column;      // (before,)
  double lambda;       // its multiplier in the present sweep
};

// A row that was met, or a variable that was held, since the factorisation.
struct Newcomer {
  int row, variable;  // the other is -1
  double value;
};

// The tableau as it was when a level was reached.
struct Snapshot {
  double* G;
  int* free;
  int basic, rest, extras, newcomers;
  bool valid;
};

struct Tableau {
  const Table* table = nullptr;
  int n = 0, ld = 0, basic = 0, rest = 0;
  double* G = nullptr;           // (n, ld): column 0 is c, then the coefficients of the variables in `free`
  int* base = nullptr;           // (basic,) variables
  int* free = nullptr;           // (rest,) variables
  double* T = nullptr;           // (most rows of a level, ld)
  double* L = nullptr;           // (most rows of a level, ld)
  double* H = nullptr;           // (n + 1 padded, ld)
  double* weight = nullptr;      // (ld,) bias of a column
  double* size = nullptr;        // (ld,) biased squared norms
  double* diagonal = nullptr;    // (ld,)
  double* target = nullptr;      // (ld,)
  double* x = nullptr;           // (n,) the solution
  double* fixed_x = nullptr;     // (n,) values of the fixed variables, zero elsewhere
  int* place = nullptr;          // (n,) position: >= 0 in free, -1 - i in base, kNowhere fixed
  int* keep = nullptr;           // (n,) where columns that stay come from
  int* hole = nullptr;           // (n,) where they go
  double* preference = nullptr;  // (n,) weight of a variable among the pivots
  Stage* stage = nullptr;
  Snapshot* snapshot = nullptr;
  bool recording = false;  // keep snapshots, for changes in front of any level
  Extra* extra = nullptr;
  int extras = 0;
  Newcomer* newcomer = nullptr;
  int newcomers = 0;
  bool has_released = false;    // variables left since the factorisation
  double* direction = nullptr;  // (n,)
  int gram_level = -1;          // the level that ended the tableau by a normal matrix, -1 if none did
  double growth = 1.0;          // bound on the tableau's magnification of rounding
  double cut = 0.0;             // length of the direction that ended the latest level, 0 where none did
  bool trusting = false;        // directions count that `growth` casts doubt on,
  bool cut_by_growth = false;   // and were left out because of it
  double closest = kInfinity;   // nearest a pivot came to the rank tolerance, as a ratio >= 1
  bool any_fixed = false;
  int gram_free = 0;
  double rank_tolerance = 0.0;
  double least = 0.0;                       // smallest entry of `diagonal`
  static constexpr int kNowhere = 1 << 30;  // no place

  void layout(Arena& arena, int n_, int blocks, const int* m) {
    n = n_;
    ld = padded(n + 1);
    int most = n;
    for (int k = 0; k < blocks; ++k) most = m[k] > most ? m[k] : most;
    const std::size_t wide = static_cast<std::size_t>(ld);
    arena.place(G, (n + 4) * wide);
    arena.place(T, (most + 4) * wide);
    arena.place(L, (most + 4) * wide);
    arena.place(H, (n + 8) * wide);
    arena.place(base, n);
    arena.place(free, n);
    arena.place(weight, ld);
    arena.place(size, ld);
    arena.place(diagonal, ld);
    arena.place(target, most + ld);
    arena.place(x, ld);
    arena.place(fixed_x, ld);
    arena.place(place, n);
    arena.place(keep, n);
    arena.place(hole, n);
    arena.place(preference, n);
    arena.place(stage, blocks);
    arena.place(snapshot, blocks);
    arena.place(extra, kChanges);
    arena.place(newcomer, kChanges);
    arena.place(direction, n);
    for (int k = 0; k < blocks; ++k) {
      double* kept = nullptr;
      int* left = nullptr;
      arena.place(kept, n * wide);
      arena.place(left, n);
      if (snapshot) {
        snapshot[k].G = kept;
        snapshot[k].free = left;
      }
    }
    for (int q = 0; q < kChanges; ++q) {
      double* column = nullptr;
      arena.place(column, n);
      if (extra) extra[q].column = column;
    }
    for (int k = 0; k < blocks; ++k) {
      const int rank = m[k] < n ? m[k] : n;
      int* rows = nullptr;
      double* V = nullptr;
      double* tau = nullptr;
      double* R = nullptr;
      double* pivots = nullptr;
      int* variables = nullptr;
      arena.place(rows, m[k]);
      arena.place(V, static_cast<std::size_t>(m[k]) * rank + 8);
      arena.place(tau, rank);
      arena.place(R, static_cast<std::size_t>(rank) * padded(rank));
      arena.place(pivots, static_cast<std::size_t>(n) * padded(rank));
      arena.place(variables, rank);
      if (stage) {
        Stage& s = stage[k];
        s.rows = rows;
        s.V = V;
        s.tau = tau;
        s.R = R;
        s.pivots = pivots;
        s.variables = variables;
        s.ldv = m[k];
        s.ldr = padded(rank);
      }
    }
  }

  // Directions of a level that are no longer than this count as none.
  double zero(int k) const {
    return trusting ? shortest(k) : larger(shortest(k), kNoStep * growth * table->block[k].norm);
  }

  // Shortest direction without magnified rounding.
  double shortest(int k) const { return larger(rank_tolerance * table->block[k].norm, table->block[k].rounding); }

  // A direction of level k was left out: no decision where growth alone speaks against it.
  void leave_out(int k, double length) {
    if (!(length > shortest(k))) return;
    cut_by_growth = true;
    closest = 1.0;
  }

  void note_pivot(double length, double floor) {
    const double ratio = length > floor ? length / floor : floor / larger(length, kTiny);
    closest = smaller(closest, ratio);
  }

  double bound(int r, const std::int8_t* W) const { return W[r] == kLower ? table->lower[r] : table->upper[r]; }
};

}  // namespace HQP_ISA
}  // namespace hqp
