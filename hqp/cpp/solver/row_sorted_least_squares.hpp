// Least squares over rows sorted by length: Householder with column pivoting, row-wise stable (Cox and Higham 1998).
#pragma once

#include <algorithm>

#include "arena.hpp"
#include "dense.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class RowSortedLeastSquares {
 public:
  double* z = nullptr;  // (f,) the solution, a basic one

  void layout(Arena& arena, int n, int most) {
    ld_ = padded(most + 1);
    arena.place(B_, static_cast<std::size_t>(n + 1) * ld_);
    arena.place(rhs_, most + 1);
    arena.place(length_, most + 1);
    arena.place(order_, n + 1);
    arena.place(z, n + 1);
  }

  // Row i: length times the remainder of a row of unit length, and of its coefficients of further columns; rows come
  // from the longest to the shortest.
  void set(int i, const double* rest, int f, double length, double rhs, const double* further = nullptr, int more = 0) {
    length_[i] = length;
    rhs_[i] = rhs;
    for (int j = 0; j < f; ++j) column(j)[i] = length * rest[j];
    for (int j = 0; j < more; ++j) column(f + j)[i] = length * further[j];
  }

  // min || B z - rhs || over m rows, f columns; `more` columns after them are reflected along. A row of which no more
  // than `flat` is left adds no direction, and columns up to the length `clear` none. Returns the length of the part of
  // rhs that B z removes.
  double solve(int m, int f, double flat, int more = 0, double clear = 0.0) {
    for (int j = 0; j < f; ++j) order_[j] = j;
    double reach = 0.0;
    for (rank_ = 0; rank_ < f; ++rank_) {
      if (flat > 0.0) m = put_flat_last(m, f, f + more, flat);
      if (rank_ >= m || !(take_longest_column(m, f) > clear * clear)) break;
      reflect_others(m, f + more);
      reach += rhs_[rank_] * rhs_[rank_];
    }
    for (int j = 0; j < f; ++j) z[j] = 0.0;
    for (int i = rank_ - 1; i >= 0; --i) {
      double s = rhs_[i];
      for (int j = i + 1; j < rank_; ++j) s -= column(j)[i] * z[order_[j]];
      z[order_[i]] = s / column(i)[i];
    }
    return std::sqrt(reach);
  }

  // B' rhs before the solution, of the columns and of the further ones; a slack that the solution removes counts only
  // above rounding of its row's length and above a step of `least`. Returns the size of the terms, of coefficients and
  // misses with `error` times the row's length more, and of x.
  double gradient(int m, int f, int more, double size, double rounding, double least, double error, double* y,
                  double* further) {
    double terms = 0.0;
    for (int j = 0; j < f; ++j) y[j] = 0.0;
    for (int j = 0; j < more; ++j) further[j] = 0.0;
    for (int i = 0; i < m; ++i) {
      const double miss = rhs_[i];
      if (i < rank_ && std::fabs(miss) <= size * larger(rounding * length_[i], least * std::fabs(column(i)[i])))
        continue;
      double square = 0.0;
      for (int j = i < rank_ ? i : f; j < f + more; ++j) {
        const double entry = column(j)[i];
        (j < f ? y[order_[j]] : further[j - f]) += entry * miss;
        square += entry * entry;
      }
      terms += (std::sqrt(square) + error * length_[i]) * (std::fabs(miss) + error * size * length_[i]);
    }
    return terms;
  }

 private:
  int ld_ = 0, rank_ = 0;
  double *B_ = nullptr, *rhs_ = nullptr, *length_ = nullptr;
  int* order_ = nullptr;  // (f,) where the columns were

  double* column(int j) { return B_ + static_cast<std::ptrdiff_t>(j) * ld_; }

  // Rows without a direction go to the end; the others keep their order. Their number.
  int put_flat_last(int m, int f, int columns, double flat) {
    for (int i = rank_; i < m;) {
      double most = 0.0;
      for (int j = rank_; j < f; ++j) most = larger(most, std::fabs(column(j)[i]));
      if (most > flat * length_[i]) {
        ++i;
        continue;
      }
      const auto put_last = [&](double* y) { std::rotate(y + i, y + i + 1, y + m); };
      for (int j = 0; j < columns; ++j) put_last(column(j));
      put_last(rhs_);
      put_last(length_);
      --m;
    }
    return m;
  }

  // Return the square of its length.
  double take_longest_column(int m, int f) {
    int best = rank_;
    double most = -1.0;
    for (int j = rank_; j < f; ++j) {
      const double square = dot_any(column(j) + rank_, column(j) + rank_, m - rank_);
      if (square > most) most = square, best = j;
    }
    if (best != rank_) {
      std::swap_ranges(column(rank_), column(rank_) + ld_, column(best));
      std::swap(order_[rank_], order_[best]);
    }
    return most;
  }

  void reflect_others(int m, int columns) {
    double* v = column(rank_) + rank_;
    const int rows = m - rank_;
    const double length = std::sqrt(dot_any(v, v, rows)), pivot = v[0] > 0.0 ? -length : length;
    v[0] -= pivot;
    const double tau = -1.0 / (pivot * v[0]);
    const auto reflect = [&](double* y) { add_any(y, v, -tau * dot_any(v, y, rows), rows); };
    for (int j = rank_ + 1; j < columns; ++j) reflect(column(j) + rank_);
    reflect(rhs_ + rank_);
    v[0] = pivot;
    std::fill(v + 1, v + rows, 0.0);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
