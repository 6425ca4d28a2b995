// x = still + P y with E(x) = |y|^2 / 2: y is the motion away from the point of least motion.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Coordinates {
 public:
  // flat: directions without motion get this fraction of the largest column of F.
  Coordinates(int n, double flat)
      : n_(n), ld_(padded(n)), flat_(flat), still_(n, 0.0), inverse_(n, 1.0), unit_(n, 1.0) {}

  // F: (r, n), or its diagonal where r = 0, or null for the identity; f: (r), (n) for a diagonal, or null.
  void set(const double* F, const double* f, int r) {
    diagonal_ = r == 0;
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

  const double* still() const { return still_.data(); }
  bool diagonal() const { return diagonal_; }

  // The entry of a row that picks x_i, where E is diagonal.
  double picked(int i, double scale) const { return scale * unit_[i]; }

  // b (n, in whole vectors) = a P for a row a of x.
  void row(const double* a, double* b) const {
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) b[i] = a[i] * unit_[i];
      return;
    }
    std::copy(a, a + n_, b);
    for (int j = 0; j < n_; ++j) {
      if (b[j] == 0.0) continue;
      const double* R = &R_[j * ld_];
      const double f = b[j] / R[j];
      const int from = j / kLane * kLane;  // whole vectors at the same places, so that stores are forwarded
      add_any(b + from, R + from, -f, lanes(n_ - from));
      b[j] = f;
    }
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
    for (int i = 0; i < n_; ++i) y[i] = x[i] - still_[i];
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) y[i] *= inverse_[i];
    } else {
      for (int i = 0; i < n_; ++i) y[i] = dot_any(&R_[i * ld_ + i], y + i, n_ - i);
    }
  }

  // x (n) = P y.
  void step(const double* y, double* x) const {
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) x[i] = y[i] * unit_[i];
    } else {
      std::copy(y, y + n_, x);
      solve_upper(x);
    }
  }

  void point(const double* y, double* x) const {
    if (diagonal_) {
      for (int i = 0; i < n_; ++i) x[i] = still_[i] + y[i] * unit_[i];
      return;
    }
    std::copy(y, y + n_, x);
    solve_upper(x);
    for (int i = 0; i < n_; ++i) x[i] += still_[i];
  }

 private:
  void solve_upper(double* x) const {
    for (int i = n_ - 1; i >= 0; --i)
      x[i] = (x[i] - dot_any(&R_[i * ld_ + i + 1], x + i + 1, n_ - i - 1)) / R_[i * ld_ + i];
  }

  // Q R = [F; flat |F| I] by reflections, rows of the second block entering one by one.
  void factor(const double* F, const double* f, int r) {
    const int rows = r + n_, width = padded(n_ + 1);
    work_.assign(static_cast<std::size_t>(rows + 2) * width + kPad, 0.0);
    v_.resize(rows);
    R_.resize(static_cast<std::size_t>(n_) * ld_);  // zero below the diagonal and in the padding
    double *T = aligned(work_.data()), *size = T + static_cast<std::size_t>(rows) * width, *no_weight = size + width;
    for (int i = 0; i < r; ++i) {
      double* row = T + static_cast<std::size_t>(i) * width;
      std::copy(F + static_cast<std::size_t>(i) * n_, F + static_cast<std::size_t>(i + 1) * n_, row);
      for (int j = 0; j < n_; ++j) size[j] += row[j] * row[j];
      if (f) row[n_] = f[i];
    }
    const double largest = std::sqrt(*std::max_element(size, size + n_)), flat = largest > 0.0 ? flat_ * largest : 1.0;
    for (int j = 0; j < n_; ++j) T[static_cast<std::size_t>(r + j) * width + j] = flat;
    for (int j = 0; j < n_; ++j) {
      double* top = T + static_cast<std::size_t>(j) * width;
      const int m = r + 1;  // rows from j on: below them lies nothing yet
      for (int i = 0; i < m; ++i) v_[i] = top[static_cast<std::size_t>(i) * width + j];
      const double length = std::sqrt(dot_any(v_.data(), v_.data(), m));
      const double pivot = v_[0] > 0.0 ? -length : length;
      const double head = v_[0] -= pivot;
      const int from = (j + 1) / kLane * kLane;  // what this changes of columns that are done is not read again
      if (head != 0.0)
        reflect(top + from, width, v_.data(), m, -1.0 / (pivot * head), lanes(n_ + 1 - from), size + from,
                no_weight + from);
      double* R = &R_[static_cast<std::size_t>(j) * ld_];
      R[j] = pivot;
      std::copy(top + j + 1, top + n_, R + j + 1);
      still_[j] = top[n_];
    }
    solve_upper(still_.data());
  }

  int n_, ld_;
  double flat_;
  bool diagonal_ = true;
  std::vector<double> still_, inverse_, unit_, R_, work_, v_;
};

}  // namespace HQP_ISA
}  // namespace hqp
