// The torque that holds a robot at rest; hqp/torque/gravity.py has the equation.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace hqp {

class Holding {
 public:
  // Every coordinate is one of actuated and others; the constraints are no fewer than the latter.
  Holding(std::vector<int> actuated, std::vector<int> others, int constraints)
      : actuated_(std::move(actuated)),
        others_(std::move(others)),
        m_(constraints),
        p_(static_cast<int>(others_.size())),
        nv_(p_ + static_cast<int>(actuated_.size())),
        rows_(p_ * (p_ + 1)),
        H_(m_ * m_),
        Y_(m_ * p_),
        S_(p_ * p_),
        f_(m_),
        r_(p_) {}

  // J (m, nv) row-major: tau = g - J^T f on the actuated coordinates, with the f that makes it zero on the others; if
  // there are several, the one of least |tau|^2 + |f|^2.  False where no f does.
  bool torque(const double* J, const double* g, double* tau) {
    if (!(m_ == p_ ? square(J, g) : least(J, g))) return false;
    for (std::size_t a = 0; a < actuated_.size(); ++a) {
      tau[a] = g[actuated_[a]];
      for (int k = 0; k < m_; ++k) tau[a] -= f_[k] * J[k * nv_ + actuated_[a]];
    }
    return true;
  }

 private:
  double* row(int i) { return rows_.data() + i * (p_ + 1); }

  // Gauss with partial pivoting on J_o^T f = g_o.
  bool square(const double* J, const double* g) {
    for (int i = 0; i < p_; ++i) {
      for (int k = 0; k < p_; ++k) row(i)[k] = J[k * nv_ + others_[i]];
      row(i)[p_] = g[others_[i]];
    }
    for (int k = 0; k < p_; ++k) {
      int best = k;
      for (int i = k + 1; i < p_; ++i)
        if (std::abs(row(i)[k]) > std::abs(row(best)[k])) best = i;
      if (row(best)[k] == 0.0) return false;
      if (best != k) std::swap_ranges(row(k) + k, row(k) + p_ + 1, row(best) + k);
      for (int i = k + 1; i < p_; ++i) {
        const double factor = row(i)[k] / row(k)[k];
        for (int c = k + 1; c <= p_; ++c) row(i)[c] -= factor * row(k)[c];
      }
    }
    for (int k = p_ - 1; k >= 0; --k) {
      for (int c = k + 1; c < p_; ++c) row(k)[p_] -= row(k)[c] * row(c)[p_];
      row(k)[p_] /= row(k)[k];
      f_[k] = row(k)[p_];
    }
    return true;
  }

  // min |g_a - J_a^T f|^2 + |f|^2 subject to J_o^T f = g_o, by H = 1 + J_a J_a^T = L L^T and S = J_o^T H^-1 J_o.
  bool least(const double* J, const double* g) {
    for (int i = 0; i < m_; ++i) {
      for (int k = 0; k <= i; ++k) {
        double sum = i == k ? 1.0 : 0.0;
        for (int a : actuated_) sum += J[i * nv_ + a] * J[k * nv_ + a];
        H_[i * m_ + k] = sum;
      }
      f_[i] = 0.0;
      for (int a : actuated_) f_[i] += J[i * nv_ + a] * g[a];
    }
    if (!factor(H_, m_, 0.0)) return false;
    forward(H_, m_, f_.data(), 1);
    for (int i = 0; i < m_; ++i)
      for (int k = 0; k < p_; ++k) Y_[i * p_ + k] = J[i * nv_ + others_[k]];
    for (int k = 0; k < p_; ++k) forward(H_, m_, Y_.data() + k, p_);
    for (int k = 0; k < p_; ++k) {
      for (int c = 0; c <= k; ++c) {
        double sum = 0.0;
        for (int i = 0; i < m_; ++i) sum += Y_[i * p_ + k] * Y_[i * p_ + c];
        S_[k * p_ + c] = sum;
      }
      r_[k] = g[others_[k]];
      for (int i = 0; i < m_; ++i) r_[k] -= Y_[i * p_ + k] * f_[i];
    }
    if (!factor(S_, p_, kSingular)) return false;
    forward(S_, p_, r_.data(), 1);
    backward(S_, p_, r_.data());
    for (int i = 0; i < m_; ++i)
      for (int k = 0; k < p_; ++k) f_[i] += Y_[i * p_ + k] * r_[k];
    backward(H_, m_, f_.data());
    return true;
  }

  // Cholesky's factor of a symmetric matrix in its lower triangle; false where a pivot is lost.
  static bool factor(std::vector<double>& A, int n, double least) {
    double largest = 0.0;
    for (int i = 0; i < n; ++i) largest = std::max(largest, A[i * n + i]);
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k <= i; ++k) {
        double sum = A[i * n + k];
        for (int c = 0; c < k; ++c) sum -= A[i * n + c] * A[k * n + c];
        if (i != k) {
          A[i * n + k] = sum / A[k * n + k];
        } else {
          if (!(sum > least * largest)) return false;
          A[i * n + i] = std::sqrt(sum);
        }
      }
    }
    return true;
  }

  static void forward(const std::vector<double>& L, int n, double* x, int stride) {
    for (int i = 0; i < n; ++i) {
      for (int k = 0; k < i; ++k) x[i * stride] -= L[i * n + k] * x[k * stride];
      x[i * stride] /= L[i * n + i];
    }
  }

  static void backward(const std::vector<double>& L, int n, double* x) {
    for (int i = n - 1; i >= 0; --i) {
      for (int k = i + 1; k < n; ++k) x[i] -= L[k * n + i] * x[k];
      x[i] /= L[i * n + i];
    }
  }

  static constexpr double kSingular = 1e-13;  // share of the largest pivot: LAPACK takes over

  std::vector<int> actuated_, others_;
  int m_, p_, nv_;
  std::vector<double> rows_;  // rows of J^T on the other coordinates, and g
  std::vector<double> H_, Y_, S_, f_, r_;
};

}  // namespace hqp
