// Small dense loops on row-major blocks whose rows are padded to whole vectors with zeros.
// The translation unit that includes this file is compiled once per instruction set, each time in a
// namespace of its own (HQP_ISA), so that no code built for a wide machine can be linked into the other.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#ifndef HQP_ISA
#define HQP_ISA generic
#endif

namespace hqp {
inline namespace HQP_ISA {

constexpr double kInfinity = __builtin_inf();

typedef double Vec4 __attribute__((vector_size(32), may_alias));
typedef double Vec4u __attribute__((vector_size(32), aligned(8), may_alias));

constexpr int kLane = 4;  // doubles in a vector
constexpr int kPad = 8;   // strides are multiples of this

static inline double larger(double a, double b) { return a > b ? a : b; }
static inline double smaller(double a, double b) { return a < b ? a : b; }

static inline int padded(int width) { return (width + kPad - 1) / kPad * kPad; }
static inline int lanes(int width) { return (width + kLane - 1) / kLane * kLane; }

// The first address from p on where whole vectors may lie, at most kPad - 1 numbers further.
static inline double* aligned(double* p) {
  while (reinterpret_cast<std::uintptr_t>(p) % (kPad * sizeof(double))) ++p;
  return p;
}

static inline Vec4 splat(double a) { return Vec4{a, a, a, a}; }
static inline Vec4& at(double* p) { return *reinterpret_cast<Vec4*>(p); }
static inline const Vec4& at(const double* p) { return *reinterpret_cast<const Vec4*>(p); }
static inline Vec4u& unaligned(double* p) { return *reinterpret_cast<Vec4u*>(p); }
static inline const Vec4u& unaligned(const double* p) { return *reinterpret_cast<const Vec4u*>(p); }

// T(rows, 4 * V) -= tau v (v' T), V vectors wide; then size -= weight T(0, :)^2.
template <int V>
static inline void reflect_block(double* T, int ld, const double* v, int rows, double tau, double* size,
                                 const double* weight) {
  Vec4 sum[V];
  for (int k = 0; k < V; ++k) sum[k] = splat(0.0);
  for (int i = 0; i < rows; ++i) {
    const Vec4 f = splat(v[i]);
    const double* row = T + static_cast<std::ptrdiff_t>(i) * ld;
    for (int k = 0; k < V; ++k) sum[k] += f * at(row + kLane * k);
  }
  const Vec4 t = splat(tau), top = splat(v[0]);
  for (int k = 0; k < V; ++k) {
    sum[k] *= t;
    const Vec4 r = at(T + kLane * k) - top * sum[k];
    at(T + kLane * k) = r;
    at(size + kLane * k) -= r * r * at(weight + kLane * k);
  }
  for (int i = 1; i < rows; ++i) {
    const Vec4 f = splat(v[i]);
    double* row = T + static_cast<std::ptrdiff_t>(i) * ld;
    for (int k = 0; k < V; ++k) at(row + kLane * k) -= f * sum[k];
  }
}

static inline void reflect(double* T, int ld, const double* v, int rows, double tau, int width, double* size,
                           const double* weight) {
  int j = 0;
  for (; j + 16 <= width; j += 16) reflect_block<4>(T + j, ld, v, rows, tau, size + j, weight + j);
  if (j + 8 <= width) {
    reflect_block<2>(T + j, ld, v, rows, tau, size + j, weight + j);
    j += 8;
  }
  if (j < width) reflect_block<1>(T + j, ld, v, rows, tau, size + j, weight + j);
}

// C(R, 4 * V) -= L(R, depth) B(depth, 4 * V)
template <int R, int V>
static inline void multiply_block(double* C, int ldc, const double* L, int ldl, const double* B, int ldb, int depth) {
  Vec4 acc[R][V];
  for (int i = 0; i < R; ++i)
    for (int k = 0; k < V; ++k) acc[i][k] = at(C + static_cast<std::ptrdiff_t>(i) * ldc + kLane * k);
  for (int d = 0; d < depth; ++d) {
    const double* row = B + static_cast<std::ptrdiff_t>(d) * ldb;
    Vec4 b[V];
    for (int k = 0; k < V; ++k) b[k] = at(row + kLane * k);
    for (int i = 0; i < R; ++i) {
      const Vec4 f = splat(L[static_cast<std::ptrdiff_t>(i) * ldl + d]);
      for (int k = 0; k < V; ++k) acc[i][k] -= f * b[k];
    }
  }
  for (int i = 0; i < R; ++i)
    for (int k = 0; k < V; ++k) at(C + static_cast<std::ptrdiff_t>(i) * ldc + kLane * k) = acc[i][k];
}

template <int R>
static inline void multiply_rows(double* C, int ldc, const double* L, int ldl, const double* B, int ldb, int depth,
                                 int width) {
  int j = 0;
  for (; j + 8 <= width; j += 8) multiply_block<R, 2>(C + j, ldc, L, ldl, B + j, ldb, depth);
  if (j < width) multiply_block<R, 1>(C + j, ldc, L, ldl, B + j, ldb, depth);
}

// C(rows, width) -= L(rows, depth) B(depth, width), width in whole vectors.
static inline void multiply_subtract(double* C, int ldc, const double* L, int ldl, const double* B, int ldb, int rows,
                                     int depth, int width) {
  if (depth == 0) return;
  int i = 0;
  for (; i + 4 <= rows; i += 4)
    multiply_rows<4>(C + static_cast<std::ptrdiff_t>(i) * ldc, ldc, L + static_cast<std::ptrdiff_t>(i) * ldl, ldl, B,
                     ldb, depth, width);
  for (; i < rows; ++i)
    multiply_rows<1>(C + static_cast<std::ptrdiff_t>(i) * ldc, ldc, L + static_cast<std::ptrdiff_t>(i) * ldl, ldl, B,
                     ldb, depth, width);
}

// H(i, j) = sum_d P(d, i) P(d, j) for all block columns at or right of the row's block; H is (width, width).
template <int V>
static inline void gram_block(double* H, int ldh, const double* P, int ld, int depth, int i, int j) {
  Vec4 acc[4][V];
  for (int a = 0; a < 4; ++a)
    for (int k = 0; k < V; ++k) acc[a][k] = splat(0.0);
  for (int d = 0; d < depth; ++d) {
    const double* row = P + static_cast<std::ptrdiff_t>(d) * ld;
    for (int a = 0; a < 4; ++a) {
      const Vec4 f = splat(row[i + a]);
      for (int k = 0; k < V; ++k) acc[a][k] += f * at(row + j + kLane * k);
    }
  }
  for (int a = 0; a < 4; ++a)
    for (int k = 0; k < V; ++k) at(H + static_cast<std::ptrdiff_t>(i + a) * ldh + j + kLane * k) = acc[a][k];
}

static inline void gram(double* H, int ldh, const double* P, int ld, int depth, int width) {
  for (int i = 0; i < width; i += kLane) {
    int j = i;
    for (; j + 8 <= width; j += 8) gram_block<2>(H, ldh, P, ld, depth, i, j);
    if (j < width) gram_block<1>(H, ldh, P, ld, depth, i, j);
  }
}

// H(i, j) -= sum_d P(d, i) P(d, j) for rows and columns from `from` on, blocks at or right of the row's own.
template <int V>
static inline void gram_subtract_block(double* H, int ldh, const double* P, int ld, int depth, int i, int j) {
  Vec4 acc[4][V];
  for (int a = 0; a < 4; ++a)
    for (int k = 0; k < V; ++k) acc[a][k] = at(H + static_cast<std::ptrdiff_t>(i + a) * ldh + j + kLane * k);
  for (int d = 0; d < depth; ++d) {
    const double* row = P + static_cast<std::ptrdiff_t>(d) * ld;
    for (int a = 0; a < 4; ++a) {
      const Vec4 f = splat(row[i + a]);
      for (int k = 0; k < V; ++k) acc[a][k] -= f * at(row + j + kLane * k);
    }
  }
  for (int a = 0; a < 4; ++a)
    for (int k = 0; k < V; ++k) at(H + static_cast<std::ptrdiff_t>(i + a) * ldh + j + kLane * k) = acc[a][k];
}

static inline void gram_subtract(double* H, int ldh, const double* P, int ld, int depth, int from, int width) {
  for (int i = from; i < width; i += kLane) {
    int j = i;
    for (; j + 8 <= width; j += 8) gram_subtract_block<2>(H, ldh, P, ld, depth, i, j);
    if (j < width) gram_subtract_block<1>(H, ldh, P, ld, depth, i, j);
  }
}

static inline void copy_rows(double* to, const double* from, int ld, int rows, int width) {
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < width; j += kLane)
      at(to + static_cast<std::ptrdiff_t>(i) * ld + j) = at(from + static_cast<std::ptrdiff_t>(i) * ld + j);
}

// y(width) -= a x(width)
static inline void subtract(double* y, const double* x, double a, int width) {
  const Vec4 f = splat(a);
  for (int j = 0; j < width; j += kLane) at(y + j) -= f * at(x + j);
}

static inline double sum(Vec4 v) { return (v[0] + v[2]) + (v[1] + v[3]); }

// Dot product of padded rows.
static inline double dot(const double* x, const double* y, int width) {
  Vec4 a = splat(0.0), b = splat(0.0);
  int j = 0;
  for (; j + 8 <= width; j += 8) {
    a += at(x + j) * at(y + j);
    b += at(x + j + kLane) * at(y + j + kLane);
  }
  if (j < width) a += at(x + j) * at(y + j);
  return sum(a + b);
}

// Dot product of vectors of any length at any address.
static inline double dot_any(const double* x, const double* y, int n) {
  Vec4 a = splat(0.0), b = splat(0.0);
  int j = 0;
  for (; j + 8 <= n; j += 8) {
    a += unaligned(x + j) * unaligned(y + j);
    b += unaligned(x + j + 4) * unaligned(y + j + 4);
  }
  if (j + 4 <= n) {
    a += unaligned(x + j) * unaligned(y + j);
    j += 4;
  }
  double s = sum(a + b);
  for (; j < n; ++j) s += x[j] * y[j];
  return s;
}

// Return the sum of the magnitudes of the products.
static inline double absolute_dot(const double* x, const double* y, int n) {
  Vec4 a = splat(0.0);
  int j = 0;
  for (; j + 4 <= n; j += 4) {
    const Vec4 p = unaligned(x + j) * unaligned(y + j);
    a += p > -p ? p : -p;
  }
  double s = sum(a);
  for (; j < n; ++j) s += std::fabs(x[j] * y[j]);
  return s;
}

// z = x y entry by entry, vectors of any length at any address.
static inline void multiply_any(double* z, const double* x, const double* y, int n) {
  int j = 0;
  for (; j + 4 <= n; j += 4) unaligned(z + j) = unaligned(x + j) * unaligned(y + j);
  for (; j < n; ++j) z[j] = x[j] * y[j];
}

// to[i] = x . Y(i, :) for `count` rows of Y, four at a time.
static inline void dots_any(const double* x, const double* Y, int ld, int count, int n, double* to) {
  int i = 0;
  for (; i + 4 <= count; i += 4) {
    const double* y = Y + static_cast<std::ptrdiff_t>(i) * ld;
    Vec4 a[4];
    for (int r = 0; r < 4; ++r) a[r] = splat(0.0);
    int j = 0;
    for (; j + 4 <= n; j += 4) {
      const Vec4 f = unaligned(x + j);
      for (int r = 0; r < 4; ++r) a[r] += f * unaligned(y + static_cast<std::ptrdiff_t>(r) * ld + j);
    }
    for (int r = 0; r < 4; ++r) {
      double s = sum(a[r]);
      for (int l = j; l < n; ++l) s += x[l] * y[static_cast<std::ptrdiff_t>(r) * ld + l];
      to[i + r] = s;
    }
  }
  for (; i < count; ++i) to[i] = dot_any(x, Y + static_cast<std::ptrdiff_t>(i) * ld, n);
}

constexpr int kTerms = 64;  // number of gathered terms in a sum of rows

// A sum of rows that is added to another, which has to be apart from them; zeros cost little.
struct Terms {
  const double* row[kTerms];
  double factor[kTerms];
  int count = 0;

