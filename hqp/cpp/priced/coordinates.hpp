// x = still + P y with E(x) = |y|^2 / 2: y is the motion away from the point of least motion.  Where F leaves
// directions free, F = Q [T 0] Z' with T (rank, rank) triangular and Z orthogonal: coordinates from rank on are those
// directions, which cost next to nothing.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "../solver/dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kFree = 1e-5;  // of the least pivot of T: next to nothing

class Coordinates {
 public:
  // flat: a direction whose motion is this fraction of the largest column of F has none.  free: what a unit of it
  // counts, of the least pivot of T.
  Coordinates(int n, double flat, double free = kFree)
      : n_(n), ld_(padded(n)), rank_(n), flat_(flat), share_(free), still_(n, 0.0), inverse_(n, 1.0), unit_(n, 1.0) {}

  // F: (r, n), or its diagonal where r = 0, or null for the identity; f: (r), (n) for a diagonal, or null.
  void set(const double* F, const double* f, int r) {
    diagonal_ = r == 0;
    rank_ = n_;
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) {
        const double size = F ? F[i] : 1.0;
        if (inverse_[i] != size) unit_[i] = 1.0 / (inverse_[i] = size);
        still_[i] = f ? f[i] * unit_[i] : 0.0;
      }
      return;
    }
    factor(F, f, r);
  }

  // The coordinates of sum_j more_j^2 ((F x)_j - mean_j)^2 / 2, from those of F (r, n) itself.
  void set(const Coordinates& base, const double* F, const double* more, const double* mean, int r) {
    diagonal_ = false;
    rank_ = base.rank_;
    free_ = base.free_;
    order_ = base.order_;
    T_ = base.T_;
    Z_ = base.Z_;
    still_ = base.still_;
    const int rank = rank_, width = padded(r);
    columns_.assign(static_cast<std::size_t>(rank + 1) * width, 0.0);  // more Q, column by column, and the target
    y_.resize(ld_);
    for (int j = 0; j < r; ++j) {
      const double* a = F + static_cast<std::size_t>(j) * n_;
      base.row(a, y_.data());
      for (int i = 0; i < rank; ++i) columns_[static_cast<std::size_t>(i) * width + j] = more[j] * y_[i];
      columns_[static_cast<std::size_t>(rank) * width + j] = more[j] * (mean[j] - dot_any(a, still_.data(), n_));
    }
    for (int k = 0; k < rank; ++k) reflect_from(k, rank + 1, width, r);
    std::fill(y_.begin(), y_.end(), 0.0);
    for (int i = rank - 1; i >= 0; --i) {
      double value = columns_[static_cast<std::size_t>(rank) * width + i];
      for (int j = i + 1; j < rank; ++j) value -= columns_[static_cast<std::size_t>(j) * width + i] * y_[j];
      y_[i] = value / columns_[static_cast<std::size_t>(i) * width + i];
    }
    x_.resize(n_);
    base.step(y_.data(), x_.data());
    for (int i = 0; i < n_; ++i) still_[i] += x_[i];
    for (int i = 0; i < rank; ++i) {  // T = R T
      double* to = &T_[static_cast<std::size_t>(i) * ld_];
      std::fill(to, to + ld_, 0.0);
      for (int j = i; j < rank; ++j)
        add_any(to + j, &base.T_[static_cast<std::size_t>(j) * ld_ + j],
                columns_[static_cast<std::size_t>(j) * width + i], rank - j);
    }
  }

  const double* still() const { return still_.data(); }
  bool diagonal() const { return diagonal_; }
  int rank() const { return rank_; }

  // The entry of a row that picks x_i, where E is diagonal.
  double picked(int i, double scale) const { return scale * unit_[i]; }

  // b (n, in whole vectors) = a P for a row a of x.
  void row(const double* a, double* b) const {
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) b[i] = a[i] * unit_[i];
      return;
    }
    for (int i = 0; i < n_; ++i) b[i] = a[order_[i]];
    for (int i = rank_ - 1; i >= 0; --i) turn(i, b);
    for (int j = 0; j < rank_; ++j) {
      if (b[j] == 0.0) continue;
      const double* T = &T_[static_cast<std::size_t>(j) * ld_];
      const double f = b[j] / T[j];
      add_any(b + j + 1, T + j + 1, -f, rank_ - j - 1);
      b[j] = f;
    }
    for (int i = rank_; i < n_; ++i) b[i] /= free_;
  }

  // |A P - B|^2 over all entries of m rows, where E is diagonal.
  double apart(const double* A, const double* B, int m) const {
    const double* unit = unit_.data();
    const auto off = [unit](const double* a, const double* b, int j) -> Vec4 {
      return *reinterpret_cast<const Vec4u*>(a + j) * *reinterpret_cast<const Vec4u*>(unit + j) -
             *reinterpret_cast<const Vec4u*>(b + j);
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
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) x[i] = y[i] * unit_[i];
      return;
    }
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

 private:
  // The i-th reflection of Z: of entries i and rank to n.
  void turn(int i, double* b) const {
    const int free = n_ - rank_;
    if (free == 0) return;
    const double* v = &Z_[static_cast<std::size_t>(i) * (free + 1)];
    const double s = v[free] * (b[i] + dot_any(v, b + rank_, free));
    b[i] -= s;
    add_any(b + rank_, v, -s, free);
  }

  // The reflection that leaves of column k nothing below row k, on the columns from k to `count`; the pivot is there.
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

  // Reflections with columns in order of what is left of them, and others from the right for what is beyond the rank.
  void factor(const double* F, const double* f, int r) {
    const int width = padded(r);
    columns_.assign(static_cast<std::size_t>(n_ + 1) * width, 0.0);
    order_.resize(n_);
    for (int j = 0; j < n_; ++j) {
      order_[j] = j;
      for (int i = 0; i < r; ++i)
        columns_[static_cast<std::size_t>(j) * width + i] = F[static_cast<std::size_t>(i) * n_ + j];
    }
    if (f) std::copy(f, f + r, &columns_[static_cast<std::size_t>(n_) * width]);
    double least = 0.0, pivot = 1.0;
    for (rank_ = 0; rank_ < std::min(n_, r); ++rank_) {
      int best = rank_;
      double most = -1.0;
      for (int j = rank_; j < n_; ++j) {
        const double* c = &columns_[static_cast<std::size_t>(j) * width];
        const double square = dot_any(c + rank_, c + rank_, r - rank_);
        if (square > most) most = square, best = j;
      }
      if (rank_ == 0) least = flat_ * flat_ * most;
      if (!(most > least)) break;
      pivot = std::sqrt(most);
      if (best != rank_) {
        double *a = &columns_[static_cast<std::size_t>(rank_) * width],
               *b = &columns_[static_cast<std::size_t>(best) * width];
        std::swap_ranges(a, a + r, b);
        std::swap(order_[rank_], order_[best]);
      }
      reflect_from(rank_, n_ + 1, width, r);
    }
    free_ = share_ * pivot;
    triangle(width);
    still_.assign(n_, 0.0);
    y_.assign(ld_, 0.0);
    for (int i = 0; i < rank_; ++i) y_[i] = columns_[static_cast<std::size_t>(n_) * width + i];
    step(y_.data(), still_.data());
  }

  // T and Z of the columns: rows of the triangle lose what is beyond the rank, the last first.
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
      const double pivot = row[i] > 0.0 ? -length : length, head = row[i] - pivot;
      for (int q = 0; q < free; ++q) v[q] = row[rank_ + q] / head;
      v[free] = 2.0 / (1.0 + rest / (head * head));
      for (int l = 0; l <= i; ++l) {
        double* other = &T_[static_cast<std::size_t>(l) * ld_];
        const double s = v[free] * (other[i] + dot_any(v, other + rank_, free));
        other[i] -= s;
        add_any(other + rank_, v, -s, free);
      }
    }
  }

  int n_, ld_, rank_;
  double flat_, share_, free_ = 1.0;
  bool diagonal_ = true;
  std::vector<double> still_, inverse_, unit_;
  std::vector<int> order_;     // (n,) the variable of each column of the triangle
  std::vector<double> T_, Z_;  // (rank, ld), and of each reflection its entries beyond the rank, then its scale
  std::vector<double> columns_, y_, x_;
  mutable std::vector<double> work_;
};

}  // namespace HQP_ISA
}  // namespace hqp
