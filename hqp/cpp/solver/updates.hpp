// Small changes of the working set, made in front of one level: only the levels from there on are solved again.
#pragma once

#include "levels.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Updates {
 public:
  Updates(Tableau& tableau, Levels& levels) : t_(tableau), levels_(levels) {}

  // Go back to where `level` was reached, now with all that joined since; false where that is lost.
  bool rewind(int level) {
    if (level < 0 || level >= t_.table->blocks) return false;
    if (level == t_.gram_level) return true;
    const Snapshot& s = t_.snapshot[level];
    if (!t_.recording || !s.valid) return false;
    const int known = t_.newcomers;
    copy_rows(t_.G, s.G, t_.ld, s.basic, lanes(s.rest + 1));
    t_.basic = s.basic;
    t_.gram_free = s.rest;
    t_.gram_level = level;
    t_.extras = s.extras;
    t_.newcomers = s.newcomers;
    for (int i = 0; i < t_.basic; ++i) {
      t_.place[t_.base[i]] = -1 - i;
      t_.fixed_x[t_.base[i]] = 0.0;
    }
    for (int j = 0; j < t_.gram_free; ++j) {
      t_.free[j] = s.free[j];
      t_.place[t_.free[j]] = j;
      t_.fixed_x[t_.free[j]] = 0.0;
    }
    for (int q = t_.newcomers; q < known; ++q) {
      const Newcomer c = t_.newcomer[q];  // noted again where it still has to be
      if (!(c.row >= 0 ? meet(c.row, c.value) : hold(c.variable, c.value))) return false;
    }
    return true;
  }

  // Hold a variable at its value within the freedom below the levels above gram_level; false if they leave too little.
  bool hold(int variable, double value) {
    const int p = t_.place[variable];
    if (p == Tableau::kNowhere || t_.newcomers == kChanges) return false;
    if (p >= 0) {
      for (int i = 0; i < t_.basic; ++i) {
        double* g = t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld;
        g[0] -= g[1 + p] * value;
      }
      t_.place[variable] = Tableau::kNowhere;
      t_.fixed_x[variable] = t_.x[variable] = value;
      t_.any_fixed = t_.any_fixed || value != 0.0;
      drop(p);
    } else {
      const double* g = t_.G + static_cast<std::ptrdiff_t>(-1 - p) * t_.ld;
      for (int j = 0; j <= t_.gram_free; ++j) t_.size[j] = -g[j];
      t_.size[0] += value;
      if (!join(-1, variable, 1.0)) return false;
      double* held = t_.G + static_cast<std::ptrdiff_t>(-1 - p) * t_.ld;
      for (int j = 0; j < lanes(t_.gram_free + 1); ++j) held[j] = 0.0;
      held[0] = value;
    }
    t_.newcomer[t_.newcomers++] = Newcomer{-1, variable, value};
    return true;
  }

  // Hold a row at its bound; one of gram_level or below joins by itself when its level is solved. A row that a
  // factorisation might call dependent is left to it: a working set has one rank, regardless of its history.
  bool meet(int r, double bound) {
    const Block& b = t_.table->block_of(r);
    if (&b - t_.table->block >= t_.gram_level) return true;
    if (!b.A || t_.newcomers == kChanges) return false;
    const int width = lanes(t_.gram_free + 1);
    for (int j = 0; j < width; ++j) t_.size[j] = 0.0;
    const double* a = b.A + static_cast<std::ptrdiff_t>(r - b.begin) * t_.n;
    t_.size[0] = bound - (t_.any_fixed ? dot_any(a, t_.fixed_x, t_.n) : 0.0);
    for (int j = 0; j < t_.gram_free; ++j) t_.size[1 + j] = a[t_.free[j]];
    for (int i = 0; i < t_.basic; ++i)
      if (a[t_.base[i]] != 0.0) subtract(t_.size, t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld, a[t_.base[i]], width);
    if (!join(r, -1, t_.table->norm[r], kClear * t_.zero(static_cast<int>(&b - t_.table->block)))) return false;
    t_.newcomer[t_.newcomers++] = Newcomer{r, -1, bound};
    return true;
  }

  // Release a held variable; false if it changes a level above gram_level, or is a basic variable.
  bool let_go(int variable) {
    if (t_.place[variable] != Tableau::kNowhere || !respond(variable)) return false;
    const int before = lanes(t_.gram_free + 1), width = lanes(t_.gram_free + 2);
    for (int i = 0; i < t_.basic; ++i) {
      double* g = t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld;
      for (int j = before; j < width; ++j) g[j] = 0.0;
      g[1 + t_.gram_free] = -t_.direction[t_.base[i]];
      g[0] -= t_.direction[t_.base[i]] * t_.fixed_x[variable];
    }
    t_.free[t_.gram_free] = variable;
    t_.place[variable] = t_.gram_free++;
    t_.fixed_x[variable] = 0.0;
    t_.has_released = true;
    for (int k = 0; k < t_.gram_level; ++k) t_.snapshot[k].valid = false;  // they do not know that it left
    return true;
  }

  // Solve the levels from gram_level on again.
  void resume(const std::int8_t* W) {
    const int from = t_.gram_level;
    t_.rest = t_.gram_free;
    t_.gram_free = 0;
    t_.gram_level = -1;
    levels_.descend(from, W);
  }

 private:
  // Compute the response of the basic variables to a unit move of a held one, in `direction`; false where levels above
  // would not.
  bool respond(int variable) {
    double* d = t_.direction;
    for (int i = 0; i < t_.n; ++i) d[i] = 0.0;
    d[variable] = 1.0;
    int q = 0;
    for (int k = 0; k <= t_.gram_level; ++k) {
      for (; q < t_.extras && t_.extra[q].level == k; ++q) follow(t_.extra[q], d);
      if (k < t_.gram_level && !follow(k, variable, d)) return false;
    }
    return true;
  }

  void follow(const Extra& e, double* d) const {
    const double step = (e.row >= 0 ? t_.table->value(e.row, d) : d[e.variable]) / e.coefficient;
    for (int i = 0; i < e.before; ++i) d[t_.base[i]] += e.column[i] * step;
    d[e.pivot] -= step;
    if (e.variable >= 0) d[e.variable] = 0.0;
  }

  bool follow(int k, int variable, double* d) {
    const Stage& s = t_.stage[k];
    const Block& b = t_.table->block[k];
    if (s.residual < 0.0) return false;
    if (!b.A)
      for (int i = 0; i < b.end - b.begin; ++i)
        if (b.index[i] == variable) return false;
    double* left = t_.target;
    for (int i = 0; i < s.m; ++i) left[i] = t_.table->value(s.rows[i], d);
    for (int i = 0; i < s.rank; ++i) s.reflect(i, left);
    double square = 0.0;
    for (int i = s.rank; i < s.m; ++i) square += left[i] * left[i];
    const double unmet = std::sqrt(square), least = t_.zero(k);
    if (!(unmet <= least)) return false;
    t_.note_pivot(unmet, least);
    t_.leave_out(k, unmet);
    for (int i = s.rank - 1; i >= 0; --i) {
      const double* R = s.R + static_cast<std::ptrdiff_t>(i) * s.ldr;
      left[i] = (left[i] - dot_any(R + i + 1, left + i + 1, s.rank - i - 1)) / R[i];
    }
    for (int i = 0; i < s.before; ++i)
      d[t_.base[i]] += dot_any(s.pivots + static_cast<std::ptrdiff_t>(i) * s.ldr, left, s.rank);
    for (int i = 0; i < s.rank; ++i) d[s.variables[i]] -= left[i];
    return true;
  }

  // The column of a variable that is free no more: the last one takes its place.
  void drop(int p) {
    const int last = t_.gram_free - 1;
    for (int i = 0; i < t_.basic; ++i) {
      double* g = t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld;
      g[1 + p] = g[1 + last];
      g[1 + last] = 0.0;
    }
    if (p != last) {
      t_.free[p] = t_.free[last];
      t_.place[t_.free[p]] = p;
    }
    t_.gram_free = last;
  }

  // The reduced row in `size`, sum_j size_j x_j = size_0, makes its largest variable basic.
  bool join(int row, int variable, double norm, double least = 0.0) {
    if (t_.gram_free == 0 || t_.extras == kChanges) return false;
    int q = 1;
    for (int j = 2; j <= t_.gram_free; ++j)
      if (std::fabs(t_.size[j]) > std::fabs(t_.size[q])) q = j;
    const double pivot = t_.size[q];
    if (!(std::fabs(pivot) > larger(kRests * norm, least)) || t_.basic >= t_.n) return false;
    Extra& e = t_.extra[t_.extras++];
    e.level = t_.gram_level;
    e.row = row;
    e.variable = variable;
    e.pivot = t_.free[q - 1];
    e.before = t_.basic;
    e.coefficient = pivot;
    e.lambda = 0.0;
    double* fresh = t_.G + static_cast<std::ptrdiff_t>(t_.basic) * t_.ld;
    const int width = lanes(t_.gram_free + 1);
    for (int j = 0; j < width; ++j) fresh[j] = j <= t_.gram_free ? t_.size[j] / pivot : 0.0;
    fresh[q] = 0.0;
    for (int i = 0; i < t_.basic; ++i) {
      double* g = t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld;
      const double f = e.column[i] = g[q];
      g[q] = 0.0;
      subtract(g, fresh, f, width);
    }
    const int entered = e.pivot;
    t_.base[t_.basic] = entered;
    ++t_.basic;
    drop(q - 1);
    t_.place[entered] = -1 - (t_.basic - 1);
    t_.growth = larger(t_.growth, norm / std::fabs(pivot));
    return true;
  }

  Tableau& t_;
  Levels& levels_;
};

}  // namespace HQP_ISA
}  // namespace hqp
