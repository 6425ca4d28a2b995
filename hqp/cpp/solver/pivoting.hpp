// A level in the variables that are left: column-pivoted Householder, then elimination from the levels above.
#pragma once

#include "tableau.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Pivoting {
 public:
  explicit Pivoting(Tableau& tableau) : t_(tableau) {}

  // The level's working rows in the variables that are left: [rhs | coefficients].
  void form(int k, const std::int8_t* W) {
    Stage& s = t_.stage[k];
    const Block& b = t_.table->block[k];
    const int width = lanes(t_.rest + 1);
    for (int i = 0; i < s.m; ++i) {
      const int r = s.rows[i], local = r - b.begin;
      double* row = t_.T + static_cast<std::ptrdiff_t>(i) * t_.ld;
      if (b.A) {
        const double* a = b.A + static_cast<std::ptrdiff_t>(local) * t_.n;
        row[0] = t_.bound(r, W) - (t_.any_fixed ? dot_any(a, t_.fixed_x, t_.n) : 0.0);
        if (t_.rest == t_.n && !t_.has_released)
          std::memcpy(row + 1, a, sizeof(double) * static_cast<std::size_t>(t_.n));  // all, in order
        else
          for (int j = 0; j < t_.rest; ++j) row[1 + j] = a[t_.free[j]];
        for (int j = t_.rest + 1; j < width; ++j) row[j] = 0.0;
        double* left = t_.L + static_cast<std::ptrdiff_t>(i) * t_.ld;
        for (int j = 0; j < t_.basic; ++j) left[j] = a[t_.base[j]];
      } else {
        const int at_place = t_.place[b.index[local]];
        const double scale = b.scale[local];
        if (at_place >= 0) {
          for (int j = 0; j < width; ++j) row[j] = 0.0;
          row[0] = t_.bound(r, W);
          row[1 + at_place] = scale;
        } else {
          const double* g = t_.G + static_cast<std::ptrdiff_t>(-1 - at_place) * t_.ld;
          for (int j = 0; j < width; ++j) row[j] = -scale * g[j];
          row[0] += t_.bound(r, W);
        }
      }
    }
    if (b.A) multiply_subtract(t_.T, t_.ld, t_.L, t_.ld, t_.G, t_.ld, s.m, t_.basic, width);
  }

  void exact_sizes(int first, int m, int width) {
    for (int j = 0; j < width; j += kLane) {
      Vec4 total = splat(0.0);
      for (int i = first; i < m; ++i) {
        const Vec4 t = at(t_.T + static_cast<std::ptrdiff_t>(i) * t_.ld + j);
        total += t * t;
      }
      at(t_.size + j) = total * at(t_.weight + j);
    }
  }

  // Householder with column pivoting on T, in place, down to pivots of length `floor`; columns stay where they are.
  void reflect_all(int k, double floor) {
    Stage& s = t_.stage[k];
    const int width = lanes(t_.rest + 1), m = s.m;
    t_.weight[0] = 0.0;
    for (int j = 0; j < t_.rest; ++j) t_.weight[1 + j] = t_.preference[t_.free[j]];
    for (int j = t_.rest + 1; j < width; ++j) t_.weight[j] = 0.0;
    exact_sizes(0, m, width);
    double reference = 0.0;
    for (int j = 1; j <= t_.rest; ++j) reference = larger(reference, t_.size[j]);
    s.kind = Stage::kReflectors;
    int rank = 0;
    double smallest = kInfinity;
    t_.cut = 0.0;
    while (rank < m && rank < t_.rest) {
      int p = largest_column(width);
      if (t_.size[p] < kLost * reference) {
        exact_sizes(rank, m, width);
        p = largest_column(width);
        reference = t_.size[p];
      }
      if (!(t_.size[p] > 0.0)) break;
      double* v = s.V + static_cast<std::ptrdiff_t>(rank) * s.ldv;
      double square = 0.0;
      for (int i = rank; i < m; ++i) {
        v[i] = t_.T[static_cast<std::ptrdiff_t>(i) * t_.ld + p];
        square += v[i] * v[i];
      }
      const double length = std::sqrt(square);
      t_.note_pivot(length, floor);
      if (!(length > floor)) {
        t_.cut = length;
        break;
      }
      const double alpha = v[rank], beta = alpha > 0 ? -length : length;
      v[rank] = alpha - beta;
      const double tau = 1.0 / (length * (length + std::fabs(alpha)));
      double* top = t_.T + static_cast<std::ptrdiff_t>(rank) * t_.ld;
      reflect(top, t_.ld, v + rank, m - rank, tau, width, t_.size, t_.weight);
      s.tau[rank] = tau;
      top[p] = beta;  // below it rounding, which nothing reads
      t_.weight[p] = 0.0;
      t_.size[p] = 0.0;
      s.variables[rank++] = p - 1;  // positions now, variables after elimination
      smallest = smaller(smallest, length);
    }
    s.rank = rank;
    if (rank) t_.growth = larger(t_.growth, t_.table->block[k].norm / smallest);
    double square = 0.0;
    for (int i = rank; i < m; ++i) {
      const double t = t_.T[static_cast<std::ptrdiff_t>(i) * t_.ld];
      square += t * t;
    }
    s.residual = std::sqrt(square);
  }

  // Position of the largest size; column 0 is the right-hand side.
  int largest_column(int width) const {
    const int found = largest(t_.size, width);
    return found > 0 ? found : 1;
  }

  // Make the pivot variables basic: solve the triangle, then clear them from the rows of the levels above.
  void eliminate(int k) {
    Stage& s = t_.stage[k];
    const int r = s.rank, ldr = s.ldr;
    for (int i = 0; i < r; ++i)
      for (int j = i; j < r; ++j) s.R[i * ldr + j] = t_.T[static_cast<std::ptrdiff_t>(i) * t_.ld + 1 + s.variables[j]];
    for (int i = 0; i < t_.basic; ++i) {
      const double* g = t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld;
      for (int j = 0; j < r; ++j) s.pivots[static_cast<std::ptrdiff_t>(i) * ldr + j] = g[1 + s.variables[j]];
    }
    for (int j = 0; j < r; ++j) {
      const int variable = t_.free[s.variables[j]];
      s.variables[j] = variable;
      t_.place[variable] = -1 - (t_.basic + j);
      t_.base[t_.basic + j] = variable;
    }
    // columns that stay move from the end into the holes the pivots left
    const int left = t_.rest - r, width = lanes(left + 1);
    int moves = 0;
    for (int j = 0, tail = left; j < left; ++j) {
      if (t_.place[t_.free[j]] >= 0) continue;
      while (t_.place[t_.free[tail]] < 0) ++tail;
      t_.hole[moves] = j;
      t_.keep[moves++] = tail;
      t_.free[j] = t_.free[tail];
      t_.place[t_.free[j]] = j;
      ++tail;
    }
    double* fresh = t_.G + static_cast<std::ptrdiff_t>(t_.basic) * t_.ld;
    for (int i = 0; i < t_.basic + r; ++i) {
      const double* from = i < t_.basic ? t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld
                                        : t_.T + static_cast<std::ptrdiff_t>(i - t_.basic) * t_.ld;
      double* row = t_.G + static_cast<std::ptrdiff_t>(i) * t_.ld;
      if (i >= t_.basic)
        for (int j = 0; j < width; j += kLane) at(row + j) = at(from + j);
      for (int q = 0; q < moves; ++q) row[1 + t_.hole[q]] = from[1 + t_.keep[q]];
      for (int j = left + 1; j < width; ++j) row[j] = 0.0;
    }
    t_.rest = left;
    for (int i = r - 1; i >= 0; --i) {
      double* row = fresh + static_cast<std::ptrdiff_t>(i) * t_.ld;
      if (i + 1 < r) multiply_rows<1>(row, t_.ld, s.R + i * ldr + i + 1, ldr, row + t_.ld, t_.ld, r - 1 - i, width);
      const Vec4 inverse = splat(1.0 / s.R[i * ldr + i]);
      for (int j = 0; j < width; j += kLane) at(row + j) *= inverse;
    }
    multiply_subtract(t_.G, t_.ld, s.pivots, ldr, fresh, t_.ld, t_.basic, r, width);
    t_.basic += r;
  }

 private:
  Tableau& t_;
};

}  // namespace HQP_ISA
}  // namespace hqp
