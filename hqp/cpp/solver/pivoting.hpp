// A level in the variables that are left: column-pivoted Householder, then elimination from the levels above.
#pragma once

#include "gram.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Pivoting : Gram {
  // The level's working rows in the variables that are left: [rhs | coefficients].
  void form(int k, const std::int8_t* W) {
    Stage& s = stage[k];
    const Block& b = table->block[k];
    const int width = lanes(rest + 1), known = reduction.count;  // rows of a reduced table are zero there
    for (int i = 0; i < s.m; ++i) {
      const int r = s.rows[i], local = r - b.begin;
      double* row = T + static_cast<std::ptrdiff_t>(i) * ld;
      if (b.A) {
        const double* a = b.A + static_cast<std::ptrdiff_t>(local) * n;
        row[0] = bound(r, W) - (any_fixed ? dot_any(a, fixed_x, n) : 0.0);
        if (rest == n && !has_released)
          std::memcpy(row + 1, a, sizeof(double) * static_cast<std::size_t>(n));  // all, in order
        else
          for (int j = 0; j < rest; ++j) row[1 + j] = a[free[j]];
        for (int j = rest + 1; j < width; ++j) row[j] = 0.0;
        double* left = L + static_cast<std::ptrdiff_t>(i) * ld;
        for (int j = known; j < basic; ++j) left[j - known] = a[base[j]];
      } else {
        const int at_place = place[b.index[local]];
        const double scale = b.scale[local];
        if (at_place >= 0) {
          for (int j = 0; j < width; ++j) row[j] = 0.0;
          row[0] = bound(r, W);
          row[1 + at_place] = scale;
        } else {
          const double* g = G + static_cast<std::ptrdiff_t>(-1 - at_place) * ld;
          for (int j = 0; j < width; ++j) row[j] = -scale * g[j];
          row[0] += bound(r, W);
        }
      }
    }
    if (b.A)
      multiply_subtract(T, ld, L, ld, G + static_cast<std::ptrdiff_t>(known) * ld, ld, s.m, basic - known, width);
  }

  void exact_sizes(int first, int m, int width) {
    for (int j = 0; j < width; j += kLane) {
      Vec4 total = splat(0.0);
      for (int i = first; i < m; ++i) {
        const Vec4 t = at(T + static_cast<std::ptrdiff_t>(i) * ld + j);
        total += t * t;
      }
      at(size + j) = total * at(weight + j);
    }
  }

  // Householder with column pivoting on T, in place, down to pivots of length `floor`; columns stay where they are.
  void reflect_all(int k, double floor) {
    Stage& s = stage[k];
    const int width = lanes(rest + 1), m = s.m;
    weight[0] = 0.0;
    for (int j = 0; j < rest; ++j) weight[1 + j] = preference[free[j]];
    for (int j = rest + 1; j < width; ++j) weight[j] = 0.0;
    exact_sizes(0, m, width);
    double reference = 0.0;
    for (int j = 1; j <= rest; ++j) reference = larger(reference, size[j]);
    s.kind = Stage::kReflectors;
    int rank = 0;
    double smallest = kInfinity;
    while (rank < m && rank < rest) {
      int p = largest_column(width);
      if (size[p] < 1e-8 * reference) {
        exact_sizes(rank, m, width);
        p = largest_column(width);
        reference = size[p];
      }
      if (!(size[p] > 0.0)) break;
      double* v = s.V + static_cast<std::ptrdiff_t>(rank) * s.ldv;
      double square = 0.0;
      for (int i = rank; i < m; ++i) {
        v[i] = T[static_cast<std::ptrdiff_t>(i) * ld + p];
        square += v[i] * v[i];
      }
      const double length = std::sqrt(square);
      note_pivot(length, floor);
      if (!(length > floor)) break;
      const double alpha = v[rank], beta = alpha > 0 ? -length : length;
      v[rank] = alpha - beta;
      const double tau = 1.0 / (length * (length + std::fabs(alpha)));
      double* top = T + static_cast<std::ptrdiff_t>(rank) * ld;
      reflect(top, ld, v + rank, m - rank, tau, width, size, weight);
      s.tau[rank] = tau;
      top[p] = beta;  // below it rounding, which nothing reads
      weight[p] = 0.0;
      size[p] = 0.0;
      s.variables[rank++] = p - 1;  // positions now, variables after elimination
      smallest = smaller(smallest, length);
    }
    s.rank = rank;
    if (rank) growth = larger(growth, table->block[k].norm / smallest);
    double square = 0.0;
    for (int i = rank; i < m; ++i) {
      const double t = T[static_cast<std::ptrdiff_t>(i) * ld];
      square += t * t;
    }
    s.residual = std::sqrt(square);
  }

  // y := Q_i y with reflector i of a stage.
  static void reflect_vector(const Stage& s, int i, double* y) {
    const double* v = s.V + static_cast<std::ptrdiff_t>(i) * s.ldv;
    const double f = s.tau[i] * dot_any(v + i, y + i, s.m - i);
    add_any(y + i, v + i, -f, s.m - i);
  }

  // Position of the largest size; column 0 is the right-hand side.
  int largest_column(int width) const {
    const int found = largest(size, width);
    return found > 0 ? found : 1;
  }

  void note_pivot(double length, double floor) {
    const double ratio = length > floor ? length / floor : floor / larger(length, 1e-300);
    closest = smaller(closest, ratio);
  }

  // Make the pivot variables basic: solve the triangle, then clear them from the rows of the levels above.
  void eliminate(int k) {
    Stage& s = stage[k];
    const int r = s.rank, ldr = s.ldr;
    for (int i = 0; i < r; ++i)
      for (int j = i; j < r; ++j) s.R[i * ldr + j] = T[static_cast<std::ptrdiff_t>(i) * ld + 1 + s.variables[j]];
    for (int i = 0; i < basic; ++i) {
      const double* g = G + static_cast<std::ptrdiff_t>(i) * ld;
      for (int j = 0; j < r; ++j) s.pivots[static_cast<std::ptrdiff_t>(i) * ldr + j] = g[1 + s.variables[j]];
    }
    for (int j = 0; j < r; ++j) {
      const int variable = free[s.variables[j]];
      s.variables[j] = variable;
      place[variable] = -1 - (basic + j);
      base[basic + j] = variable;
    }
    // columns that stay move from the end into the holes the pivots left
    const int left = rest - r, width = lanes(left + 1);
    int moves = 0;
    for (int j = 0, tail = left; j < left; ++j) {
      if (place[free[j]] >= 0) continue;
      while (place[free[tail]] < 0) ++tail;
      hole[moves] = j;
      keep[moves++] = tail;
      free[j] = free[tail];
      place[free[j]] = j;
      ++tail;
    }
    double* fresh = G + static_cast<std::ptrdiff_t>(basic) * ld;
    for (int i = 0; i < basic + r; ++i) {
      const double* from =
          i < basic ? G + static_cast<std::ptrdiff_t>(i) * ld : T + static_cast<std::ptrdiff_t>(i - basic) * ld;
      double* row = G + static_cast<std::ptrdiff_t>(i) * ld;
      if (i >= basic)
        for (int j = 0; j < width; j += kLane) at(row + j) = at(from + j);
      for (int q = 0; q < moves; ++q) row[1 + hole[q]] = from[1 + keep[q]];
      for (int j = left + 1; j < width; ++j) row[j] = 0.0;
    }
    rest = left;
    for (int i = r - 1; i >= 0; --i) {
      double* row = fresh + static_cast<std::ptrdiff_t>(i) * ld;
      if (i + 1 < r) multiply_rows<1>(row, ld, s.R + i * ldr + i + 1, ldr, row + ld, ld, r - 1 - i, width);
      const Vec4 inverse = splat(1.0 / s.R[i * ldr + i]);
      for (int j = 0; j < width; j += kLane) at(row + j) *= inverse;
    }
    multiply_subtract(G, ld, s.pivots, ldr, fresh, ld, basic, r, width);
    basic += r;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
