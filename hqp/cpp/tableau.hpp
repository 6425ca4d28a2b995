// Equality-constrained lexicographic least squares: column-pivoted Householder inside a level, then elimination
// of that level's pivot variables from everything below, kept as the tableau x_basic = c - G x_rest.
#pragma once

#include "table.hpp"

namespace hqp {
inline namespace HQP_ISA {

// What one level left behind: its rows, its orthogonal factor, its triangle, and the tableau's pivot columns.
struct Stage {
  enum Kind { kIdle, kReflectors, kGram } kind;
  int m, rank, before;     // rows that took part, pivots, basic variables of the levels above
  int* rows;               // (m,) of the table
  double* V;               // reflector i in V + i * ldv, entries i..m-1
  double* tau;
  double* R;               // (rank, rank), row stride ldr
  double* pivots;          // (before, rank) pivot columns of the tableau when the level was reached
  int* variables;          // (rank,)
  int ldv, ldr;
  double residual;         // norm of what no x can reach
  double excess;           // how much of it damping added, on the first `rank` rotated rows
};

// A constraint joined after the factorisation: the reduced row's pivot, and the tableau's column at that moment.
struct Extra {
  int row, variable;       // row of the table, or the variable it holds; the other is -1
  int pivot, before;       // variable that became basic, basic variables then
  int level;               // in front of which it stands
  double coefficient;      // of the pivot in the reduced row
  double* column;          // (before,)
  double lambda;           // its multiplier in the sweep at hand
};

// The tableau as it was when a level was reached.
struct Snapshot {
  double* G;
  int* free;
  int basic, rest;
  bool valid;
};

struct Tableau {
  const Table* table = nullptr;
  int n = 0, ld = 0, basic = 0, rest = 0;
  double* G = nullptr;        // (n, ld): column 0 is c, then the coefficients of the variables in `free`
  int* base = nullptr;        // (basic,) variables
  int* free = nullptr;        // (rest,) variables
  double* T = nullptr;        // (most rows of a level, ld)
  double* L = nullptr;        // (most rows of a level, ld)
  double* H = nullptr;        // (n + 1 padded, ld)
  double* weight = nullptr;   // (ld,) bias of a column
  double* size = nullptr;     // (ld,) biased squared norms
  double* diagonal = nullptr; // (ld,)
  double* target = nullptr;   // (ld,)
  double* x = nullptr;        // (n,) the solution
  double* fixed_x = nullptr;  // (n,) values of the fixed variables, zero elsewhere
  int* place = nullptr;       // (n,) position: >= 0 in free, -1 - i in base, kNowhere fixed
  int* keep = nullptr;        // (n,) where columns that stay come from
  int* hole = nullptr;       // (n,) where they go
  std::int8_t* biased = nullptr;
  Stage* stage = nullptr;
  Snapshot* snapshot = nullptr;
  bool recording = false;     // keep snapshots, for constraints that join above the last level
  Extra* extra = nullptr;
  int extras = 0;
  int gram_level = -1;        // the level that ended the tableau by a normal matrix, -1 if none did
  double growth = 1.0;        // how much rounding the tableau may have magnified
  double closest = 1e300;     // nearest a pivot came to the rank tolerance, as a ratio >= 1
  bool any_fixed = false;
  bool shifted = false;       // damping kept a level from its optimum
  int gram_free = 0;
  double rank_tolerance = 1e-9;
  double least = 0.0;         // smallest entry of `diagonal`
  static constexpr int kNowhere = 1 << 30;
  static constexpr int kExtras = 24;

  void layout(Arena& arena, int n_, int blocks, const int* m) {
    n = n_; ld = padded(n + 1);
    int most = n;
    for (int k = 0; k < blocks; ++k) most = m[k] > most ? m[k] : most;
    const std::size_t wide = static_cast<std::size_t>(ld);
    arena.place(G, (n + 4) * wide); arena.place(T, (most + 4) * wide); arena.place(L, (most + 4) * wide);
    arena.place(H, (n + 8) * wide);
    arena.place(base, n); arena.place(free, n); arena.place(weight, ld); arena.place(size, ld);
    arena.place(diagonal, ld); arena.place(target, ld); arena.place(x, ld); arena.place(fixed_x, ld);
    arena.place(place, n); arena.place(keep, n); arena.place(hole, n); arena.place(biased, n);
    arena.place(stage, blocks); arena.place(extra, kExtras); arena.place(snapshot, blocks);
    for (int k = 0; k < blocks; ++k) {
      double* kept = nullptr; int* left = nullptr;
      arena.place(kept, n * wide); arena.place(left, n);
      if (snapshot) { snapshot[k].G = kept; snapshot[k].free = left; }
    }
    for (int q = 0; q < kExtras; ++q) {
      double* column = nullptr;
      arena.place(column, n);
      if (extra) extra[q].column = column;
    }
    for (int k = 0; k < blocks; ++k) {
      const int rank = m[k] < n ? m[k] : n;
      int* rows = nullptr; double* V = nullptr; double* tau = nullptr; double* R = nullptr;
      double* pivots = nullptr; int* variables = nullptr;
      arena.place(rows, m[k]); arena.place(V, static_cast<std::size_t>(m[k]) * rank + 8); arena.place(tau, rank);
      arena.place(R, static_cast<std::size_t>(rank) * padded(rank)); arena.place(pivots, static_cast<std::size_t>(n) * padded(rank));
      arena.place(variables, rank);
      if (stage) {
        Stage& s = stage[k];
        s.rows = rows; s.V = V; s.tau = tau; s.R = R; s.pivots = pivots; s.variables = variables;
        s.ldv = m[k]; s.ldr = padded(rank);
      }
    }
  }

  // Solve for the working set: W marks rows of the table, F variables held at a bound.
  void factorise(const std::int8_t* W, const std::int8_t* F) {
    begin(F);
    descend(0, W);
  }

  // Go back to where `level` was reached, so that constraints can join in front of it; false where that is lost.
  bool rewind(int level) {
    if (level < 0 || level >= table->blocks || extras >= kExtras) return false;
    if (level == gram_level) return true;
    const Snapshot& s = snapshot[level];
    if (!recording || !s.valid) return false;
    const int width = lanes(s.rest + 1);
    for (int i = 0; i < s.basic; ++i) {
      const double* from = s.G + static_cast<std::ptrdiff_t>(i) * ld;
      double* to = G + static_cast<std::ptrdiff_t>(i) * ld;
      for (int j = 0; j < width; j += kLane) at(to + j) = at(from + j);
    }
    basic = s.basic; gram_free = s.rest; gram_level = level;
    for (int i = 0; i < basic; ++i) place[base[i]] = -1 - i;
    for (int j = 0; j < gram_free; ++j) { free[j] = s.free[j]; place[free[j]] = j; }
    return true;
  }

  // Hold a variable at its value within what the levels above gram_level leave free; false if they leave too little.
  bool hold(int variable, double value) {
    const int p = place[variable];
    if (p == kNowhere) return false;
    if (p >= 0) {
      for (int i = 0; i < basic; ++i) {
        double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
        g[0] -= g[1 + p] * value;
      }
      place[variable] = kNowhere;
      fixed_x[variable] = x[variable] = value;
      any_fixed = any_fixed || value != 0.0;
      drop(p);
      return true;
    }
    const double* g = G + static_cast<std::ptrdiff_t>(-1 - p) * ld;
    for (int j = 0; j <= gram_free; ++j) size[j] = -g[j];
    size[0] += value;
    if (!join(-1, variable, 1.0)) return false;
    double* held = G + static_cast<std::ptrdiff_t>(-1 - p) * ld;
    for (int j = 0; j < lanes(gram_free + 1); ++j) held[j] = 0.0;
    held[0] = value;
    return true;
  }

  // The same for a row of a level above gram_level.
  bool meet(int r, double bound) {
    const Block* b = table->block;
    while (b->end <= r) ++b;
    if (b - table->block >= gram_level) return false;
    const int width = lanes(gram_free + 1);
    for (int j = 0; j < width; ++j) size[j] = 0.0;
    if (!b->A) return false;
    const double* a = b->A + static_cast<std::ptrdiff_t>(r - b->begin) * n;
    size[0] = bound - (any_fixed ? dot_any(a, fixed_x, n) : 0.0);
    for (int j = 0; j < gram_free; ++j) size[1 + j] = a[free[j]];
    for (int i = 0; i < basic; ++i)
      if (a[base[i]] != 0.0) subtract(size, G + static_cast<std::ptrdiff_t>(i) * ld, a[base[i]], width);
    return join(r, -1, table->norm[r]);
  }

  // Solve the last levels again after constraints joined.
  void resume(const std::int8_t* W) {
    const int from = gram_level;
    for (int k = 0; k < from; ++k) snapshot[k].valid = false;   // they know nothing of the newcomers
    rest = gram_free;
    gram_free = 0; gram_level = -1;
    descend(from, W);
  }

 private:
  void descend(int from, const std::int8_t* W) {
    for (int k = from; k < table->blocks; ++k) level(k, W);
    for (int i = 0; i < basic; ++i) x[base[i]] = G[static_cast<std::ptrdiff_t>(i) * ld];
    if (gram_free) solution_of_gram();
  }

  void record(int k) {
    Snapshot& s = snapshot[k];
    s.valid = rest > 0;
    if (!s.valid) return;
    s.basic = basic; s.rest = rest;
    const int width = lanes(rest + 1);
    for (int i = 0; i < basic; ++i) {
      const double* from = G + static_cast<std::ptrdiff_t>(i) * ld;
      double* to = s.G + static_cast<std::ptrdiff_t>(i) * ld;
      for (int j = 0; j < width; j += kLane) at(to + j) = at(from + j);
    }
    for (int j = 0; j < rest; ++j) s.free[j] = free[j];
  }

  // The column of a variable that is free no more: the last one takes its place.
  void drop(int p) {
    const int last = gram_free - 1;
    for (int i = 0; i < basic; ++i) {
      double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
      g[1 + p] = g[1 + last];
      g[1 + last] = 0.0;
    }
    if (p != last) { free[p] = free[last]; place[free[p]] = p; }
    gram_free = last;
  }

  // The reduced row in `size`, sum_j size_j x_j = size_0, makes its largest variable basic.
  bool join(int row, int variable, double norm) {
    if (gram_free == 0 || extras == kExtras) return false;
    int q = 1;
    for (int j = 2; j <= gram_free; ++j) if (std::fabs(size[j]) > std::fabs(size[q])) q = j;
    const double pivot = size[q];
    if (!(std::fabs(pivot) > 1e-3 * norm) || basic >= n) return false;
    Extra& e = extra[extras++];
    e.level = gram_level;
    e.row = row; e.variable = variable; e.pivot = free[q - 1]; e.before = basic; e.coefficient = pivot; e.lambda = 0.0;
    double* fresh = G + static_cast<std::ptrdiff_t>(basic) * ld;
    const int width = lanes(gram_free + 1);
    for (int j = 0; j < width; ++j) fresh[j] = j <= gram_free ? size[j] / pivot : 0.0;
    fresh[q] = 0.0;
    for (int i = 0; i < basic; ++i) {
      double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
      const double f = e.column[i] = g[q];
      g[q] = 0.0;
      subtract(g, fresh, f, width);
    }
    const int entered = e.pivot;
    base[basic] = entered;
    ++basic;
    drop(q - 1);
    place[entered] = -1 - (basic - 1);
    growth = larger(growth, norm / std::fabs(pivot));
    return true;
  }

  void begin(const std::int8_t* F) {
    basic = 0; rest = 0; growth = 1.0; closest = 1e300; any_fixed = false; shifted = false; gram_free = 0; gram_level = -1; extras = 0;
    for (int k = 0; k < table->blocks; ++k) snapshot[k].valid = false;
    for (int i = 0; i < n; ++i) {
      fixed_x[i] = 0.0;
      if (F[i]) {
        x[i] = fixed_x[i] = F[i] > 0 ? table->hi[i] : table->lo[i];
        any_fixed = any_fixed || fixed_x[i] != 0.0;
        place[i] = kNowhere;
      } else {
        place[i] = rest;
        free[rest++] = i;
      }
    }
  }

 public:
  // Prefer as pivots the variables that the last selection does not see: it then needs no factorisation.
  void choose_bias() {
    for (int i = 0; i < n; ++i) biased[i] = 0;
    for (int k = table->blocks - 2; k >= 0; --k) {
      const Block& b = table->block[k];
      if (b.A) continue;
      for (int i = 0; i < n; ++i) biased[i] = 1;
      for (int i = 0; i < b.end - b.begin; ++i) biased[b.index[i]] = 0;
      break;
    }
  }

 private:
  void level(int k, const std::int8_t* W) {
    Stage& s = stage[k];
    const Block& b = table->block[k];
    s.kind = Stage::kIdle; s.rank = 0; s.before = basic; s.residual = 0.0; s.excess = 0.0;
    s.m = 0;
    if (recording) record(k);
    if (rest == 0) { s.residual = -1.0; return; }   // nothing left to decide: the residual is what it is
    for (int r = b.begin; r < b.end; ++r)
      if (W[r] && (b.A || place[b.index[r - b.begin]] != kNowhere)) s.rows[s.m++] = r;
    if (s.m == 0) return;
    if (!b.A && b.damping == 0.0 && gram_fits(k) && by_gram(k, W)) return;
    form(k, W);
    reflect_all(k);
    if (b.damping > 0.0 && s.rank) damp(k);
    if (s.rank) eliminate(k);
  }

  double bound(int r, const std::int8_t* W) const { return W[r] == kLower ? table->lower[r] : table->upper[r]; }

  // The level's working rows in the variables that are left: [rhs | coefficients].
  void form(int k, const std::int8_t* W) {
    Stage& s = stage[k];
    const Block& b = table->block[k];
    const int width = lanes(rest + 1);
    for (int i = 0; i < s.m; ++i) {
      const int r = s.rows[i], local = r - b.begin;
      double* row = T + static_cast<std::ptrdiff_t>(i) * ld;
      if (b.A) {
        const double* a = b.A + static_cast<std::ptrdiff_t>(local) * n;
        row[0] = bound(r, W) - (any_fixed ? dot_any(a, fixed_x, n) : 0.0);
        for (int j = 0; j < rest; ++j) row[1 + j] = a[free[j]];
        for (int j = rest + 1; j < width; ++j) row[j] = 0.0;
        double* left = L + static_cast<std::ptrdiff_t>(i) * ld;
        for (int j = 0; j < basic; ++j) left[j] = a[base[j]];
      } else {
        const int at_place = place[b.index[local]];
        const double scale = b.scale[local];
        if (at_place >= 0) {
          for (int j = 0; j < width; ++j) row[j] = 0.0;
          row[0] = bound(r, W);
          row[1 + at_place] = scale;
        } else {
          const double* g = G + static_cast<std::ptrdiff_t>(-1 - at_place) * ld;
          for (int j = 0; j < width; ++j) row[j] = -scale * g[j];
          row[0] += bound(r, W);
        }
      }
    }
    if (b.A) multiply_subtract(T, ld, L, ld, G, ld, s.m, basic, width);
  }

  void exact_sizes(int first, int m, int width) {
    for (int j = 0; j < width; j += kLane) {
      Vec4 total = splat(0.0);
      for (int i = first; i < m; ++i) { const Vec4 t = at(T + static_cast<std::ptrdiff_t>(i) * ld + j); total += t * t; }
      at(size + j) = total * at(weight + j);
    }
  }

  // Householder with column pivoting on T, in place; columns stay where they are.
  void reflect_all(int k) {
    Stage& s = stage[k];
    const int width = lanes(rest + 1), m = s.m;
    const double floor = larger(rank_tolerance, 1e-14 * growth) * table->block[k].norm;
    weight[0] = 0.0;
    for (int j = 0; j < rest; ++j) weight[1 + j] = biased[free[j]] ? 9.0 : 1.0;
    for (int j = rest + 1; j < width; ++j) weight[j] = 0.0;
    exact_sizes(0, m, width);
    double reference = 0.0;
    for (int j = 1; j <= rest; ++j) reference = larger(reference, size[j]);
    s.kind = Stage::kReflectors;
    int rank = 0;
    double smallest = kInfinity;
    while (rank < m && rank < rest) {
      int p = largest_column(width);
      if (size[p] < 1e-8 * reference) {
        exact_sizes(rank, m, width);
        p = largest_column(width);
        reference = size[p];
      }
      double* v = s.V + static_cast<std::ptrdiff_t>(rank) * s.ldv;
      double square = 0.0;
      for (int i = rank; i < m; ++i) { v[i] = T[static_cast<std::ptrdiff_t>(i) * ld + p]; square += v[i] * v[i]; }
      const double length = std::sqrt(square);
      note_pivot(length, floor);
      if (!(length > floor)) break;
      const double alpha = v[rank], beta = alpha > 0 ? -length : length;
      v[rank] = alpha - beta;
      const double tau = 1.0 / (length * (length + std::fabs(alpha)));
      double* top = T + static_cast<std::ptrdiff_t>(rank) * ld;
      reflect(top, ld, v + rank, m - rank, tau, width, size, weight);
      s.tau[rank] = tau;
      top[p] = beta;
      for (int i = rank + 1; i < m; ++i) T[static_cast<std::ptrdiff_t>(i) * ld + p] = 0.0;
      weight[p] = 0.0; size[p] = 0.0;
      s.variables[rank++] = p - 1;   // positions now, variables after elimination
      smallest = smaller(smallest, length);
    }
    s.rank = rank;
    if (rank) growth = larger(growth, table->block[k].norm / smallest);
    double square = 0.0;
    for (int i = rank; i < m; ++i) { const double t = T[static_cast<std::ptrdiff_t>(i) * ld]; square += t * t; }
    s.residual = std::sqrt(square);
  }

  // Position of the largest size, the lowest of equal ones; column 0 is the right-hand side.
  int largest_column(int width) const {
    Vec4 best = at(size), where = Vec4{0, 1, 2, 3}, here = where;
    const Vec4 step = splat(kLane);
    for (int j = kLane; j < width; j += kLane) {
      const Vec4 t = at(size + j);
      here += step;
      const auto more = t > best;
      best = more ? t : best;
      where = more ? here : where;
    }
    double top = best[0], place_of_top = where[0];
    for (int q = 1; q < kLane; ++q)
      if (best[q] > top || (best[q] == top && where[q] < place_of_top)) { top = best[q]; place_of_top = where[q]; }
    const int found = static_cast<int>(place_of_top);
    return found > 0 ? found : 1;
  }

  void note_pivot(double length, double floor) {
    const double ratio = length > floor ? length / floor : floor / larger(length, 1e-300);
    closest = smaller(closest, ratio);
  }

  // Make the pivot variables basic: solve the triangle, then clear them from the rows of the levels above.
  void eliminate(int k) {
    Stage& s = stage[k];
    const int r = s.rank, ldr = s.ldr;
    for (int i = 0; i < r; ++i)
      for (int j = i; j < r; ++j) s.R[i * ldr + j] = T[static_cast<std::ptrdiff_t>(i) * ld + 1 + s.variables[j]];
    for (int i = 0; i < basic; ++i) {
      const double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
      for (int j = 0; j < r; ++j) s.pivots[static_cast<std::ptrdiff_t>(i) * ldr + j] = g[1 + s.variables[j]];
    }
    for (int j = 0; j < r; ++j) {
      const int variable = free[s.variables[j]];
      s.variables[j] = variable; place[variable] = -1 - (basic + j); base[basic + j] = variable;
    }
    // columns that stay move from the end into the holes the pivots left
    const int left = rest - r, old_width = lanes(rest + 1), width = lanes(left + 1);
    int moves = 0;
    for (int j = 0, tail = left; j < left; ++j) {
      if (place[free[j]] >= 0) continue;
      while (place[free[tail]] < 0) ++tail;
      hole[moves] = j; keep[moves++] = tail;
      free[j] = free[tail]; place[free[j]] = j; ++tail;
    }
    double* fresh = G + static_cast<std::ptrdiff_t>(basic) * ld;
    for (int i = 0; i < r; ++i) {
      const double* from = T + static_cast<std::ptrdiff_t>(i) * ld;
      double* to = fresh + static_cast<std::ptrdiff_t>(i) * ld;
      for (int j = 0; j < old_width; j += kLane) at(to + j) = at(from + j);
    }
    for (int i = 0; i < basic + r; ++i) {
      double* row = G + static_cast<std::ptrdiff_t>(i) * ld;
      for (int q = 0; q < moves; ++q) row[1 + hole[q]] = row[1 + keep[q]];
      for (int j = left + 1; j < width; ++j) row[j] = 0.0;
    }
    rest = left;
    for (int i = r - 1; i >= 0; --i) {
      double* row = fresh + static_cast<std::ptrdiff_t>(i) * ld;
      if (i + 1 < r) multiply_rows<1>(row, ld, s.R + i * ldr + i + 1, ldr, row + ld, ld, r - 1 - i, width);
      const Vec4 inverse = splat(1.0 / s.R[i * ldr + i]);
      for (int j = 0; j < width; j += kLane) at(row + j) *= inverse;
    }
    multiply_subtract(G, ld, s.pivots, ldr, fresh, ld, basic, r, width);
    basic += r;
  }

  // Whether a selection sees every variable that is left.
  bool gram_fits(int k) {
    const Stage& s = stage[k];
    const Block& b = table->block[k];
    for (int j = 0; j < rest; ++j) diagonal[j] = 0.0;
    double most = 0.0;
    for (int i = 0; i < s.m; ++i) {
      const int local = s.rows[i] - b.begin, p = place[b.index[local]];
      const double d = b.scale[local] * b.scale[local];
      most = larger(most, d);
      if (p >= 0) diagonal[p] += d;
    }
    least = kInfinity;
    for (int j = 0; j < rest; ++j) least = smaller(least, diagonal[j]);
    return least > 1e-6 * most;
  }

  // minimise sum (s x - b)^2 over what is left: H = D + G' S G, Cholesky; false if H is badly conditioned.
  bool by_gram(int k, const std::int8_t* W) {
    Stage& s = stage[k];
    const Block& b = table->block[k];
    const int width = lanes(rest + 1);
    for (int j = 0; j < rest; ++j) target[j] = 0.0;
    int depth = 0;
    for (int i = 0; i < s.m; ++i) {
      const int r = s.rows[i], local = r - b.begin, p = place[b.index[local]];
      const double scale = b.scale[local];
      if (p >= 0) { target[p] += scale * bound(r, W); continue; }
      const double* g = G + static_cast<std::ptrdiff_t>(-1 - p) * ld;
      double* row = T + static_cast<std::ptrdiff_t>(depth++) * ld;
      if (scale == 1.0) for (int j = 0; j < width; j += kLane) at(row + j) = at(g + j);
      else { const Vec4 f = splat(scale); for (int j = 0; j < width; j += kLane) at(row + j) = f * at(g + j); }
      row[0] -= bound(r, W);
    }
    gram(H, ld, T, ld, depth, width);
    for (int j = 0; j < rest; ++j) { H[static_cast<std::ptrdiff_t>(j + 1) * ld + j + 1] += diagonal[j]; target[j] += H[1 + j]; }
    double trace = 0.0;
    for (int j = 0; j < rest; ++j) trace += H[static_cast<std::ptrdiff_t>(j + 1) * ld + j + 1];
    if (!(trace < 1e10 * least)) return false;
    s.kind = Stage::kGram;
    cholesky(width);
    solve_gram(target);
    gram_free = rest;
    gram_level = k;
    s.rank = rest;
    s.residual = -1.0;
    rest = 0;
    return true;
  }

  // H = U' U on rows and columns 1..rest, upper triangle, four rows at a time; 1 / U_ii goes to column 0.
  void cholesky(int width) {
    for (int first = 0; first <= rest; first += kLane) {
      const int last = first + kLane <= rest + 1 ? first + kLane : rest + 1;
      for (int i = first > 0 ? first : 1; i < last; ++i) {
        double* top = H + static_cast<std::ptrdiff_t>(i) * ld;
        const double inverse = 1.0 / std::sqrt(top[i]);
        const Vec4 f = splat(inverse);
        for (int j = first; j < width; j += kLane) at(top + j) *= f;
        for (int a = i + 1; a < last; ++a) subtract(H + static_cast<std::ptrdiff_t>(a) * ld + first, top + first, top[a], width - first);
        top[0] = inverse;
      }
      if (first == 0) {   // row 0 is no row of the factor
        double* row = H;
        for (int j = 0; j < width; j += kLane) at(row + j) = splat(0.0);
      }
      gram_subtract(H, ld, H + static_cast<std::ptrdiff_t>(first) * ld, ld, last - first, first + kLane, width);
    }
  }

 public:
  // y := H^-1 y over the variables the last level decided.
  void solve_gram(double* y) {
    const int c = gram_free ? gram_free : rest;
    for (int i = 0; i < c; ++i) {
      const double* u = H + static_cast<std::ptrdiff_t>(i + 1) * ld;
      y[i] *= u[0];
      add_any(y + i + 1, u + i + 2, -y[i], c - i - 1);
    }
    for (int i = c - 1; i >= 0; --i) {
      const double* u = H + static_cast<std::ptrdiff_t>(i + 1) * ld;
      y[i] = (y[i] - dot_any(u + i + 2, y + i + 1, c - i - 1)) * u[0];
    }
  }

 private:
  void solution_of_gram() {
    for (int j = 0; j < gram_free; ++j) x[free[j]] = target[j];
    for (int i = 0; i < basic; ++i)
      x[base[i]] -= dot_any(G + static_cast<std::ptrdiff_t>(i) * ld + 1, target, gram_free);
  }

  // Damping: the level's targets c become c - d^2 (K M^-1 K' + d^2)^-1 (c - K x_0), K = [R S], M = 1 + G'G,
  // x_0 the shortest solution of the levels above. Nothing above moves, and nothing below loses freedom.
  void damp(int k) {
    Stage& s = stage[k];
    const double square = table->block[k].damping * table->block[k].damping;
    const int width = lanes(rest + 1), r = s.rank;
    gram(H, ld, G, ld, basic, width);
    for (int j = 0; j < rest; ++j) { H[static_cast<std::ptrdiff_t>(j + 1) * ld + j + 1] += 1.0; target[j] = H[1 + j]; }
    cholesky(width);
    solve_gram(target);
    double* error = size;                 // free again once the pivots are chosen
    for (int i = 0; i < r; ++i) {
      const double* row = T + static_cast<std::ptrdiff_t>(i) * ld;
      error[i] = row[0] - dot_any(row + 1, target, rest);
    }
    // K M^-1 K' = B B', B = K U^-1, row by row by forward substitution
    for (int i = 0; i < r; ++i) {
      const double* row = T + static_cast<std::ptrdiff_t>(i) * ld;
      double* out = L + static_cast<std::ptrdiff_t>(i) * ld;
      for (int j = 0; j < rest; ++j) out[j] = row[1 + j];
      for (int j = 0; j < rest; ++j) {
        const double* u = H + static_cast<std::ptrdiff_t>(j + 1) * ld;
        out[j] *= u[0];
        add_any(out + j + 1, u + j + 2, -out[j], rest - j - 1);
      }
    }
    double* S = s.R;                      // overwritten by eliminate()
    for (int i = 0; i < r; ++i)
      for (int j = 0; j <= i; ++j)
        S[i * s.ldr + j] = dot_any(L + static_cast<std::ptrdiff_t>(i) * ld, L + static_cast<std::ptrdiff_t>(j) * ld, rest) + (i == j ? square : 0.0);
    for (int i = 0; i < r; ++i) {         // lower Cholesky with both solves
      for (int j = 0; j <= i; ++j) {
        double t = S[i * s.ldr + j] - dot_any(S + i * s.ldr, S + j * s.ldr, j);
        S[i * s.ldr + j] = i == j ? std::sqrt(t) : t / S[j * s.ldr + j];
      }
      error[i] = (error[i] - dot_any(S + i * s.ldr, error, i)) / S[i * s.ldr + i];
    }
    for (int i = r - 1; i >= 0; --i) {
      error[i] /= S[i * s.ldr + i];
      for (int j = 0; j < i; ++j) error[j] -= S[i * s.ldr + j] * error[i];
    }
    for (int i = 0; i < r; ++i) {
      T[static_cast<std::ptrdiff_t>(i) * ld] -= square * error[i];
      shifted = shifted || square * std::fabs(error[i]) > 1e-9;
    }
    s.excess = square;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
