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
    const int rows = r + n_;
    work_.assign(static_cast<std::size_t>(rows) * (n_ + 1), 0.0);
    parts_.resize(n_);
    R_.resize(static_cast<std::size_t>(n_) * ld_);  // zero below the diagonal and in the padding
    double largest = 0.0;
    for (int j = 0; j < n_; ++j) {
      double square = 0.0;
      double* column = &work_[static_cast<std::size_t>(j) * rows];
      for (int i = 0; i < r; ++i) {
        column[i] = F[i * n_ + j];
        square += column[i] * column[i];
      }
      largest = larger(largest, square);
    }
    const double flat = largest > 0.0 ? flat_ * std::sqrt(largest) : 1.0;
    for (int j = 0; j < n_; ++j) work_[static_cast<std::size_t>(j) * rows + r + j] = flat;
    double* target = &work_[static_cast<std::size_t>(n_) * rows];
    if (f) std::copy(f, f + r, target);
    for (int j = 0; j < n_; ++j) {
      double* v = &work_[static_cast<std::size_t>(j) * rows];
      const int m = r + j + 1;  // below lies nothing yet
      const double length = std::sqrt(dot_any(v + j, v + j, m - j));
      const double pivot = v[j] > 0.0 ? -length : length;
      const double head = v[j] - pivot;
      const double tau = head == 0.0 ? 0.0 : -1.0 / (pivot * head);
      v[j] = head;
      double* next = &work_[static_cast<std::size_t>(j + 1) * rows];
      dots_any(v + j, next + j, rows, n_ - j, m - j, parts_.data());
      for (int k = j + 1; k <= n_; ++k, next += rows) add_any(next + j, v + j, -tau * parts_[k - j - 1], m - j);
      R_[j * ld_ + j] = pivot;
      for (int k = j + 1; k < n_; ++k) R_[j * ld_ + k] = work_[static_cast<std::size_t>(k) * rows + j];
    }
    std::copy(target, target + n_, still_.data());
    solve_upper(still_.data());
  }

  int n_, ld_;
  double flat_;
  bool diagonal_ = true;
  std::vector<double> still_, inverse_, unit_, R_, work_, parts_;
};

}  // namespace HQP_ISA
}  // namespace hqp
