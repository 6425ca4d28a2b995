// Constraints that depend on each other: B (n, m) with rank r < m as B = U T' S', U (n, r) and S (m, r) orthonormal.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

namespace hqp {
inline namespace HQP_ISA {

// Forces are those of least norm, lambda = S T^-1 (...): least among all forces with equal effect.
class DependentRows {
 public:
  // Allocate for up to n variables and m constraints, so that nothing is allocated later.
  void reserve(std::size_t n, std::size_t m) {
    for (auto* part : {&B_, &U_}) part->reserve(n * m);
    for (auto* part : {&W_, &T_, &S_}) part->reserve(m * m);
  }
  // B (n, m) row-major is overwritten; its rank: columns whose rest is above the tolerance, relative to the first's.
  int factor(double* B, int n, int m, double tolerance) {
    n_ = n, m_ = m, r_ = 0;
    W_.assign(std::size_t(m) * m, 0.0), U_.assign(std::size_t(n) * m, 0.0), B_.assign(B, B + std::ptrdiff_t(n) * m);
    double first = 0.0;
    for (; r_ < m; ++r_) {
      int best = 0;
      double most = -1.0;
      for (int k = 0; k < m; ++k)
        if (const double size = length(B + k, n, m); size > most) most = size, best = k;
      if (r_ == 0) first = most;
      if (!(most > tolerance * first)) break;
      double* u = U_.data() + r_;
      for (int i = 0; i < n; ++i) u[i * m] = B[i * m + best] / most;
      orthogonal(U_.data(), n, m, r_);
      for (int k = 0; k < m; ++k) take(B + k, u, n, m);
    }
    for (int j = 0; j < r_; ++j)  // W (r, m) = U' B
      for (int i = 0; i < n; ++i)
        for (int k = 0; k < m; ++k) W_[j * m + k] += U_[i * m + j] * B_[i * m + k];
    T_.assign(std::size_t(r_) * r_, 0.0), S_.assign(std::size_t(m) * m, 0.0);
    for (int j = 0; j < r_; ++j) {  // W = T S', T lower triangular
      double* s = S_.data() + j;
      for (int k = 0; k < m; ++k) s[k * m] = W_[j * m + k];
      const double size = length(s, m, m);
      for (int k = 0; k < m; ++k) s[k * m] /= size;
      orthogonal(S_.data(), m, m, j);
      for (int c = 0; c <= j; ++c)
        for (int k = 0; k < m; ++k) T_[j * r_ + c] += W_[j * m + k] * S_[k * m + c];
    }
    return r_;
  }

  double direction(int i, int j) const { return U_[i * m_ + j]; }  // of U

  // y (r) with T' y = S' gamma: the motion that gamma (m) prescribes along U, in least squares.
  void towards(const double* gamma, double* y) const {
    for (int j = r_ - 1; j >= 0; --j) {
      double left = 0.0;
      for (int k = 0; k < m_; ++k) left += S_[k * m_ + j] * gamma[k];
      for (int c = j + 1; c < r_; ++c) left -= T_[c * r_ + j] * y[c];
      y[j] = left / T_[j * r_ + j];
    }
  }
  // S T^-1 b into out (m), for b (r), overwritten; both with a step from one number to the next.
  void spread(double* b, int step, double* out) const {
    for (int j = 0; j < r_; ++j) {
      for (int c = 0; c < j; ++c) b[j * step] -= T_[j * r_ + c] * b[c * step];
      b[j * step] /= T_[j * r_ + j];
    }
    for (int k = 0; k < m_; ++k) {
      out[k] = 0.0;
      for (int j = 0; j < r_; ++j) out[k] += S_[k * m_ + j] * b[j * step];
    }
  }

 private:
  static double length(const double* a, int n, int step) {
    double square = 0.0;
    for (int i = 0; i < n; ++i) square += a[i * step] * a[i * step];
    return std::sqrt(square);
  }
  static void take(double* a, const double* u, int n, int step) {
    double along = 0.0;
    for (int i = 0; i < n; ++i) along += a[i * step] * u[i * step];
    for (int i = 0; i < n; ++i) a[i * step] -= along * u[i * step];
  }
  // Column j against those before it; twice is enough (Giraud, Langou, Rozloznik 2005).
  static void orthogonal(double* A, int n, int step, int j) {
    for (int again = 0; again < 2; ++again) {
      for (int c = 0; c < j; ++c) take(A + j, A + c, n, step);
      const double size = length(A + j, n, step);
      for (int i = 0; i < n; ++i) A[i * step + j] /= size;
    }
  }

  int n_ = 0, m_ = 0, r_ = 0;
  std::vector<double> B_, U_, W_, T_, S_;
};

}  // namespace HQP_ISA
}  // namespace hqp
