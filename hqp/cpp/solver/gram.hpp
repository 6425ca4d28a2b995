// The level that selects all that is left: a small normal matrix and its Cholesky factor.
#pragma once

#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct Gram : TableauData {
  // Whether a selection sees every variable that is left.
  bool gram_fits(int k) {
    const Stage& s = stage[k];
    const Block& b = table->block[k];
    for (int j = 0; j < rest; ++j) diagonal[j] = 0.0;
    double most = 0.0;
    for (int i = 0; i < s.m; ++i) {
      const int local = s.rows[i] - b.begin, p = place[b.index[local]];
      const double d = b.scale[local] * b.scale[local];
      most = larger(most, d);
      if (p >= 0) diagonal[p] += d;
    }
    least = kInfinity;
    for (int j = 0; j < rest; ++j) least = smaller(least, diagonal[j]);
    return least > 1e-6 * most;
  }

  // minimise sum (s x - b)^2 over what is left: H = D + G' S G, Cholesky; false if H is badly conditioned.
  bool by_gram(int k, const std::int8_t* W) {
    Stage& s = stage[k];
    const Block& b = table->block[k];
    const int width = lanes(rest + 1);
    for (int j = 0; j < rest; ++j) target[j] = 0.0;
    int depth = 0;
    for (int i = 0; i < s.m; ++i) {
      const int r = s.rows[i], local = r - b.begin, p = place[b.index[local]];
      const double scale = b.scale[local];
      if (p >= 0) {
        target[p] += scale * bound(r, W);
        continue;
      }
      const double* g = G + static_cast<std::ptrdiff_t>(-1 - p) * ld;
      double* row = T + static_cast<std::ptrdiff_t>(depth++) * ld;
      if (scale == 1.0)
        for (int j = 0; j < width; j += kLane) at(row + j) = at(g + j);
      else {
        const Vec4 f = splat(scale);
        for (int j = 0; j < width; j += kLane) at(row + j) = f * at(g + j);
      }
      row[0] -= bound(r, W);
    }
    gram(H, ld, T, ld, depth, width);
    for (int j = 0; j < rest; ++j) {
      H[static_cast<std::ptrdiff_t>(j + 1) * ld + j + 1] += diagonal[j];
      target[j] += H[1 + j];
    }
    double trace = 0.0;
    for (int j = 0; j < rest; ++j) trace += H[static_cast<std::ptrdiff_t>(j + 1) * ld + j + 1];
    if (!(trace < 1e10 * least)) return false;
    s.kind = Stage::kGram;
    cholesky(width);
    solve_gram(target);
    gram_free = rest;
    gram_level = k;
    s.rank = rest;
    s.residual = -1.0;
    rest = 0;
    return true;
  }

  // H = U' U on rows and columns 1..rest, upper triangle, four rows at a time; 1 / U_ii goes to column 0.
  void cholesky(int width) {
    for (int first = 0; first <= rest; first += kLane) {
      const int last = first + kLane <= rest + 1 ? first + kLane : rest + 1;
      for (int i = first > 0 ? first : 1; i < last; ++i) {
        double* top = H + static_cast<std::ptrdiff_t>(i) * ld;
        const double inverse = 1.0 / std::sqrt(top[i]);
        const Vec4 f = splat(inverse);
        for (int j = first; j < width; j += kLane) at(top + j) *= f;
        for (int a = i + 1; a < last; ++a)
          subtract(H + static_cast<std::ptrdiff_t>(a) * ld + first, top + first, top[a], width - first);
        top[0] = inverse;
      }
      if (first == 0) {  // row 0 is no row of the factor
        double* row = H;
        for (int j = 0; j < width; j += kLane) at(row + j) = splat(0.0);
      }
      gram_subtract(H, ld, H + static_cast<std::ptrdiff_t>(first) * ld, ld, last - first, first + kLane, width);
    }
  }

  // y := H^-1 y over the variables the last level decided.
  void solve_gram(double* y) {
    const int c = gram_free ? gram_free : rest;
    for (int i = 0; i < c; ++i) {
      const double* u = H + static_cast<std::ptrdiff_t>(i + 1) * ld;
      y[i] *= u[0];
      add_any(y + i + 1, u + i + 2, -y[i], c - i - 1);
    }
    for (int i = c - 1; i >= 0; --i) {
      const double* u = H + static_cast<std::ptrdiff_t>(i + 1) * ld;
      y[i] = (y[i] - dot_any(u + i + 2, y + i + 1, c - i - 1)) * u[0];
    }
  }

  void solution_of_gram() {
    for (int j = 0; j < gram_free; ++j) x[free[j]] = target[j];
    dots_any(target, G + 1, ld, basic, gram_free, size);
    for (int i = 0; i < basic; ++i) x[base[i]] -= size[i];
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
