// Equality-constrained lexicographic least squares, level by level.
#pragma once

#include "pivoting.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Levels : Pivoting {
  static constexpr double kBias = 3.0;    // of pivots towards variables that the last selection does not see
  static constexpr double kSound = 1e-6;  // pivots of a reduction are no shorter, relative to the level's longest row
  static constexpr int kWorth = 6;        // a reduction eliminates at least one variable in so many

  // Solve for the working set: W marks rows of the table, F variables held at a bound.
  void factorise(const std::int8_t* W, const std::int8_t* F) {
    begin(F);
    descend(0, W);
  }

  // Prefer as pivots the variables that the last selection does not see: it then needs no factorisation.
  void choose_bias() {
    for (int i = 0; i < n; ++i) preference[i] = 1.0;
    for (int k = table->blocks - 2; k >= 0; --k) {
      const Block& b = table->block[k];
      if (b.A) continue;
      for (int i = 0; i < n; ++i) preference[i] = kBias * kBias;
      for (int i = 0; i < b.end - b.begin; ++i) preference[b.index[i]] = 1.0;
      break;
    }
  }

  // Eliminate what the equality rows of the top level decide of variables without bounds, for every working set to
  // come; false where that saves too little. What was factorised is lost, x is not.
  bool reduce(Table& whole) {
    const Block& b = whole.block[0];
    Stage& s = stage[0];
    if (!b.A) return false;
    begin(nullptr);
    s.m = 0;
    s.before = 0;
    for (int r = b.begin; r < b.end; ++r)
      if (whole.kind[r] == kEquality) s.rows[s.m++] = r;
    if (kWorth * s.m < n) return false;
    form(0, whole.kind);
    for (int i = 0; i < n; ++i)
      if (whole.bounded(i)) preference[i] = 0.0;
    reflect_all(0, kSound * b.norm);
    choose_bias();
    if (kWorth * s.rank < n) return false;
    eliminate(0);
    keep_reduction();
    reduction.apply(whole, T + static_cast<std::ptrdiff_t>(s.rank) * ld, s.m - s.rank, ld);
    return true;
  }

 protected:
  void descend(int from, const std::int8_t* W) {
    const int last = table->blocks - 1;
    solved = lowest < last ? lowest : last - 1;
    for (int k = from; k <= last; ++k) {
      if (k <= solved || k == last) level(k, W);
      else leave_out(k);
    }
    for (int i = 0; i < basic; ++i) x[base[i]] = G[static_cast<std::ptrdiff_t>(i) * ld];
    if (gram_free) solution_of_gram();
  }

  // Directions of a level that are no longer than this count as none.
  double zero(int k) const {
    return larger(larger(rank_tolerance, 1e-14 * growth) * table->block[k].norm, table->block[k].rounding);
  }

  // Nothing but the held variables, and those of the reduction, is decided; null: no variable is held.
  void begin(const std::int8_t* F) {
    basic = rest = gram_free = extras = newcomers = 0;
    gram_level = -1;
    growth = 1.0;
    closest = 1e300;
    any_fixed = has_released = false;
    for (int k = 0; k < table->blocks; ++k) snapshot[k].valid = false;
    for (int i = 0; i < n; ++i) {
      place[i] = kNowhere;
      fixed_x[i] = 0.0;
    }
    for (int i = 0; i < reduction.count; ++i) {
      base[i] = reduction.base[i];
      place[base[i]] = -1 - i;
    }
    for (int i = 0; i < n; ++i) {
      if (place[i] < 0) continue;
      if (F && F[i]) {
        x[i] = fixed_x[i] = F[i] > 0 ? table->hi[i] : table->lo[i];
        any_fixed = any_fixed || fixed_x[i] != 0.0;
      } else {
        place[i] = rest;
        free[rest++] = i;
      }
    }
    if (reduction.count) begin_reduced();
  }

  void begin_reduced() {
    const int width = lanes(rest + 1);
    for (basic = 0; basic < reduction.count; ++basic) {
      const double* from = reduction.row_of_G(basic, n);
      double* g = G + static_cast<std::ptrdiff_t>(basic) * ld;
      g[0] = reduction.c[basic] - (any_fixed ? dot_any(from, fixed_x, n) : 0.0);
      for (int j = 0; j < rest; ++j) g[1 + j] = from[free[j]];
      for (int j = rest + 1; j < width; ++j) g[j] = 0.0;
    }
    growth = reduction.growth;
  }

  // The tableau as it stands as a reduction.
  void keep_reduction() {
    reduction.count = basic;
    reduction.growth = growth;
    for (int i = 0; i < basic; ++i) {
      const double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
      double* to = reduction.G + static_cast<std::ptrdiff_t>(i) * n;
      for (int j = 0; j < n; ++j) to[j] = 0.0;
      for (int j = 0; j < rest; ++j) to[free[j]] = g[1 + j];
      reduction.base[i] = base[i];
      reduction.c[i] = g[0];
    }
  }

  void leave_out(int k) {
    Stage& s = stage[k];
    s.kind = Stage::kIdle;
    s.rank = s.m = 0;
    s.before = basic;
    s.residual = -1.0;
    snapshot[k].valid = false;
  }

  void level(int k, const std::int8_t* W) {
    Stage& s = stage[k];
    const Block& b = table->block[k];
    s.kind = Stage::kIdle;
    s.rank = 0;
    s.before = basic;
    s.residual = 0.0;
    s.m = 0;
    if (recording) record(k);
    if (rest == 0) {
      s.residual = -1.0;
      return;
    }  // nothing left to decide: the residual is what it is
    for (int r = b.begin; r < b.end; ++r)
      if (W[r] && (b.A || place[b.index[r - b.begin]] != kNowhere)) s.rows[s.m++] = r;
    if (s.m == 0) return;
    if (!b.A && gram_fits(k) && by_gram(k, W)) return;
    form(k, W);
    reflect_all(k, zero(k));
    if (s.rank) eliminate(k);
  }

  void record(int k) {
    Snapshot& s = snapshot[k];
    s.valid = rest > 0;
    if (!s.valid) return;
    s.basic = basic;
    s.rest = rest;
    s.extras = extras;
    s.newcomers = newcomers;
    copy_rows(s.G, G, ld, basic, lanes(rest + 1));
    for (int j = 0; j < rest; ++j) s.free[j] = free[j];
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
