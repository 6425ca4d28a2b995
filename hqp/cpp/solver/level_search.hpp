// The search that always ends: one level after the other from a given point, no level rises for one below.
#pragma once

#include <algorithm>

#include "judge.hpp"
#include "level_along_step.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

// At level k the multipliers of the active rows that explain the gradient best (non-negative least squares) are found.
// If something is left of it, that is a direction along which the level falls and no active row is in the way, however
// many meet at x: a degenerate vertex is left by it. Otherwise, and after it, x goes to the lowest point of the level
// where the rows with a multiplier and those met on the way are held. Each such point is lower than the last, so no set
// of rows comes again.
class LevelSearch {
 public:
  int solves = 0;  // subspaces minimised

  LevelSearch(Conditions& conditions, Judge& judge) : at_(conditions), judge_(judge) {}

  void layout(Arena& arena, int n, int rows) {
    arena.place(d_, n);
    arena.place(dv_, n + rows);
    arena.place(kept_, n + rows);
    arena.place(t_, n);
  }

  // Lower every level once from a point.
  void lower_from(const double* from) {
    solves = 0;
    std::copy(from, from + at_.n, at_.x);
    lower_all();
  }

  // Lower level after level from a point, which keeps the box; true if the final point is optimal.
  bool search(const double* from) {
    solves = 0;
    at_.deadline.turn();
    at_.unseen.find(*at_.table);
    for (int i = 0; i < at_.n; ++i) at_.x[i] = from[i];
    for (bool moved = true; moved && !spent();) {
      for (int i = 0; i < at_.n; ++i) t_[i] = at_.x[i];
      lower_all();
      if (at_.deadline.passed()) return false;
      moved = !std::equal(t_, t_ + at_.n, at_.x);  // else the next round is this one again
      for (int i = 0; i < at_.n; ++i) t_[i] = at_.x[i];
      if (judge_.judge(t_)) return true;
    }
    return false;
  }

 private:
  static constexpr int kSolves = 20;  // times variables and rows, of one search
  Conditions& at_;
  Judge& judge_;
  int kept_count_ = 0;
  double *d_ = nullptr, *dv_ = nullptr, *t_ = nullptr;
  int* kept_ = nullptr;

  void lower_all() {
    at_.begin(kAtBound);
    for (int k = 0; k < at_.table->blocks && at_.null_space.freedom(); ++k) {
      double own = at_.gap_of(k);
      if (own > kNoRate) own = lower_level(k, own);
      if (at_.deadline.passed()) break;
      at_.descend(k, kOnRow, own);
    }
  }

  bool spent() { return solves >= kSolves * at_.all || at_.deadline.too_near(1.0); }

  // Lower one level; its gap at the end. A turn that halves the gap, or lowers ||w_k|| by more than could be rounding
  // along a nearly lost direction, is progress.
  double lower_level(int k, double own) {
    double least = kInfinity, nearest = own;
    int stalls = 0;
    while (own > kNoRate && !spent()) {
      kept_count_ = 0;
      for (int a = 0; a < at_.active; ++a)
        if (at_.columns.passive[a]) kept_[kept_count_++] = at_.id[a];
      minimise(k);
      at_.measure();
      at_.find_active();
      const double size = at_.gradient(k);
      own = at_.gap_of(k);
      if (size < least * (1.0 - kNoRate)) {
        least = size;
        stalls = 0;
      } else if (own < 0.5 * nearest) {
        stalls = 0;
      } else if (++stalls > kIdle) {
        break;
      }
      nearest = smaller(nearest, own);
    }
    return own;
  }

  // To the lowest point of the level where the rows kept stay as they are, keeping those that are met on the way.
  void minimise(int k) {
    bool moved = false;
    double least = kInfinity;
    for (int turn = 0; turn < 3 * at_.n + 60 && !spent(); ++turn, ++solves) {
      int blocking = -1;
      if (!direction(k)) return;
      double alpha = step(k, blocking);
      if (blocking >= 0 && !(alpha > 0.0)) {
        if (!moved && steepest(k)) {
          alpha = step(k, blocking);
          if (!(alpha > 0.0)) return;  // rounding alone
        } else {
          keep(blocking);
          continue;
        }
      }
      const bool same = move(k, alpha, blocking);
      moved = true;
      if (blocking >= 0) {
        keep(blocking);
        continue;
      }
      const double here = size_of(k);
      if ((alpha >= 1.0 && same) || !(here < least * (1.0 - kNoStep))) return;  // a free step that lowers nothing
      least = here;
    }
  }

  double size_of(int k) const {
    const Block& b = at_.table->block[k];
    double square = 0.0;
    for (int r = b.begin; r < b.end; ++r) square += at_.w[r - b.begin] * at_.w[r - b.begin];
    return std::sqrt(square);
  }

  void keep(int q) {
    at_.projected(q);
    kept_[kept_count_++] = q;
  }

