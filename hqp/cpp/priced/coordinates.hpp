// x = still + P y with E(x) = |y|^2 / 2: y is the motion away from the point of least motion.  If F has a null space,
// F = Q [T 0] Z' with T (rank, rank) triangular and Z orthogonal: coordinates from rank on span the null space, at
// almost no cost.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "../solver/dense.hpp"
#include "../solver/tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Coordinates {
 public:
  // flat: a direction whose motion is below this fraction of the largest column of F has none.  free: its cost,
  // relative to the least pivot of T; by_row: flat is relative to each row of F, whose lengths may differ much.
  Coordinates(int n, double flat, double free = kFreeShare, bool by_row = false)
      : n_(n),
        ld_(padded(n)),
        rank_(n),
        flat_(flat),
        share_(free),
        by_row_(by_row),
        still_(n, 0.0),
        inverse_(n, 1.0),
        unit_(n, 1.0),
        flat_at_(n, 0) {
    const std::size_t all = static_cast<std::size_t>(n);
    for (auto* part : {&y_, &square_, &work_}) part->reserve(ld_);
    order_.reserve(all);
    T_.reserve(all * ld_);
    Z_.reserve((all + 1) * (all + 1) / 4 + all + 1);
  }

  // Reserve memory for r rows of F.
  void reserve(int r) {
    columns_.reserve(static_cast<std::size_t>(n_ + 1) * padded(r));
    rows_.reserve(r);
  }

  // F: (r, n), or its diagonal if r = 0, or null for the identity; f: (r), (n) for a diagonal, or null.
  // near: with by_row_, longest step along a direction that may meet the remaining f, 0 for any length; clear: a
  // direction of which more remains may meet it by any step.
  void set(const double* F, const double* f, int r, double near = 0.0, double clear = 0.0) {
    diagonal_ = r == 0;
    uncertain_ = false;
    flat_error_ = 0.0;
    near_ = near;
    clear_ = clear;
    if (!diagonal_) return factor(F, f, r, nullptr);
    rank_ = n_;
    double least = INFINITY;
    for (int i = 0; i < n_ && F; ++i)
      if (F[i] != 0.0) least = smaller(least, std::abs(F[i]));
    free_ = share_ * (least < INFINITY ? least : 1.0);
    for (int i = 0; i < n_; ++i) {
      const bool flat = F && F[i] == 0.0;
      const double size = flat ? free_ : F ? F[i] : 1.0;
      rank_ -= flat_at_[i] = flat;
      if (inverse_[i] != size) unit_[i] = 1.0 / (inverse_[i] = size);
      still_[i] = f && !flat ? f[i] * unit_[i] : 0.0;
    }
  }

  // Set rows more_j F_j; `base`, the coordinates of F itself, has the directions without motion.
  void set(const Coordinates& base, const double* F, const double* f, int r) {
    near_ = 0.0;
    factor(F, f, r, &base);
  }

  // Length in x of a unit of each coordinate, (n,).
  void grade(double* worth) const {
    for (int i = 0; i < n_; ++i)
      worth[i] = diagonal_   ? std::fabs(inverse_[i])
                 : i < rank_ ? std::fabs(T_[static_cast<std::size_t>(i) * ld_ + i])
                             : free_;
  }
  // Return true if coordinate j is motion.
  bool moves(int j) const { return diagonal_ ? !flat_at_[j] : j < rank_; }
  // Return true with by_row if little of all rows remained along a direction that counts: rows may see less of
  // directions without motion than those have of error.
  bool uncertain() const { return uncertain_; }

  // Use n variables, at most as many as at first.
  void resize(int n) {
    n_ = n;
    still_.resize(n);
  }

  // Set the rounding length in x: a row with no more in a direction without motion has no part in it.
  void rounding(double length) { rounding_ = length; }

  const double* still() const { return still_.data(); }
  bool diagonal() const { return diagonal_; }
  int rank() const { return rank_; }

  // The entry of a row that picks x_i, for a diagonal E.
  double picked(int i, double scale) const { return scale * unit_[i]; }

  // b (n, in whole vectors) = a P for a row a of x.
  void row(const double* a, double* b) const {
    if (diagonal_) return multiply_any(b, a, unit_.data(), n_);
    for (int i = 0; i < n_; ++i) b[i] = a[order_[i]];
    for (int i = rank_ - 1; i >= 0; --i) turn(i, b);
    for (int j = 0; j < rank_; ++j) {
      if (b[j] == 0.0) continue;
      const double* T = &T_[static_cast<std::size_t>(j) * ld_];
      const double f = b[j] / T[j];
      add_any(b + j + 1, T + j + 1, -f, rank_ - j - 1);
      b[j] = f;
    }
    const double length = flat_error_ > 0.0 && rank_ < n_ ? std::sqrt(dot_any(a, a, n_)) : 0.0;
    const double least = larger(rounding_, flat_error_ * length);
    for (int i = rank_; i < n_; ++i) b[i] = std::fabs(b[i]) <= least ? 0.0 : b[i] / free_;
  }

  // Write an orthonormal basis of the directions of motion, or of the others, (count, n); return the count.
  int basis(bool motion, double* rows) const {
    int count = 0;
    for (int j = 0; j < n_; ++j) {
      if (moves(j) != motion) continue;
      double* a = rows + static_cast<std::size_t>(count++) * n_;
      std::fill(a, a + n_, 0.0);
      a[j] = 1.0;
      if (diagonal_) continue;
      work_.assign(a, a + n_);
      for (int i = 0; i < rank_; ++i) turn(i, work_.data());
      for (int i = 0; i < n_; ++i) a[order_[i]] = work_[i];
    }
    return count;
  }

  // b (n, zeros) = the row that picks x_i, like row().
  void picked_row(int i, double scale, double* b) const {
    if (diagonal_) {
      b[i] = picked(i, scale);
      return;
    }
    work_.assign(n_, 0.0);
    work_[i] = scale;
    row(work_.data(), b);
  }

  // |A P - B|^2 over all entries of m rows, for a diagonal E.
  double apart(const double* A, const double* B, int m) const {
    const double* unit = unit_.data();
    const auto off = [unit](const double* a, const double* b, int j) -> Vec4 {
      return unaligned(a + j) * unaligned(unit + j) - unaligned(b + j);
    };
    Vec4 one = splat(0.0), other = one;
    double rest = 0.0;
    for (; m > 0; --m, A += n_, B += n_) {
      int j = 0;
      for (; j + 2 * kLane <= n_; j += 2 * kLane) {
        const Vec4 a = off(A, B, j), b = off(A, B, j + kLane);
        one += a * a;
        other += b * b;
      }
      for (; j < n_; ++j) rest += (A[j] * unit[j] - B[j]) * (A[j] * unit[j] - B[j]);
    }
    return sum(one + other) + rest;
  }

  void motion(const double* x, double* y) const {
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) y[i] = (x[i] - still_[i]) * inverse_[i];
      return;
    }
    for (int i = 0; i < n_; ++i) y[i] = x[order_[i]] - still_[order_[i]];
    for (int i = rank_ - 1; i >= 0; --i) turn(i, y);
    for (int i = 0; i < rank_; ++i) y[i] = dot_any(&T_[static_cast<std::size_t>(i) * ld_ + i], y + i, rank_ - i);
    for (int i = rank_; i < n_; ++i) y[i] *= free_;
  }

  // x (n) = P y.
  void step(const double* y, double* x) const {
    if (diagonal_) return multiply_any(x, y, unit_.data(), n_);
    work_.assign(y, y + n_);
    for (int i = rank_ - 1; i >= 0; --i) {
      const double* T = &T_[static_cast<std::size_t>(i) * ld_];
      work_[i] = (work_[i] - dot_any(T + i + 1, work_.data() + i + 1, rank_ - i - 1)) / T[i];
    }
    for (int i = rank_; i < n_; ++i) work_[i] /= free_;
    for (int i = 0; i < rank_; ++i) turn(i, work_.data());
    for (int i = 0; i < n_; ++i) x[order_[i]] = work_[i];
  }

  void point(const double* y, double* x) const {
    step(y, x);
    for (int i = 0; i < n_; ++i) x[i] += still_[i];
  }

  // The gradient, in x, of the part of directions without motion in |y|^2 / 2.  A row in coordinates has its length
  // along them here.
  double flat_pull(const double* y) const {
    double square = 0.0;
    for (int i = 0; i < n_; ++i)
      if (!moves(i)) square += y[i] * y[i];
    return std::sqrt(square) * free_;
  }

  // Move the origin of directions without motion to y (n), and y with it.
  void count_flat_from(double* y) {
    y_.assign(ld_, 0.0);
    for (int i = 0; i < n_; ++i)
      if (!moves(i)) std::swap(y_[i], y[i]);
    step(y_.data(), y_.data());
    for (int i = 0; i < n_; ++i) still_[i] += y_[i];
  }

 private:
  // Apply the i-th reflection of Z, on entries i and rank to n.
  void turn(int i, double* b) const {
    const int free = n_ - rank_;
    if (free == 0) return;
    const double* v = &Z_[static_cast<std::size_t>(i) * (free + 1)];
    const double s = v[free] * (b[i] + dot_any(v, b + rank_, free));
    b[i] -= s;
    add_any(b + rank_, v, -s, free);
  }

  // Reflect columns k to `count` so that column k is zero below row k; the pivot stands there already.
  void reflect_from(int k, int count, int width, int r) {
    double* v = &columns_[static_cast<std::size_t>(k) * width];
    const double length = std::sqrt(dot_any(v + k, v + k, r - k));
    if (length == 0.0) return;
    const double pivot = v[k] > 0.0 ? -length : length;
    v[k] -= pivot;
    const double scale = -1.0 / (pivot * v[k]);
    for (int j = k + 1; j < count; ++j) {
      double* c = &columns_[static_cast<std::size_t>(j) * width];
      add_any(c + k, v + k, -scale * dot_any(v + k, c + k, r - k), r - k);
    }
    v[k] = pivot;
    std::fill(v + k + 1, v + r, 0.0);
  }

  // Reflect with columns in order of their remainders, or in the order of `base`, then from the right for entries
  // beyond the rank.
  void factor(const double* F, const double* f, int r, const Coordinates* base) {
    const int width = padded(r);
    diagonal_ = false;
    columns_.assign(static_cast<std::size_t>(n_ + 1) * width, 0.0);
    order_.resize(n_);
    for (int j = 0; j < n_; ++j) order_[j] = base ? base->order_[j] : j;
    sort_rows(F, r);
    for (int to = 0; to < r; ++to) {
      const int i = rows_[to].second;
      double* column = &columns_[to];
      for (int j = 0; j < n_; ++j)
        column[static_cast<std::size_t>(j) * width] = F[static_cast<std::size_t>(i) * n_ + order_[j]];
      if (f) column[static_cast<std::size_t>(n_) * width] = f[i];
    }
    double pivot = 1.0;
    least_ = 0.0;
    if (!base) square_.resize(n_);
    for (int j = 0; j < n_ && !base; ++j) {
      const double* c = &columns_[static_cast<std::size_t>(j) * width];
      square_[j] = dot_any(c, c, r);
    }
    for (rank_ = 0; rank_ < (base ? base->rank_ : std::min(n_, r)); ++rank_) {
      if (!base) {
        const int best = best_column(width, r);
        if (best < 0) break;
        if (best != rank_) {
          double* to = &columns_[static_cast<std::size_t>(rank_) * width];
          std::swap_ranges(to, to + r, &columns_[static_cast<std::size_t>(best) * width]);
          std::swap(order_[rank_], order_[best]);
          std::swap(square_[rank_], square_[best]);
        }
      }
      reflect_from(rank_, n_ + 1, width, r);
      pivot = smaller(rank_ ? pivot : INFINITY, std::fabs(columns_[static_cast<std::size_t>(rank_) * width + rank_]));
      for (int j = rank_ + 1; j < n_ && !base; ++j) {
        const double gone = columns_[static_cast<std::size_t>(j) * width + rank_];
        square_[j] -= gone * gone;
      }
    }
    free_ = base ? base->free_ : share_ * pivot;
    triangle(width);
    still_.assign(n_, 0.0);
    y_.assign(ld_, 0.0);
    for (int i = 0; i < rank_; ++i) y_[i] = columns_[static_cast<std::size_t>(n_) * width + i];
    step(y_.data(), still_.data());
  }

  // Rows from the longest to the shortest, so that each keeps its own rounding (Cox and Higham 1998).
  void sort_rows(const double* F, int r) {
    rows_.resize(r);
    for (int i = 0; i < r; ++i) {
      const double* a = F + static_cast<std::size_t>(i) * n_;
      rows_[i] = {-dot_any(a, a, n_), i};
    }
    std::sort(rows_.begin(), rows_.end());
  }

  // The column with the largest remainder below row rank_, -1 without one; a remainder is computed anew if it was
  // subtracted from a much larger number.
  int best_column(int width, int r) {
    int best = rank_;
    for (int j = rank_; j < n_; ++j)
      if (square_[j] > square_[best]) best = j;
    if (rank_ % 8 == 0 || !(square_[best] > kLost * last_)) {
      for (int j = rank_; j < n_; ++j) {
        const double* c = &columns_[static_cast<std::size_t>(j) * width];
        square_[j] = dot_any(c + rank_, c + rank_, r - rank_);
        if (square_[j] > square_[best]) best = j;
      }
      last_ = square_[best];
    }
    if (rank_ == 0 && !by_row_) least_ = flat_ * flat_ * last_;
    double share = seen(best, width, r);
    for (int j = rank_; j < n_ && by_row_ && share == 0.0; ++j) share = seen(best = j, width, r);
    if (share == 0.0) return -1;
    if (by_row_) {
      uncertain_ = uncertain_ || share < kUncertain;
      flat_error_ = larger(flat_error_, kRounding / share);
    }
    return best;
  }

  // The remainder of a column, as the largest share of a row's length by_row_, else of its own; zero if it is rounding,
  // relative to the longest column or (by_row_) to each row, or if it is not clear and no step within near_ meets the
  // remaining f.
  double seen(int j, int width, int r) const {
    const double* c = &columns_[static_cast<std::size_t>(j) * width];
    const double left = dot_any(c + rank_, c + rank_, r - rank_);
    if (!by_row_) return left > least_ ? 1.0 : 0.0;
    if (near_ > 0.0 && !(left > clear_ * clear_)) {
      const double* f = &columns_[static_cast<std::size_t>(n_) * width];
      if (!(near_ * near_ * left > dot_any(f + rank_, f + rank_, r - rank_))) return 0.0;
    }
    double most = 0.0;
    for (int i = rank_; i < r; ++i)
      if (c[i] * c[i] > most * -rows_[i].first) most = c[i] * c[i] / -rows_[i].first;
    return most > flat_ * flat_ ? std::sqrt(most) : 0.0;
  }

  // Compute T and Z: reflections clear the entries beyond the rank, last row first.
  void triangle(int width) {
    const int free = n_ - rank_;
    T_.assign(static_cast<std::size_t>(n_) * ld_, 0.0);
    Z_.assign(static_cast<std::size_t>(rank_) * (free + 1) + 1, 0.0);
    for (int i = 0; i < rank_; ++i)
      for (int j = i; j < n_; ++j)
        T_[static_cast<std::size_t>(i) * ld_ + j] = columns_[static_cast<std::size_t>(j) * width + i];
    for (int i = rank_ - 1; i >= 0 && free > 0; --i) {
      double *row = &T_[static_cast<std::size_t>(i) * ld_], *v = &Z_[static_cast<std::size_t>(i) * (free + 1)];
      const double rest = dot_any(row + rank_, row + rank_, free), length = std::sqrt(row[i] * row[i] + rest);
      if (rest == 0.0) continue;  // v[free] = 0: no reflection
      const double pivot = row[i] > 0.0 ? -length : length, leading = row[i] - pivot;
      for (int q = 0; q < free; ++q) v[q] = row[rank_ + q] / leading;
      v[free] = 2.0 / (1.0 + rest / (leading * leading));
      for (int l = 0; l <= i; ++l) {
        double* other = &T_[static_cast<std::size_t>(l) * ld_];
        const double s = v[free] * (other[i] + dot_any(v, other + rank_, free));
        other[i] -= s;
        add_any(other + rank_, v, -s, free);
      }
    }
  }

  int n_, ld_, rank_;
  double flat_, share_, free_ = 1.0, rounding_ = 0.0;
  bool by_row_, diagonal_ = true, uncertain_ = false;
  std::vector<double> still_, inverse_, unit_;
  std::vector<char> flat_at_;  // zeros of a diagonal F
  std::vector<int> order_;     // (n,) the variable of each column of the triangle
  std::vector<double> T_, Z_;  // (rank, ld), and each reflection's entries beyond the rank, then its scale
  std::vector<double> columns_, square_, y_;
  std::vector<std::pair<double, int>> rows_;
  double near_ = 0.0, clear_ = 0.0;
  double flat_error_ = 0.0;  // error of a row's entries along directions without motion, as a share of its length
  double least_ = 0.0;
  double last_ = 0.0;  // largest remainder when all columns were computed
  mutable std::vector<double> work_;
};

}  // namespace HQP_ISA
}  // namespace hqp
