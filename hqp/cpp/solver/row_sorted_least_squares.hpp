// Least squares over rows sorted by length: Householder with column pivoting, row-wise stable (Cox and Higham 1998).
#pragma once

#include "arena.hpp"
#include "dense.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class RowSortedLeastSquares {
 public:
  double* z = nullptr;  // (f,) the solution, a basic one

  void layout(Arena& arena, int n, int most) {
    const std::size_t wide = static_cast<std::size_t>(padded(n + 1));
    wide_ = static_cast<int>(wide);
    arena.place(B_, (most + 1) * wide);
    arena.place(rhs_, most + 1);
    arena.place(length_, most + 1);
    arena.place(column_, n + 1);
    arena.place(size_, wide);
    arena.place(mix_, wide);
    arena.place(z, n + 1);
  }

  // Row i: length times the remainder of a row of unit length, and of its coefficients of further columns; rows come
  // from the longest to the shortest.
  void set(int i, const double* rest, int f, double length, double rhs, const double* further = nullptr, int more = 0) {
    length_[i] = length;
    rhs_[i] = rhs;
    for (int j = 0; j < f; ++j) row(i)[j] = length * rest[j];
    for (int j = 0; j < more; ++j) row(i)[f + j] = length * further[j];
  }

  // min || B z - rhs || over m rows, f columns; `more` columns after them are reflected along. A row of which less than
  // kSeen, or than `least`, is left adds no direction. Returns the length of the part of rhs that B z removes.
  double solve(int m, int f, double least, int more = 0) {
    const double flat = larger(kSeen, least);
    for (int j = 0; j < f; ++j) column_[j] = j;
    int rank = 0;
    double reach = 0.0;
    while (rank < m && rank < f) {
      m = put_flat_last(rank, m, f, f + more, flat);
      if (rank == m) break;
      swap_columns(rank, longest_column(rank, m, f), m);
      reflect_column(rank, m, f + more);
      reach += rhs_[rank] * rhs_[rank];
      ++rank;
    }
    rank_ = rank;
    for (int j = 0; j < f; ++j) z[j] = 0.0;
    for (int i = rank - 1; i >= 0; --i) {
      double s = rhs_[i];
      for (int j = i + 1; j < rank; ++j) s -= row(i)[j] * z[column_[j]];
      z[column_[i]] = s / row(i)[i];
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
      if (i < rank_ && std::fabs(miss) <= size * larger(rounding * length_[i], least * std::fabs(row(i)[i]))) continue;
      const int first = i < rank_ ? i : f;
      for (int j = first; j < f; ++j) y[column_[j]] += row(i)[j] * miss;
      for (int j = 0; j < more; ++j) further[j] += row(i)[f + j] * miss;
      double square = 0.0;
      for (int j = first; j < f + more; ++j) square += row(i)[j] * row(i)[j];
      terms += (std::sqrt(square) + error * length_[i]) * (std::fabs(miss) + error * size * length_[i]);
    }
    return terms;
  }

 private:
  int wide_ = 0, rank_ = 0;
  double *B_ = nullptr, *rhs_ = nullptr, *length_ = nullptr, *size_ = nullptr, *mix_ = nullptr;
  int* column_ = nullptr;

  double* row(int i) { return B_ + static_cast<std::ptrdiff_t>(i) * wide_; }

  // Rows without a direction go to the end; the others keep their order. Their number.
  int put_flat_last(int rank, int m, int f, int columns, double flat) {
    for (int i = rank; i < m;) {
      double most = 0.0;
      for (int j = rank; j < f; ++j) most = larger(most, std::fabs(row(i)[j]));
      if (most > flat * length_[i]) {
        ++i;
        continue;
      }
      --m;
      for (int q = i; q < m; ++q) {
        for (int j = 0; j < columns; ++j) std::swap(row(q)[j], row(q + 1)[j]);
        std::swap(rhs_[q], rhs_[q + 1]);
        std::swap(length_[q], length_[q + 1]);
      }
    }
    return m;
  }

  int longest_column(int rank, int m, int f) {
    for (int j = rank; j < f; ++j) size_[j] = 0.0;
    for (int i = rank; i < m; ++i)
      for (int j = rank; j < f; ++j) size_[j] += row(i)[j] * row(i)[j];
    int p = rank;
    for (int j = rank + 1; j < f; ++j)
      if (size_[j] > size_[p]) p = j;
    return p;
  }

  void swap_columns(int a, int b, int m) {
    if (a == b) return;
    for (int i = 0; i < m; ++i) {
      const double s = row(i)[b];
      row(i)[b] = row(i)[a];
      row(i)[a] = s;
    }
    const int s = column_[b];
    column_[b] = column_[a];
    column_[a] = s;
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
};

}  // namespace HQP_ISA
}  // namespace hqp