  // Down the gradient with the active rows' part taken away, as far as the level's rows that miss now would have it.
  bool steepest(int k) {
    for (int i = 0; i < at_.null_space.rank; ++i) d_[i] = 0.0;
    for (int i = at_.null_space.rank; i < at_.n; ++i) d_[i] = at_.columns.rest[i - at_.null_space.rank];
    at_.null_space.lift(d_);
    at_.table->product(d_, dv_ + at_.n);
    const Block& b = at_.table->block[k];
    double slope = 0.0, curvature = 0.0;
    for (int r = b.begin; r < b.end; ++r) {
      const double w = at_.w[r - b.begin], c = dv_[at_.n + r];
      slope += w * c;
      if (w != 0.0) curvature += c * c;
    }
    if (!(slope < 0.0) || !(curvature > 0.0)) return false;
    const double f = -slope / curvature;
    for (int i = 0; i < at_.n; ++i) d_[i] *= f;
    return true;
  }

  // d: least squares over the rows of the level that miss or are equalities, in the null space of fixed and kept rows.
  bool direction(int k) {
    const int base = at_.null_space.rank, m = at_.set_face(k, kept_, kept_count_), f = at_.null_space.freedom();
    const double reach = f ? at_.reduced.solve(m, f, larger(kSeen, kNoStep / at_.shortest)) : 0.0;
    for (int i = 0; i < at_.null_space.rank; ++i) d_[i] = 0.0;
    for (int j = 0; j < f; ++j) d_[at_.null_space.rank + j] = at_.reduced.z[j];
    at_.null_space.lift(d_);
    at_.null_space.rank = base;
    double most = 0.0;
    for (int i = 0; i < m; ++i) most = larger(most, at_.extent(k, at_.order[i]));
    return reach > kNoStep * most;
  }

  // Step length along d, at most 1: the open row that blocks, or where the level is lowest (blocking = -1).
  double step(int k, int& blocking) {
    const Table& t = *at_.table;
    t.product(d_, dv_ + at_.n);
    double length = 0.0;
    for (int i = 0; i < at_.n; ++i) {
      dv_[i] = d_[i];
      length += d_[i] * d_[i];
    }
    length = std::sqrt(length);
    double most = 1.0;
    for (int a = 0; a < at_.candidates(); ++a) {  // Harris: the bounds a little wider first
      const int q = at_.candidate(a);
      if (!towards(q, length)) continue;
      const double bound = dv_[q] > 0.0 ? at_.upper(q) : at_.lower(q),
                   room = (dv_[q] > 0.0 ? bound - at_.v[q] : at_.v[q] - bound) + margin(q);
      if (room < most * std::fabs(dv_[q])) most = larger(room, 0.0) / std::fabs(dv_[q]);
    }
    blocking = -1;
    double alpha = 1.0, steepest = 0.0;
    if (most < 1.0)
      for (int a = 0; a < at_.candidates(); ++a) {
        const int q = at_.candidate(a);
        if (!towards(q, length)) continue;
        const double bound = dv_[q] > 0.0 ? at_.upper(q) : at_.lower(q),
                     room = dv_[q] > 0.0 ? bound - at_.v[q] : at_.v[q] - bound;
        const double slope = std::fabs(dv_[q]);
        if (!(room <= most * slope) || slope <= steepest * at_.norm(q)) continue;
        steepest = slope / at_.norm(q);
        blocking = q;
        alpha = larger(room, 0.0) / slope;
      }
    const double bottom = LevelAlongStep{t, t.block[k], at_.v + at_.n, dv_ + at_.n}.lowest(alpha, kOnRow);
    if (bottom < alpha) blocking = -1;
    return bottom;
  }

  double margin(int q) const { return kOnRow * (at_.norm(q) + at_.terms[q]); }

  // Return true if d takes an open row that is not kept nearer to one of its bounds.
  bool towards(int q, double length) const {
    if (at_.state[q] != Conditions::kOpen || !(std::fabs(dv_[q]) > kOnRow * at_.norm(q) * length)) return false;
    if (!(std::fabs(dv_[q] > 0.0 ? at_.upper(q) : at_.lower(q)) < kInfinity)) return false;
    for (int i = 0; i < kept_count_; ++i)
      if (kept_[i] == q) return false;
    return true;
  }

  // Go there; return true if the violated rows of the level are unchanged.
  bool move(int k, double alpha, int blocking) {
    const Table& t = *at_.table;
    for (int i = 0; i < at_.n; ++i) {
      at_.x[i] += alpha * d_[i];
      if (at_.x[i] < t.lo[i]) at_.x[i] = t.lo[i];
      if (at_.x[i] > t.hi[i]) at_.x[i] = t.hi[i];
    }
    if (blocking >= 0 && blocking < at_.n) at_.x[blocking] = dv_[blocking] > 0.0 ? t.hi[blocking] : t.lo[blocking];
    at_.measure();
    const Block& b = t.block[k];
    bool same = true;
    for (int r = b.begin; r < b.end; ++r)
      if (t.kind[r] == kUpper) same = same && (at_.w[r - b.begin] != 0.0) == (t.beyond(r, at_.v[at_.n + r]) != 0.0);
    at_.gradient(k);
    return same;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
