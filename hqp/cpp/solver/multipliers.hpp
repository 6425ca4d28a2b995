// The signs of the multipliers, level by level, by one adjoint sweep through the stages of the tableau.
#pragma once

#include "gram.hpp"
#include "tolerances.hpp"
#include "working_set.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Multipliers {
  const Table* table = nullptr;
  Tableau* tableau = nullptr;
  double tolerance = 0.0;
  double* g = nullptr;       // (n,) gradient
  double* w = nullptr;       // (rows,) slack of the working rows
  double* lambda = nullptr;  // (rows,)
  double* delta = nullptr;   // (rows,) change by refinement
  double* mu = nullptr;      // (n,) multipliers of the held variables
  double* before = nullptr;  // (n,) mu before refinement
  double* y = nullptr;       // scratch
  int* open = nullptr;       // (open_rows,) rows whose sign is not known yet, in order
  int* open_x = nullptr;     // (open_variables,) held variables, the same
  WrongSign* to_release = nullptr;
  bool doubted = false;  // a multiplier was near rounding, or a residual was taken for it
  int count = 0;
  int open_rows = 0, open_variables = 0;

  void layout(Arena& arena, int n, int rows, int most) {
    arena.place(g, n);
    arena.place(w, rows);
    arena.place(lambda, rows);
    arena.place(delta, rows);
    arena.place(before, n);
    arena.place(mu, n);
    arena.place(y, most + n + 16);
    arena.place(open, rows);
    arena.place(open_x, n);
    arena.place(to_release, static_cast<std::size_t>(rows) + n);
  }

  // Fill `to_release` for the working set (W, F) whose solution is the tableau's x, v = A x; or only for the highest
  // level that has any.
  void judge(const std::int8_t* W, const std::int8_t* F, const double* v, bool highest = false) {
    const Table& t = *table;
    count = open_rows = open_variables = 0;
    doubted = false;
    for (int i = 0; i < t.n; ++i)
      if (F[i] && !t.fixed[i]) open_x[open_variables++] = i;
    for (int q = 0; q < t.inequalities; ++q)
      if (W[t.unequal[q]]) open[open_rows++] = t.unequal[q];
    if (!pending()) return;
    const double span = t.span(tableau->x);
    for (int k = 0; k < t.blocks && pending(); ++k) {
      const double norm = t.block[k].norm;
      if (norm <= t.block[k].rounding) continue;
      const double length = slack(k, W, v, span);
      if (length == 0.0) continue;
      own_signs(k, W, span, length);
      if (!pending()) break;
      gradient(k);
      sweep_above(k, lambda);
      const double least = norm * ((tolerance / kEither) * length + kLastDigits * norm * span);
      const double limit = norm * ((tolerance + kLastDigits * tableau->growth) * length + kLastDigits * norm * span);
      const bool refined = doubtful(k, least, limit);
      if (refined) refine(k);
      faint_ = kOnRow * norm * length;
      clear_ = larger(larger(kSeen, kEither * tolerance * tableau->growth) * norm * length, refined ? least : limit);
      decide(k, W, F, refined ? least : limit, refined);
      if (highest && count) return;
    }
  }

  // The highest level that requests a release.
  int highest() const {
    int level = table->blocks;
    for (int q = 0; q < count; ++q) level = to_release[q].level < level ? to_release[q].level : level;
    return level;
  }

  bool pending() const { return open_rows + open_variables > 0; }

  // w_k of the working rows and its norm; zero where each row is met within rounding.
  double slack(int k, const std::int8_t* W, const double* v, double span) {
    const Table& t = *table;
    const Block& b = t.block[k];
    const Stage& s = tableau->stage[k];
    for (int r = b.begin; r < b.end; ++r) w[r] = W[r] ? v[r] - tableau->bound(r, W) : 0.0;
    if (s.kind == Stage::kReflectors) {
      if (s.rank == s.m)
        for (int i = 0; i < s.m; ++i) w[s.rows[i]] = 0.0;
      else if (s.rank) project(s);
    }
    double square = 0.0;
    bool missed = false;
    for (int r = b.begin; r < b.end; ++r) {
      square += w[r] * w[r];
      missed = missed || (w[r] != 0.0 && !met(r, W, span));
    }
    if (missed) return std::sqrt(square);
    const double rounding = kRests * tolerance + kLastDigits * tableau->growth;
    doubted = doubted || std::sqrt(square) > rounding * b.norm * t.largest(tableau->x);
    for (int r = b.begin; r < b.end; ++r) w[r] = 0.0;
    return 0.0;
  }

  // Return true if the slack of a working row is within rounding.
  bool met(int r, const std::int8_t* W, double span) const {
    return std::fabs(w[r]) <= tolerance * (std::fabs(tableau->bound(r, W)) + table->norm[r] * span);
  }

  void gradient(int k) {
    for (int i = 0; i < table->n; ++i) g[i] = 0.0;
    for (int q = 0; q < tableau->extras; ++q) tableau->extra[q].lambda = 0.0;
    const Block& b = table->block[k];
    if (b.A) return add_rows(g, b.A, table->n, b.end - b.begin, 1.0, w + b.begin, 1, table->n);
    for (int r = b.begin; r < b.end; ++r)
      if (w[r] != 0.0) add_row(b, r, w[r]);
  }

  // Multipliers of everything above block k that clear its gradient; mu has the multipliers of the held variables.
  void sweep_above(int k, double* out) {
    for (int r = 0; r < table->block[k].begin; ++r) out[r] = 0.0;
    int q = tableau->extras - 1;
    while (q >= 0 && tableau->extra[q].level > k) --q;
    for (int j = k; j >= 0; --j) {
      if (j < k) sweep(j, out);
      for (; q >= 0 && tableau->extra[q].level == j; --q) sweep_extra(tableau->extra[q], out);
    }
    for (int i = 0; i < table->n; ++i) mu[i] = -g[i];
    for (int q = 0; q < tableau->extras; ++q)
      if (tableau->extra[q].variable >= 0) mu[tableau->extra[q].variable] = tableau->extra[q].lambda;
  }

  // The multipliers of block j that clear its pivot variables from the gradient; the gradient follows.
  void sweep(int j, double* out) {
    const Stage& s = tableau->stage[j];
    const Block& b = table->block[j];
    if (s.kind == Stage::kIdle || s.rank == 0) return;
    if (s.kind == Stage::kGram) gram_multipliers(s, b, out);
    else reflector_multipliers(s, out);
    if (b.A && s.m == b.end - b.begin) return add_rows(g, b.A, table->n, s.m, 1.0, out + b.begin, 1, table->n);
    for (int i = 0; i < s.m; ++i) add_row(b, s.rows[i], out[s.rows[i]]);
  }

  void sweep_extra(Extra& e, double* out) {
    double h = g[e.pivot];
    for (int i = 0; i < e.before; ++i) h -= e.column[i] * g[tableau->base[i]];
    const double f = -h / e.coefficient;
    e.lambda += f;
    if (e.variable >= 0) {
      g[e.variable] += f;
      return;
    }
    out[e.row] = f;
    add_row(table->block_of(e.row), e.row, f);
  }

  // Sweep a second time over the gradient's remainder; the size of the correction estimates the error of the first
  // sweep.
  void refine(int k) {
    const Table& t = *table;
    for (int i = 0; i < t.n; ++i) before[i] = mu[i];
    sweep_above(k, delta);
    for (int r = 0; r < t.block[k].begin; ++r) lambda[r] += delta[r];
  }

 private:
  double faint_ = 0.0, clear_ = 0.0;  // a multiplier between them is doubtful

  void own_signs(int k, const std::int8_t* W, double span, double length) {
    const Block& b = table->block[k];
    const double unclear = larger(kLost, kEither * tolerance * tableau->growth) * length;
    int left = 0;
    for (int q = 0; q < open_rows; ++q) {
      const int r = open[q];
      if (r < b.begin || r >= b.end) {
        open[left++] = r;
        continue;
      }
      const double size = std::fabs(w[r]), rounding = kOnRow * length;
      const bool zero = met(r, W, span) || size <= rounding;
      doubted = doubted || (size > rounding && (zero || size < unclear));
      if (zero) {
        open[left++] = r;
        continue;
      }
      if (w[r] * W[r] < 0.0) to_release[count++] = WrongSign{k, r, false, std::fabs(w[r]) * table->norm[r]};
    }
    open_rows = left;
  }

  // Return true if some sign depends on a multiplier within the rounding of one sweep.
  bool doubtful(int k, double limit, double rounding) const {
    const double small = rounding / kUncertain;
    for (int q = 0; q < open_rows && open[q] < table->block[k].begin; ++q) {
      const double force = std::fabs(lambda[open[q]]) * table->norm[open[q]];
      if (force > limit && force < small) return true;
    }
    for (int q = 0; q < open_variables; ++q) {
      const double force = std::fabs(mu[open_x[q]]);
      if (force > limit && force < small) return true;
    }
    return false;
  }

  void decide(int k, const std::int8_t* W, const std::int8_t* F, double limit, bool refined) {
    const Table& t = *table;
    int left = 0;
    for (int q = 0; q < open_rows; ++q) {
      const int r = open[q];
      if (r >= t.block[k].begin) {
        open[left++] = r;
        continue;
      }
      const double force = std::fabs(lambda[r]) * t.norm[r];
      const double error = refined ? kEither * std::fabs(delta[r]) * t.norm[r] : 0.0;
      doubted = doubted || (force > faint_ && force < larger(clear_, kEither * error));
      if (!(force > limit && force > error)) open[left++] = r;
      else if (lambda[r] * W[r] < 0.0) to_release[count++] = WrongSign{k, r, false, force};
    }
    open_rows = left;
    left = 0;
    for (int q = 0; q < open_variables; ++q) {
      const int i = open_x[q];
      const double force = std::fabs(mu[i]), error = refined ? kEither * std::fabs(mu[i] - before[i]) : 0.0;
      doubted = doubted || (force > faint_ && force < larger(clear_, kEither * error));
      if (!(force > limit && force > error)) open_x[left++] = i;
      else if (mu[i] * F[i] < 0.0) to_release[count++] = WrongSign{k, i, true, force};
    }
    open_variables = left;
  }

  void add_row(const Block& b, int r, double f) {
    if (f == 0.0) return;
    const int i = r - b.begin;
    if (b.A) add_any(g, b.A + static_cast<std::ptrdiff_t>(i) * table->n, f, table->n);
    else g[b.index[i]] += f * b.scale[i];
  }

  // Project onto the orthogonal complement of the level's range: the rest is rounding.
  void project(const Stage& s) {
    for (int i = 0; i < s.m; ++i) y[i] = w[s.rows[i]];
    for (int i = 0; i < s.rank; ++i) s.reflect(i, y);
    for (int i = 0; i < s.rank; ++i) y[i] = 0.0;
    for (int i = s.rank - 1; i >= 0; --i) s.reflect(i, y);
    for (int i = 0; i < s.m; ++i) w[s.rows[i]] = y[i];
  }

  void reflector_multipliers(const Stage& s, double* out) {
    const int r = s.rank;
    for (int i = 0; i < r; ++i) y[i] = g[s.variables[i]];
    for (int i = 0; i < s.before; ++i) {
      const double f = g[tableau->base[i]];
      if (f != 0.0) add_any(y, s.pivots + static_cast<std::ptrdiff_t>(i) * s.ldr, -f, r);
    }
    for (int i = 0; i < r; ++i) {  // R' y = h
      const double* row = s.R + static_cast<std::ptrdiff_t>(i) * s.ldr;
      y[i] /= row[i];
      add_any(y + i + 1, row + i + 1, -y[i], r - i - 1);
    }
    for (int i = r; i < s.m; ++i) y[i] = 0.0;
    for (int i = r - 1; i >= 0; --i) s.reflect(i, y);
    for (int i = 0; i < s.m; ++i) out[s.rows[i]] = -y[i];
  }

  void gram_multipliers(const Stage& s, const Block& b, double* out) {
    Tableau& t = *tableau;
    const int c = t.gram_free;
    for (int j = 0; j < c; ++j) y[j] = g[t.free[j]];
    for (int i = 0; i < t.basic; ++i) {
      const double f = g[t.base[i]];
      if (f != 0.0) add_any(y, t.G + static_cast<std::ptrdiff_t>(i) * t.ld + 1, -f, c);
    }
    GramLevel(t).multiply_inverse(y);
    for (int i = 0; i < s.m; ++i) {
      const int local = s.rows[i] - b.begin, p = t.place[b.index[local]];
      out[s.rows[i]] = p >= 0 ? -b.scale[local] * y[p]
                              : b.scale[local] * dot_any(t.G + static_cast<std::ptrdiff_t>(-1 - p) * t.ld + 1, y, c);
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