  void add(const double* x, double f) {
    row[count] = x;
    factor[count] = f;
    count += f != 0.0;
  }

  void to(double* y, int n) const {
    int j = 0;
    for (; j + 32 <= n; j += 32) block<8>(y, j);
    if (j + 16 <= n) {
      block<4>(y, j);
      j += 16;
    }
    if (j + 8 <= n) {
      block<2>(y, j);
      j += 8;
    }
    if (j + 4 <= n) {
      block<1>(y, j);
      j += 4;
    }
    for (; j < n; ++j) {
      double s = y[j];
      for (int q = 0; q < count; ++q) s += factor[q] * row[q][j];
      y[j] = s;
    }
  }

 private:
  // 4 * V columns from j on, in registers.
  template <int V>
  void block(double* y, int j) const {
    Vec4 s[V];
    for (int k = 0; k < V; ++k) s[k] = unaligned(y + j + kLane * k);
    for (int q = 0; q < count; ++q) {
      const Vec4 f = splat(factor[q]);
      const double* x = row[q] + j;
      for (int k = 0; k < V; ++k) s[k] += f * unaligned(x + kLane * k);
    }
    for (int k = 0; k < V; ++k) unaligned(y + j + kLane * k) = s[k];
  }
};

// y += sign * sum_i a[i * step] X(i, :) over `count` rows of X, y apart from them.
static inline void add_rows(double* y, const double* X, int ld, int count, double sign, const double* a, int step,
                            int n) {
  for (int i = 0; i < count;) {
    Terms terms;
    for (; i < count && terms.count < kTerms; ++i)
      terms.add(X + static_cast<std::ptrdiff_t>(i) * ld, sign * a[static_cast<std::ptrdiff_t>(i) * step]);
    terms.to(y, n);
  }
}

// Position of the largest of `width` numbers, the lowest of equal ones.
static inline int largest(const double* y, int width) {
  Vec4 best = unaligned(y), where = Vec4{0, 1, 2, 3}, here = where;
  const Vec4 step = splat(kLane);
  for (int j = kLane; j < width; j += kLane) {
    const Vec4 t = unaligned(y + j);
    here += step;
    const auto more = t > best;
    best = more ? t : best;
    where = more ? here : where;
  }
  double top = best[0], place = where[0];
  for (int q = 1; q < kLane; ++q)
    if (best[q] > top || (best[q] == top && where[q] < place)) {
      top = best[q];
      place = where[q];
    }
  return static_cast<int>(place);
}

static inline void scale(double* y, int n, double factor) {
  for (int j = 0; j < n; ++j) y[j] *= factor;
}

// y += a x, vectors of any length at any address.
static inline void add_any(double* y, const double* x, double a, int n) {
  const Vec4 f = splat(a);
  int j = 0;
  for (; j + 8 <= n; j += 8) {
    unaligned(y + j) += f * unaligned(x + j);
    unaligned(y + j + kLane) += f * unaligned(x + j + kLane);
  }
  for (; j + 4 <= n; j += 4) unaligned(y + j) += f * unaligned(x + j);
  for (; j < n; ++j) y[j] += a * x[j];
}

}  // namespace HQP_ISA
}  // namespace hqp
