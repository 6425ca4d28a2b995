// Small changes of the working set, made in front of one level: only the levels from there on are solved again.
#pragma once

#include "levels.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Tableau : Levels {
  static constexpr double kSure =
      1e4;  // a row joins by an update if its pivot is longer than this times the rank tolerance

  // Go back to where `level` was reached, now with all that joined since; false where that is lost.
  bool rewind(int level) {
    if (level < 0 || level >= table->blocks) return false;
    if (level == gram_level) return true;
    const Snapshot& s = snapshot[level];
    if (!recording || !s.valid) return false;
    const int known = newcomers;
    copy_rows(G, s.G, ld, s.basic, lanes(s.rest + 1));
    basic = s.basic;
    gram_free = s.rest;
    gram_level = level;
    extras = s.extras;
    newcomers = s.newcomers;
    for (int i = 0; i < basic; ++i) {
      place[base[i]] = -1 - i;
      fixed_x[base[i]] = 0.0;
    }
    for (int j = 0; j < gram_free; ++j) {
      free[j] = s.free[j];
      place[free[j]] = j;
      fixed_x[free[j]] = 0.0;
    }
    for (int q = newcomers; q < known; ++q) {
      const Newcomer c = newcomer[q];  // noted again where it still has to be
      if (!(c.row >= 0 ? meet(c.row, c.value) : hold(c.variable, c.value))) return false;
    }
    return true;
  }

  // Hold a variable at its value within what the levels above gram_level leave free; false if they leave too little.
  bool hold(int variable, double value) {
    const int p = place[variable];
    if (p == kNowhere || newcomers == kChanges) return false;
    if (p >= 0) {
      for (int i = 0; i < basic; ++i) {
        double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
        g[0] -= g[1 + p] * value;
      }
      place[variable] = kNowhere;
      fixed_x[variable] = x[variable] = value;
      any_fixed = any_fixed || value != 0.0;
      drop(p);
    } else {
      const double* g = G + static_cast<std::ptrdiff_t>(-1 - p) * ld;
      for (int j = 0; j <= gram_free; ++j) size[j] = -g[j];
      size[0] += value;
      if (!join(-1, variable, 1.0)) return false;
      double* held = G + static_cast<std::ptrdiff_t>(-1 - p) * ld;
      for (int j = 0; j < lanes(gram_free + 1); ++j) held[j] = 0.0;
      held[0] = value;
    }
    newcomer[newcomers++] = Newcomer{-1, variable, value};
    return true;
  }

  // The same for a row; one of gram_level or below joins by itself when its level is solved. What a factorisation might
  // call no direction is left to it: a working set has one rank, whatever the way to it.
  bool meet(int r, double bound) {
    const Block& b = table->block_of(r);
    if (&b - table->block >= gram_level) return true;
    if (!b.A || newcomers == kChanges) return false;
    const int width = lanes(gram_free + 1);
    for (int j = 0; j < width; ++j) size[j] = 0.0;
    const double* a = b.A + static_cast<std::ptrdiff_t>(r - b.begin) * n;
    size[0] = bound - (any_fixed ? dot_any(a, fixed_x, n) : 0.0);
    for (int j = 0; j < gram_free; ++j) size[1 + j] = a[free[j]];
    for (int i = reduction.count; i < basic; ++i)
      if (a[base[i]] != 0.0) subtract(size, G + static_cast<std::ptrdiff_t>(i) * ld, a[base[i]], width);
    if (!join(r, -1, table->norm[r], kSure * zero(static_cast<int>(&b - table->block)))) return false;
    newcomer[newcomers++] = Newcomer{r, -1, bound};
    return true;
  }

  // Let go of a held variable; false where a level above gram_level would notice, or the variable is a basic one.
  bool let_go(int variable) {
    if (place[variable] != kNowhere || !respond(variable)) return false;
    const int before = lanes(gram_free + 1), width = lanes(gram_free + 2);
    for (int i = 0; i < basic; ++i) {
      double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
      for (int j = before; j < width; ++j) g[j] = 0.0;
      g[1 + gram_free] = -direction[base[i]];
      g[0] -= direction[base[i]] * fixed_x[variable];
    }
    free[gram_free] = variable;
    place[variable] = gram_free++;
    fixed_x[variable] = 0.0;
    has_released = true;
    for (int k = 0; k < gram_level; ++k) snapshot[k].valid = false;  // they do not know that it left
    return true;
  }

  // Solve the levels from gram_level on again.
  void resume(const std::int8_t* W) { resume(W, gram_level); }

  // The levels that were left out until now, where everything else stands.
  bool deepen(const std::int8_t* W) {
    if (lowest <= solved || gram_level != table->blocks - 1) return false;
    for (int q = 0; q < extras; ++q)
      if (extra[q].level == gram_level) extra[q].level = solved + 1;
    resume(W, solved + 1);
    return true;
  }

 private:
  void resume(const std::int8_t* W, int from) {
    rest = gram_free;
    gram_free = 0;
    gram_level = -1;
    descend(from, W);
  }

  // How the basic variables follow a held one that moves by one, in `direction`; false where levels above would not.
  bool respond(int variable) {
    double* d = direction;
    for (int i = 0; i < n; ++i) d[i] = 0.0;
    d[variable] = 1.0;
    for (int i = 0; i < reduction.count; ++i) d[reduction.base[i]] = -reduction.row_of_G(i, n)[variable];
    int q = 0;
    for (int k = 0; k <= gram_level; ++k) {
      for (; q < extras && extra[q].level == k; ++q) follow(extra[q], d);
      if (k < gram_level && !follow(k, variable, d)) return false;
    }
    return true;
  }

  void follow(const Extra& e, double* d) const {
    const double step = (e.row >= 0 ? table->value(e.row, d) : d[e.variable]) / e.coefficient;
    for (int i = 0; i < e.before; ++i) d[base[i]] += e.column[i] * step;
    d[e.pivot] -= step;
    if (e.variable >= 0) d[e.variable] = 0.0;
  }

  bool follow(int k, int variable, double* d) {
    const Stage& s = stage[k];
    const Block& b = table->block[k];
    if (s.residual < 0.0) return false;
    if (!b.A)
      for (int i = 0; i < b.end - b.begin; ++i)
        if (b.index[i] == variable) return false;
    double* left = target;
    for (int i = 0; i < s.m; ++i) left[i] = table->value(s.rows[i], d);
    for (int i = 0; i < s.rank; ++i) reflect_vector(s, i, left);
    double square = 0.0;
    for (int i = s.rank; i < s.m; ++i) square += left[i] * left[i];
    const double unmet = std::sqrt(square), least = zero(k);
    if (!(unmet <= least)) return false;
    note_pivot(unmet, least);
    for (int i = s.rank - 1; i >= 0; --i) {
      const double* R = s.R + static_cast<std::ptrdiff_t>(i) * s.ldr;
      left[i] = (left[i] - dot_any(R + i + 1, left + i + 1, s.rank - i - 1)) / R[i];
    }
    for (int i = 0; i < s.before; ++i)
      d[base[i]] += dot_any(s.pivots + static_cast<std::ptrdiff_t>(i) * s.ldr, left, s.rank);
    for (int i = 0; i < s.rank; ++i) d[s.variables[i]] -= left[i];
    return true;
  }

  // The column of a variable that is free no more: the last one takes its place.
  void drop(int p) {
    const int last = gram_free - 1;
    for (int i = 0; i < basic; ++i) {
      double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
      g[1 + p] = g[1 + last];
      g[1 + last] = 0.0;
    }
    if (p != last) {
      free[p] = free[last];
      place[free[p]] = p;
    }
    gram_free = last;
  }

  // The reduced row in `size`, sum_j size_j x_j = size_0, makes its largest variable basic.
  bool join(int row, int variable, double norm, double least = 0.0) {
    if (gram_free == 0 || extras == kChanges) return false;
    int q = 1;
    for (int j = 2; j <= gram_free; ++j)
      if (std::fabs(size[j]) > std::fabs(size[q])) q = j;
    const double pivot = size[q];
    if (!(std::fabs(pivot) > larger(1e-3 * norm, least)) || basic >= n) return false;
    Extra& e = extra[extras++];
    e.level = gram_level;
    e.row = row;
    e.variable = variable;
    e.pivot = free[q - 1];
    e.before = basic;
    e.coefficient = pivot;
    e.lambda = 0.0;
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
