// Equality-constrained lexicographic least squares, level by level.
#pragma once

#include "gram.hpp"
#include "pivoting.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Levels {
 public:
  explicit Levels(Tableau& tableau) : t_(tableau), pivoting_(tableau), gram_(tableau) {}

  static constexpr double kBias = 3.0;  // bias of pivots towards variables outside the last selection
  static constexpr int kWorth = 6;      // a reduction eliminates at least 1/kWorth of the variables

  // Solve for the working set: W marks rows of the table, F variables held at a bound.
  void factorise(const std::int8_t* W, const std::int8_t* F) {
    begin(F);
    descend(0, W);
  }

  // Prefer as pivots the variables that the last selection does not see: it then needs no factorisation.
  void choose_bias() {
    for (int i = 0; i < t_.n; ++i) t_.preference[i] = 1.0;
    for (int k = t_.table->blocks - 2; k >= 0; --k) {
      const Block& b = t_.table->block[k];
      if (b.A) continue;
      for (int i = 0; i < t_.n; ++i) t_.preference[i] = kBias * kBias;
      for (int i = 0; i < b.end - b.begin; ++i) t_.preference[b.index[i]] = 1.0;
      break;
    }
  }

  // Eliminate the variables without bounds that the equality rows of the top level determine, for every later working
  // set; false where that saves too little. Factorisations are lost, x is kept.
  bool reduce(Table& whole) {
    const Block& b = whole.block[0];
    Stage& s = t_.stage[0];
    if (!b.A) return false;
    begin(nullptr);
    s.m = 0;
    s.before = 0;
    for (int r = b.begin; r < b.end; ++r)
      if (whole.kind[r] == kEquality) s.rows[s.m++] = r;
    if (kWorth * s.m < t_.n) return false;
    pivoting_.form(0, whole.kind);
    for (int i = 0; i < t_.n; ++i)
      if (whole.bounded(i)) t_.preference[i] = 0.0;
    pivoting_.reflect_all(0, kUncertain * b.norm);
    choose_bias();
    if (kWorth * s.rank < t_.n) return false;
    pivoting_.eliminate(0);
    keep_reduction();
    t_.reduction.apply(whole, t_.T + static_cast<std::ptrdiff_t>(s.rank) * t_.ld, s.m - s.rank, t_.ld);
    return true;
  }

  // Solve the levels from `from` on.
  void descend(int from, const std::int8_t* W) {
    const int last = t_.table->blocks - 1;
    t_.solved = t_.lowest < last ? t_.lowest : last - 1;
    for (int k = from; k <= last; ++k) {
      if (k <= t_.solved || k == last) level(k, W);
      else leave_out(k);
    }
    for (int i = 0; i < t_.basic; ++i) t_.x[t_.base[i]] = t_.G[static_cast<std::ptrdiff_t>(i) * t_.ld];
    if (t_.gram_free) gram_.solution();
  }

 private:
  // Start with the held variables and those of the reduction decided; null: no variable is held.
  void begin(const std::int8_t* F) {
    t_.basic = t_.rest = t_.gram_free = t_.extras = t_.newcomers = 0;
    t_.gram_level = -1;
    t_.growth = 1.0;
    t_.closest = kInfinity;
    t_.any_fixed = t_.has_released = t_.cut_by_growth = false;
    for (int k = 0; k < t_.table->blocks; ++k) t_.snapshot[k].valid = false;
    for (int i = 0; i < t_.n; ++i) {
      t_.place[i] = Tableau::kNowhere;
      t_.fixed_x[i] = 0.0;
    }
    for (int i = 0; i < t_.reduction.count; ++i) {
      t_.base[i] = t_.reduction.base[i];
      t_.place[t_.base[i]] = -1 - i;
    }
    for (int i = 0; i < t_.n; ++i) {
      if (t_.place[i] < 0) continue;
      if (F && F[i]) {
        t_.x[i] = t_.fixed_x[i] = F[i] > 0 ? t_.table->hi[i] : t_.table->lo[i];
        t_.any_fixed = t_.any_fixed || t_.fixed_x[i] != 0.0;
      } else {
        t_.place[i] = t_.rest;
        t_.free[t_.rest++] = i;
      }
    }
    if (t_.reduction.count) begin_reduced();
  }

  void begin_reduced() {
    const int width = lanes(t_.rest + 1);
    for (t_.basic = 0; t_.basic < t_.reduction.count; ++t_.basic) {
      const double* from = t_.reduction.row_of_G(t_.basic, t_.n);
      double* g = t_.G + static_cast<std::ptrdiff_t>(t_.basic) * t_.ld;
      g[0] = t_.reduction.c[t_.basic] - (t_.any_fixed ? dot_any(from, t_.fixed_x, t_.n) : 0.0);
      for (int j = 0; j < t_.rest; ++j) g[1 + j] = from[t_.free[j]];
      for (int j = t_.rest + 1; j < width; ++j) g[j] = 0.0;
    }
    t_.growth = t_.reduction.growth;
  }

  // The tableau as it stands as a reduction.
  void keep_reduction() {
    t_.reduction.count = t_.basic;
    t_.reduction.growth = t_.growth;
    for (int i = 0; i < t_.basic; ++i) {
      const double* g = t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld;
      double* to = t_.reduction.G + static_cast<std::ptrdiff_t>(i) * t_.n;
      for (int j = 0; j < t_.n; ++j) to[j] = 0.0;
      for (int j = 0; j < t_.rest; ++j) to[t_.free[j]] = g[1 + j];
      t_.reduction.base[i] = t_.base[i];
      t_.reduction.c[i] = g[0];
    }
  }

  void leave_out(int k) {
    Stage& s = t_.stage[k];
    s.kind = Stage::kIdle;
    s.rank = s.m = 0;
    s.before = t_.basic;
    s.residual = -1.0;
    t_.snapshot[k].valid = false;
  }

  void level(int k, const std::int8_t* W) {
    Stage& s = t_.stage[k];
    const Block& b = t_.table->block[k];
    s.kind = Stage::kIdle;
    s.rank = 0;
    s.before = t_.basic;
    s.residual = 0.0;
    s.m = 0;
    if (t_.recording) record(k);
    if (t_.rest == 0) {
      s.residual = -1.0;
      return;
    }  // nothing left to decide: no freedom left, the residual is final
    for (int r = b.begin; r < b.end; ++r)
      if (W[r] && (b.A || t_.place[b.index[r - b.begin]] != Tableau::kNowhere)) s.rows[s.m++] = r;
    if (s.m == 0) return;
    if (!b.A && gram_.fits(k) && gram_.solve(k, W)) return;
    pivoting_.form(k, W);
    pivoting_.reflect_all(k, t_.zero(k));
    t_.leave_out(k, t_.cut);
    if (s.rank) pivoting_.eliminate(k);
  }

  void record(int k) {
    Snapshot& s = t_.snapshot[k];
    s.valid = t_.rest > 0;
    if (!s.valid) return;
    s.basic = t_.basic;
    s.rest = t_.rest;
    s.extras = t_.extras;
    s.newcomers = t_.newcomers;
    copy_rows(s.G, t_.G, t_.ld, t_.basic, lanes(t_.rest + 1));
    for (int j = 0; j < t_.rest; ++j) s.free[j] = t_.free[j];
  }

  Tableau& t_;
  Pivoting pivoting_;
  GramLevel gram_;
};

}  // namespace HQP_ISA
}  // namespace hqp
