// The search that always ends: one level after the other from a given point, no level rises for one below.
#pragma once

#include "judge.hpp"
#include "level_along_step.hpp"

namespace hqp {
inline namespace HQP_ISA {

// At level k the multipliers of the active rows that explain the gradient best (non-negative least squares) are found.
// If something is left of it, that is a direction along which the level falls and no active row is in the way, however
// many meet at x: a degenerate vertex is left by it. Otherwise, and after it, x goes to the lowest point of the level
// where the rows with a multiplier and those met on the way are held. Each such point is lower than the last, so no set
// of rows comes again.
class LevelSearch : public Judge {
 public:
  int solves = 0;  // subspaces minimised

  void layout(Arena& arena, int n, int rows, int most, int blocks) {
    Judge::layout(arena, n, rows, most, blocks);
    const std::size_t wide = static_cast<std::size_t>(padded(n + 1));
    wide_ = static_cast<int>(wide);
    arena.place(B_, (most + 1) * wide);
    arena.place(rhs_, most + 1);
    arena.place(length_, most + 1);
    arena.place(order_, most + 1);
    arena.place(column_, n + 1);
    arena.place(size_, wide);
    arena.place(mix_, wide);
    arena.place(z_, n + 1);
    arena.place(d_, n);
    arena.place(dv_, n + rows);
    arena.place(kept_, n + rows);
    arena.place(t_, n);
  }

  // Lower level after level from x, which keeps the box; true if what is reached is optimal.
  bool search(const double* from) {
    solves = 0;
    deadline.turn();
    unseen.find(*table_);
    for (int i = 0; i < n_; ++i) x[i] = from[i];
    for (int turn = 0; turn < kPasses; ++turn) {
      const bool moved = lower_all();
      if (deadline.passed()) return false;
      for (int i = 0; i < n_; ++i) t_[i] = x[i];
      if (judge(t_)) return true;
      if (!moved) return false;
    }
    return false;
  }

 private:
  static constexpr int kPasses = 4;         // over all levels
  static constexpr int kTurns = 400;        // non-negative least squares a level
  static constexpr int kIdle = 3;           // of them without progress end a level whose gap passes,
  static constexpr int kLast = 16;          // and so many any level
  static constexpr double kGain = 1e-10;    // of ||w_k||: progress
  static constexpr double kStill = 1e-14;   // of ||w_k||: rounding
  static constexpr int kSolves = 20;        // times variables and rows, of one search
  static constexpr double kGoal = 1e-12;    // gap of a level that is not worth lowering
  static constexpr double kActive = 1e-10;  // activity, relative to the row's terms
  static constexpr double kFlat =
      1e-9;  // a row whose rest is no longer than this, relative, adds no direction to its level
  int wide_ = 0, kept_count_ = 0;
  double *B_ = nullptr, *rhs_ = nullptr, *length_ = nullptr, *size_ = nullptr, *mix_ = nullptr, *z_ = nullptr,
         *d_ = nullptr, *dv_ = nullptr, *t_ = nullptr;
  int *order_ = nullptr, *column_ = nullptr, *kept_ = nullptr;

  double* row(int i) { return B_ + static_cast<std::ptrdiff_t>(i) * wide_; }

  bool lower_all() {
    slop_ = kActive;
    begin();
    bool moved = false;
    for (int k = 0; k < table_->blocks && null_.freedom(); ++k) {
      double own = gap_of(k);
      if (own > kGoal) {
        own = lower_level(k, own);
        moved = true;
      }
      if (deadline.passed()) break;
      descend(k, kLeastLock, own);
    }
    return moved;
  }

  bool spent() { return solves >= kSolves * all_ || deadline.too_near(1.0); }

  // Lower one level; its gap at the end. A turn that halves the gap, or lowers ||w_k|| by more than could be rounding
  // along a nearly lost direction, is progress.
  double lower_level(int k, double own) {
    double least = kInfinity, nearest = own;
    int stalls = 0;
    for (int turn = 0; turn < kTurns && own > kGoal && !spent(); ++turn) {
      kept_count_ = 0;
      for (int a = 0; a < active_; ++a)
        if (columns_.passive[a]) kept_[kept_count_++] = id_[a];
      minimise(k);
      measure();
      find_active();
      const double size = gradient(k);
      own = gap_of(k);
      if (size < least * (1.0 - kGain)) {
        least = size;
        stalls = 0;
      } else if (own < 0.5 * nearest) {
        stalls = 0;
      } else if (++stalls > (own > allowed() ? kLast : kIdle)) {
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
    for (int turn = 0; turn < 3 * n_ + 60 && !spent(); ++turn, ++solves) {
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
      if ((alpha >= 1.0 && same) || !(here < least * (1.0 - kStill))) return;  // a free step that lowers nothing
      least = here;
    }
  }

  double size_of(int k) const {
    const Block& b = table_->block[k];
    double square = 0.0;
    for (int r = b.begin; r < b.end; ++r) square += w_[r - b.begin] * w_[r - b.begin];
    return std::sqrt(square);
  }

  void keep(int q) {
    projected(q);
    kept_[kept_count_++] = q;
  }

  // Down the gradient with the active rows' part taken away, as far as the level's rows that miss now would have it.
  bool steepest(int k) {
    for (int i = 0; i < null_.rank; ++i) d_[i] = 0.0;
    for (int i = null_.rank; i < n_; ++i) d_[i] = columns_.rest[i - null_.rank];
    null_.lift(d_);
    table_->product(d_, dv_ + n_);
    const Block& b = table_->block[k];
    double slope = 0.0, curvature = 0.0;
    for (int r = b.begin; r < b.end; ++r) {
      const double w = w_[r - b.begin], c = dv_[n_ + r];
      slope += w * c;
      if (w != 0.0) curvature += c * c;
    }
    if (!(slope < 0.0) || !(curvature > 0.0)) return false;
    const double f = -slope / curvature;
    for (int i = 0; i < n_; ++i) d_[i] *= f;
    return true;
  }

  // d: least squares over the rows of the level that miss or are equalities, in the null space of fixed and kept rows.
  bool direction(int k) {
    const Table& t = *table_;
    const Block& b = t.block[k];
    const int base = null_.rank;
    int m = 0;
    double most = 0.0;
    for (int r = b.begin; r < b.end; ++r) {
      if (t.kind[r] == kFree) continue;
      if (t.kind[r] != kEquality && w_[r - b.begin] == 0.0) continue;
      projected(n_ + r);
      most = larger(most, std::fabs(w_[r - b.begin]) + terms_[n_ + r]);
      order_[m++] = r;
    }
    for (int i = 0; i < kept_count_; ++i) projected(kept_[i]);
    for (int i = 0; i < kept_count_ && null_.freedom(); ++i) {
      const double* from = row_ + static_cast<std::ptrdiff_t>(kept_[i]) * ld_;
      for (int j = 0; j < n_; ++j) t_[j] = from[j];
      null_.project(t_, base);
      const double length = null_.length(t_);
      if (length > kRank) null_.add(t_, length);
    }
    const int f = null_.freedom();
    sort_by_length(m);
    for (int i = 0; i < m; ++i) {
      const int r = order_[i];
      const double* from = row_ + static_cast<std::ptrdiff_t>(n_ + r) * ld_;
      for (int j = 0; j < n_; ++j) t_[j] = from[j];
      null_.project(t_, base);
      double* to = row(i);
      length_[i] = t.norm[r];
      for (int j = 0; j < f; ++j) to[j] = length_[i] * t_[null_.rank + j];
      rhs_[i] = -w_[r - b.begin];
    }
    const double reach = f ? least_squares(m, f) : 0.0;
    for (int i = 0; i < null_.rank; ++i) d_[i] = 0.0;
    for (int j = 0; j < f; ++j) d_[null_.rank + j] = z_[j];
    null_.lift(d_);
    null_.rank = base;
    return reach > 1e-14 * most;
  }

  void sort_by_length(int m) {  // insertion: most levels have rows of similar length in order
    for (int i = 1; i < m; ++i) {
      const int r = order_[i];
      int j = i;
      for (; j > 0 && table_->norm[order_[j - 1]] < table_->norm[r]; --j) order_[j] = order_[j - 1];
      order_[j] = r;
    }
  }

  // min || B z - rhs ||, rows sorted by length: Householder with column pivoting (row-wise stable: Cox and Higham
  // 1998). A row of which less than kFlat is left adds no direction. Returns the length of what B z takes away of rhs.
  double least_squares(int m, int f) {
    for (int j = 0; j < f; ++j) column_[j] = j;
    const double flat = larger(kFlat, 1e-14 / shortest_);
    int rank = 0;
    double reach = 0.0;
    while (rank < m && rank < f) {
      for (int i = rank; i < m;) {
        double most = 0.0;
        for (int j = rank; j < f; ++j) most = larger(most, std::fabs(row(i)[j]));
        if (most > flat * length_[i]) {
          ++i;
          continue;
        }
        --m;
        for (int q = i; q < m; ++q) {  // the others keep their order
          for (int j = 0; j < f; ++j) row(q)[j] = row(q + 1)[j];
          rhs_[q] = rhs_[q + 1];
          length_[q] = length_[q + 1];
        }
      }
      if (rank == m) break;
      for (int j = rank; j < f; ++j) size_[j] = 0.0;
      for (int i = rank; i < m; ++i)
        for (int j = rank; j < f; ++j) size_[j] += row(i)[j] * row(i)[j];
      int p = rank;
      for (int j = rank + 1; j < f; ++j)
        if (size_[j] > size_[p]) p = j;
      if (p != rank) {
        for (int i = 0; i < m; ++i) {
          const double s = row(i)[p];
          row(i)[p] = row(i)[rank];
          row(i)[rank] = s;
        }
        const int s = column_[p];
        column_[p] = column_[rank];
        column_[rank] = s;
      }
      reflect_column(rank, m, f);
      reach += rhs_[rank] * rhs_[rank];
      ++rank;
    }
    for (int j = 0; j < f; ++j) z_[j] = 0.0;
    for (int i = rank - 1; i >= 0; --i) {
      double s = rhs_[i];
      for (int j = i + 1; j < rank; ++j) s -= row(i)[j] * z_[column_[j]];
      z_[column_[i]] = s / row(i)[i];
    }
    return std::sqrt(reach);
  }

  void reflect_column(int c, int m, int f) {
    double square = 0.0;
    for (int i = c; i < m; ++i) square += row(i)[c] * row(i)[c];
    const double length = std::sqrt(square), alpha = row(c)[c], beta = alpha > 0.0 ? -length : length;
    const double first = alpha - beta, tau = 1.0 / (length * std::fabs(first));
    for (int j = c + 1; j < f; ++j) mix_[j] = 0.0;
    double along = 0.0;
    for (int i = c; i < m; ++i) {
      const double v = i == c ? first : row(i)[c];
      for (int j = c + 1; j < f; ++j) mix_[j] += v * row(i)[j];
      along += v * rhs_[i];
    }
    for (int i = c; i < m; ++i) {
      const double v = tau * (i == c ? first : row(i)[c]);
      for (int j = c + 1; j < f; ++j) row(i)[j] -= v * mix_[j];
      rhs_[i] -= v * along;
    }
    row(c)[c] = beta;
    for (int i = c + 1; i < m; ++i) row(i)[c] = 0.0;
  }

  // How far along d, at most 1: the open row that blocks, or where the level is lowest (blocking = -1).
  double step(int k, int& blocking) {
    const Table& t = *table_;
    t.product(d_, dv_ + n_);
    double length = 0.0;
    for (int i = 0; i < n_; ++i) {
      dv_[i] = d_[i];
      length += d_[i] * d_[i];
    }
    length = std::sqrt(length);
    double most = 1.0;
    for (int a = 0; a < open_count_; ++a) {  // Harris: the bounds a little wider first
      const int q = open_[a];
      if (!towards(q, length)) continue;
      const double bound = dv_[q] > 0.0 ? upper(q) : lower(q),
                   room = (dv_[q] > 0.0 ? bound - v_[q] : v_[q] - bound) + margin(q);
      if (room < most * std::fabs(dv_[q])) most = larger(room, 0.0) / std::fabs(dv_[q]);
    }
    blocking = -1;
    double alpha = 1.0, steepest = 0.0;
    if (most < 1.0)
      for (int a = 0; a < open_count_; ++a) {
        const int q = open_[a];
        if (!towards(q, length)) continue;
        const double bound = dv_[q] > 0.0 ? upper(q) : lower(q), room = dv_[q] > 0.0 ? bound - v_[q] : v_[q] - bound;
        const double slope = std::fabs(dv_[q]);
        if (!(room <= most * slope) || slope <= steepest * norm(q)) continue;
        steepest = slope / norm(q);
        blocking = q;
        alpha = larger(room, 0.0) / slope;
      }
    const double bottom = LevelAlongStep{t, t.block[k], v_ + n_, dv_ + n_}.lowest(alpha, 1e-13);
    if (bottom < alpha) blocking = -1;
    return bottom;
  }

  double margin(int q) const { return 1e-13 * (norm(q) + terms_[q]); }

  // Whether d takes an open row that is not kept nearer to a bound it has.
  bool towards(int q, double length) const {
    if (state_[q] != kOpen || !(std::fabs(dv_[q]) > 1e-13 * norm(q) * length)) return false;
    if (!(std::fabs(dv_[q] > 0.0 ? upper(q) : lower(q)) < kInfinity)) return false;
    for (int i = 0; i < kept_count_; ++i)
      if (kept_[i] == q) return false;
    return true;
  }

  // Go there; whether the same rows of the level miss afterwards.
  bool move(int k, double alpha, int blocking) {
    const Table& t = *table_;
    for (int i = 0; i < n_; ++i) {
      x[i] += alpha * d_[i];
      if (x[i] < t.lo[i]) x[i] = t.lo[i];
      if (x[i] > t.hi[i]) x[i] = t.hi[i];
    }
    if (blocking >= 0 && blocking < n_) x[blocking] = dv_[blocking] > 0.0 ? t.hi[blocking] : t.lo[blocking];
    measure();
    const Block& b = t.block[k];
    bool same = true;
    for (int r = b.begin; r < b.end; ++r)
      if (t.kind[r] == kUpper) same = same && (w_[r - b.begin] != 0.0) == (t.beyond(r, v_[n_ + r]) != 0.0);
    gradient(k);
    return same;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
