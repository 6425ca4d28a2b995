// Equality rows of the top level, eliminated once for a whole search: its tableaus begin with fewer variables and rows.
#pragma once

#include "table.hpp"

namespace hqp {
inline namespace HQP_ISA {

// x_base = c - G x from equality rows that every point of the search meets; the table's rows in the other variables.
struct Reduction {
  int count = 0;        // variables eliminated, 0 while the table is whole
  int* base = nullptr;  // (count,) they
  double* G = nullptr;  // (count, n), zero at those eliminated
  double* c = nullptr;  // (count,)
  double growth = 1.0;  // bound on their magnification of rounding

  void layout(Arena& arena, int n, int rows, int blocks) {
    const std::size_t wide = static_cast<std::size_t>(n);
    arena.place(base, n);
    arena.place(c, n);
    arena.place(G, n * wide);
    arena.place(gone_, n);
    arena.place(rows_, rows * wide);
    arena.place(lower_, rows);
    arena.place(upper_, rows);
    arena.place(A_, blocks);
  }

  // The variables eliminated follow the others.
  void follow(double* x, int n) const {
    for (int i = 0; i < count; ++i) x[base[i]] = 0.0;
    for (int i = 0; i < count; ++i) x[base[i]] = c[i] - dot_any(row_of_G(i, n), x, n);
  }

  // The gradient with respect to the other variables, where those eliminated follow.
  void pull(double* g, int n) const {
    for (int i = 0; i < count; ++i) {
      const double f = g[base[i]];
      if (f == 0.0) continue;
      add_any(g, row_of_G(i, n), -f, n);
      g[base[i]] = 0.0;
    }
  }

  // Put reduced rows and bounds in the table's place. `left` of its top equality rows remain, with the coefficients of
  // `rest` in all variables, [rhs | coefficients] with stride ld.
  void apply(Table& t, const double* rest, int left, int ld) {
    gone_count_ = 0;
    for (int r = 0; r < t.rows; ++r) {
      lower_[r] = t.lower[r];
      upper_[r] = t.upper[r];
    }
    for (int k = 0; k < t.blocks; ++k) {
      Block& b = t.block[k];
      A_[k] = b.A;
      if (!b.A) continue;
      double* reduced = rows_ + static_cast<std::ptrdiff_t>(b.begin) * t.n;
      for (int r = b.begin; r < b.end; ++r) {
        double* row = reduced + static_cast<std::ptrdiff_t>(r - b.begin) * t.n;
        if (k > 0 || t.kind[r] != kEquality) {
          reduce(b.A + static_cast<std::ptrdiff_t>(r - b.begin) * t.n, row, t.n, t.lower[r], t.upper[r]);
        } else if (left > 0) {
          for (int j = 0; j < t.n; ++j) row[j] = rest[1 + j];
          for (int i = 0; i < count; ++i) row[base[i]] = 0.0;
          t.lower[r] = t.upper[r] = rest[0];
          --left;
          rest += ld;
        } else {
          for (int j = 0; j < t.n; ++j) row[j] = 0.0;
          t.lower[r] = t.upper[r] = 0.0;
          t.kind[r] = kFree;
          gone_[gone_count_++] = r;
        }
      }
      b.A = reduced;
    }
  }

  // The whole table again.
  void undo(Table& t) {
    for (int r = 0; r < t.rows; ++r) {
      t.lower[r] = lower_[r];
      t.upper[r] = upper_[r];
    }
    for (int q = 0; q < gone_count_; ++q) t.kind[gone_[q]] = kEquality;
    for (int k = 0; k < t.blocks; ++k) t.block[k].A = A_[k];
    count = 0;
  }

  // Mark the rows that are gone from the table.
  void mark(std::int8_t* W, Mark as) const {
    for (int q = 0; q < gone_count_; ++q) W[gone_[q]] = as;
  }

  const double* row_of_G(int i, int n) const { return G + static_cast<std::ptrdiff_t>(i) * n; }

 private:
  double *rows_ = nullptr, *lower_ = nullptr, *upper_ = nullptr;  // dense reduced rows; bounds of the whole table
  const double** A_ = nullptr;
  int* gone_ = nullptr;
  int gone_count_ = 0;

  void reduce(const double* a, double* row, int n, double& lower, double& upper) const {
    for (int j = 0; j < n; ++j) row[j] = a[j];
    double shift = 0.0;
    for (int i = 0; i < count; ++i) {
      const double f = a[base[i]];
      if (f == 0.0) continue;
      add_any(row, row_of_G(i, n), -f, n);
      shift += f * c[i];
    }
    for (int i = 0; i < count; ++i) row[base[i]] = 0.0;
    lower -= shift;
    upper -= shift;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
