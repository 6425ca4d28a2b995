// Equality-constrained lexicographic least squares, level by level, and constraints that join afterwards.
#pragma once

#include "pivoting.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Tableau : Pivoting {
  // Solve for the working set: W marks rows of the table, F variables held at a bound.
  void factorise(const std::int8_t* W, const std::int8_t* F) {
    begin(F);
    descend(0, W);
  }

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
};

}  // namespace HQP_ISA
}  // namespace hqp
