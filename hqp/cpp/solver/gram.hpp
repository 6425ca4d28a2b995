// The level that selects all that is left: a small normal matrix and its Cholesky factor.
#pragma once

#include "tableau.hpp"

namespace hqp {
inline namespace HQP_ISA {

class GramLevel {
 public:
  explicit GramLevel(Tableau& tableau) : t_(tableau) {}

  // Return true if a selection covers every remaining variable.
  bool fits(int k) {
    const Stage& s = t_.stage[k];
    const Block& b = t_.table->block[k];
    for (int j = 0; j < t_.rest; ++j) t_.diagonal[j] = 0.0;
    double most = 0.0;
    for (int i = 0; i < s.m; ++i) {
      const int local = s.rows[i] - b.begin, p = t_.place[b.index[local]];
      const double d = b.scale[local] * b.scale[local];
      most = larger(most, d);
      if (p >= 0) t_.diagonal[p] += d;
    }
    t_.least = kInfinity;
    for (int j = 0; j < t_.rest; ++j) t_.least = smaller(t_.least, t_.diagonal[j]);
    return t_.least > kUncertain * most;
  }

  // minimise sum (s x - b)^2 over the remaining variables: H = D + G' S G, Cholesky; false if H is badly conditioned.
  bool solve(int k, const std::int8_t* W) {
    Stage& s = t_.stage[k];
    const Block& b = t_.table->block[k];
    const int width = lanes(t_.rest + 1);
    for (int j = 0; j < t_.rest; ++j) t_.target[j] = 0.0;
    int depth = 0;
    for (int i = 0; i < s.m; ++i) {
      const int r = s.rows[i], local = r - b.begin, p = t_.place[b.index[local]];
      const double scale = b.scale[local];
      if (p >= 0) {
        t_.target[p] += scale * t_.bound(r, W);
        continue;
      }
      const double* g = t_.G + static_cast<std::ptrdiff_t>(-1 - p) * t_.ld;
      double* row = t_.T + static_cast<std::ptrdiff_t>(depth++) * t_.ld;
      if (scale == 1.0)
        for (int j = 0; j < width; j += kLane) at(row + j) = at(g + j);
      else {
        const Vec4 f = splat(scale);
        for (int j = 0; j < width; j += kLane) at(row + j) = f * at(g + j);
      }
      row[0] -= t_.bound(r, W);
    }
    gram(t_.H, t_.ld, t_.T, t_.ld, depth, width);
    for (int j = 0; j < t_.rest; ++j) {
      t_.H[static_cast<std::ptrdiff_t>(j + 1) * t_.ld + j + 1] += t_.diagonal[j];
      t_.target[j] += t_.H[1 + j];
    }
    double trace = 0.0;
    for (int j = 0; j < t_.rest; ++j) trace += t_.H[static_cast<std::ptrdiff_t>(j + 1) * t_.ld + j + 1];
    if (!(kDirection * trace < t_.least)) return false;
    s.kind = Stage::kGram;
    cholesky(width);
    multiply_inverse(t_.target);
    t_.gram_free = t_.rest;
    t_.gram_level = k;
    s.rank = t_.rest;
    s.residual = -1.0;
    t_.rest = 0;
    return true;
  }

  // y := H^-1 y over the variables the last level decided.
  void multiply_inverse(double* y) {
    const int c = t_.gram_free ? t_.gram_free : t_.rest;
    for (int i = 0; i < c; ++i) {
      const double* u = t_.H + static_cast<std::ptrdiff_t>(i + 1) * t_.ld;
      y[i] *= u[0];
      add_any(y + i + 1, u + i + 2, -y[i], c - i - 1);
    }
    for (int i = c - 1; i >= 0; --i) {
      const double* u = t_.H + static_cast<std::ptrdiff_t>(i + 1) * t_.ld;
      y[i] = (y[i] - dot_any(u + i + 2, y + i + 1, c - i - 1)) * u[0];
    }
  }

  void solution() {
    for (int j = 0; j < t_.gram_free; ++j) t_.x[t_.free[j]] = t_.target[j];
    dots_any(t_.target, t_.G + 1, t_.ld, t_.basic, t_.gram_free, t_.size);
    for (int i = 0; i < t_.basic; ++i) t_.x[t_.base[i]] -= t_.size[i];
  }

 private:
  // H = U' U on rows and columns 1..rest, upper triangle, four rows at a time; 1 / U_ii goes to column 0.
  void cholesky(int width) {
    for (int first = 0; first <= t_.rest; first += kLane) {
      const int last = first + kLane <= t_.rest + 1 ? first + kLane : t_.rest + 1;
      for (int i = first > 0 ? first : 1; i < last; ++i) {
        double* top = t_.H + static_cast<std::ptrdiff_t>(i) * t_.ld;
        const double inverse = 1.0 / std::sqrt(top[i]);
        const Vec4 f = splat(inverse);
        for (int j = first; j < width; j += kLane) at(top + j) *= f;
        for (int a = i + 1; a < last; ++a)
          subtract(t_.H + static_cast<std::ptrdiff_t>(a) * t_.ld + first, top + first, top[a], width - first);
        top[0] = inverse;
      }
      if (first == 0) {  // row 0 is no row of the factor
        double* row = t_.H;
        for (int j = 0; j < width; j += kLane) at(row + j) = splat(0.0);
      }
      gram_subtract(t_.H, t_.ld, t_.H + static_cast<std::ptrdiff_t>(first) * t_.ld, t_.ld, last - first, first + kLane,
                    width);
    }
  }

  Tableau& t_;
};

}  // namespace HQP_ISA
}  // namespace hqp
