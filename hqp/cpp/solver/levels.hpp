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

  // Solve the levels from `from` on.
  void descend(int from, const std::int8_t* W) {
    for (int k = from; k < t_.table->blocks; ++k) level(k, W);
    for (int i = 0; i < t_.basic; ++i) t_.x[t_.base[i]] = t_.G[static_cast<std::ptrdiff_t>(i) * t_.ld];
    if (t_.gram_free) gram_.solution();
  }

 private:
  // Start with the held variables decided.
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
      if (F[i]) {
        t_.x[i] = t_.fixed_x[i] = F[i] > 0 ? t_.table->hi[i] : t_.table->lo[i];
        t_.any_fixed = t_.any_fixed || t_.fixed_x[i] != 0.0;
      } else {
        t_.place[i] = t_.rest;
        t_.free[t_.rest++] = i;
      }
    }
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
