// The sparse and the small parts of eliminating constraint forces; hqp/torque/dynamics.py has the equations.
//
// The inertia is factored as A = H^T H with H lower triangular: H[i][j] is zero unless coordinate j carries i, so that
// the elimination stays within the branches of the tree (Featherstone 2005).
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "../solver/dense.hpp"
#include "elimination.hpp"

namespace hqp {
inline namespace HQP_ISA {

class SparseElimination final : public Elimination {
 public:
  // parents: the coordinate before each on its way to the world, -1 for none; lower than itself.
  SparseElimination(std::vector<int> parents, std::vector<int> actuated, int rows)
      : parents_(std::move(parents)),
        actuated_(std::move(actuated)),
        nv_(static_cast<int>(parents_.size())),
        n_(static_cast<int>(actuated_.size())),
        m_(rows),
        H_(nv_ * nv_),
        ranges_(nv_),
        R_(nv_ * rows),
        y_(rows) {
    for (int i = 0; i < nv_; ++i) ranges_[i] = {n_, 0};
    for (int k = 0; k < n_; ++k)
      for (int i = actuated_[k]; i >= 0; i = parents_[i])
        ranges_[i] = {std::min(ranges_[i].first, k), std::max(ranges_[i].second, k + 1)};
  }

  int eliminate(const double* A, const double* bias, const double* J, const double* gamma, double tolerance,
                double* map, double* phi, double* Q, double* T, double* top) override {
    if (!factor(A)) return -1;
    columns(bias, map);
    if (!constraints(J, gamma, tolerance, Q, T)) return 0;
    project(Q, top, map, phi);
    motions(map);
    // in exact numbers they are the same; to the bit, one is kept where both are written down
    for (int k = 0; k < n_; ++k) std::copy(phi + k * n_, phi + (k + 1) * n_, map + actuated_[k] * (n_ + 1));
    return 1;
  }

 private:
  // A: its upper triangle, column-major. False unless positive definite.
  bool factor(const double* A) {
    std::copy(A, A + H_.size(), H_.begin());  // by columns the upper triangle is the lower one by rows
    for (int k = nv_ - 1; k >= 0; --k) {
      double* row = H(k);
      if (!(row[k] > 0.0)) return false;
      row[k] = std::sqrt(row[k]);
      const double inverse = 1.0 / row[k];
      for (int i = parents_[k]; i >= 0; i = parents_[i]) row[i] *= inverse;
      for (int i = parents_[k]; i >= 0; i = parents_[i])
        for (int j = i; j >= 0; j = parents_[j]) H(i)[j] -= row[i] * row[j];
    }
    return true;
  }

  // Y (nv, n + 1) row-major: H^-T [U^T, -bias]. Columns of U^T stay within the coordinates that carry their joint.
  void columns(const double* bias, double* Y) const {
    const int w = n_ + 1;
    std::fill(Y, Y + nv_ * w, 0.0);
    for (int k = 0; k < n_; ++k) Y[actuated_[k] * w + k] = 1.0;
    for (int i = 0; i < nv_; ++i) Y[i * w + n_] = -bias[i];
    for (int i = nv_ - 1; i >= 0; --i) {
      double* y = Y + i * w;
      const double inverse = 1.0 / H(i)[i];
      const auto [first, last] = ranges_[i];
      for (int k = first; k < last; ++k) y[k] *= inverse;
      y[n_] *= inverse;
      for (int j = parents_[i]; j >= 0; j = parents_[j]) {
        double* other = Y + j * w;
        for (int k = first; k < last; ++k) other[k] -= H(i)[j] * y[k];
        other[n_] -= H(i)[j] * y[n_];
      }
    }
  }

  // Q (nv, m) and T (m, m) row-major with H^-T J^T = Q T; keeps y = T^-T gamma. False where T is singular within
  // tolerance.
  bool constraints(const double* J, const double* gamma, double tolerance, double* Q, double* T) {
    if (m_ > nv_) return false;
    for (int i = 0; i < nv_; ++i)
      for (int k = 0; k < m_; ++k) R(i)[k] = J[k * nv_ + i];
    for (int i = nv_ - 1; i >= 0; --i) {
      scale(R(i), m_, 1.0 / H(i)[i]);
      for (int j = parents_[i]; j >= 0; j = parents_[j]) add_any(R(j), R(i), -H(i)[j], m_);
    }
    if (!reflect(tolerance)) return false;
    for (int k = 0; k < m_; ++k)
      for (int c = 0; c < m_; ++c) T[k * m_ + c] = c < k ? 0.0 : R(k)[c];
    accumulate(Q);
    for (int k = 0; k < m_; ++k) {
      double left = gamma[k];
      for (int c = 0; c < k; ++c) left -= T[c * m_ + k] * y_[c];
      y_[k] = left / T[k * m_ + k];
    }
    return true;
  }

  // With Y as columns() writes it: top (m, n + 1) = Q^T Y - [0, y], Y - Q top in the place of Y, and phi (n, n), the
  // products of its first n columns.
  void project(const double* Q, double* top, double* Y, double* phi) const {
    const int w = n_ + 1;
    std::fill(top, top + m_ * w, 0.0);
    for (int k = 0; k < m_; ++k) top[k * w + n_] = -y_[k];
    for (int k = 0; k < m_; ++k) add_rows(top + k * w, Y, w, nv_, 1.0, Q + k, m_, w);
    for (int i = 0; i < nv_; ++i) add_rows(Y + i * w, top, w, m_, -1.0, Q + i * m_, 1, w);
    std::fill(phi, phi + n_ * n_, 0.0);
    for (int k = 0; k < n_; ++k) add_rows(phi + k * n_ + k, Y + k, w, nv_, 1.0, Y + k, w, n_ - k);
    for (int k = 0; k < n_; ++k)
      for (int c = 0; c < k; ++c) phi[k * n_ + c] = phi[c * n_ + k];
  }

  // B (nv, n + 1) row-major: H^-1 B in its place.
  void motions(double* B) const {
    const int w = n_ + 1;
    for (int i = 0; i < nv_; ++i) {
      for (int j = parents_[i]; j >= 0; j = parents_[j]) add_any(B + i * w, B + j * w, -H(i)[j], w);
      scale(B + i * w, w, 1.0 / H(i)[i]);
    }
  }

  double* H(int i) { return H_.data() + i * nv_; }
  const double* H(int i) const { return H_.data() + i * nv_; }
  double* R(int i) { return R_.data() + i * m_; }

  // I - tau u u^T for each column k, u = (1, what it leaves below the diagonal).
  bool reflect(double tolerance) {
    taus_.assign(m_, 0.0);
    work_.resize(m_);
    double least = INFINITY, largest = 0.0;
    for (int k = 0; k < m_; ++k) {
      double below = 0.0;
      for (int i = k + 1; i < nv_; ++i) below += R(i)[k] * R(i)[k];
      const double head = R(k)[k], norm = std::copysign(std::sqrt(head * head + below), head);
      least = std::min(least, std::abs(norm));
      largest = std::max(largest, std::abs(norm));
      if (!(std::abs(norm) > 0.0)) return false;
      taus_[k] = (head + norm) / norm;
      for (int i = k + 1; i < nv_; ++i) R(i)[k] /= head + norm;
      R(k)[k] = -norm;
      const int rest = m_ - k - 1;
      std::copy(R(k) + k + 1, R(k) + m_, work_.begin());
      add_rows(work_.data(), R(k + 1) + k + 1, m_, nv_ - k - 1, 1.0, R(k + 1) + k, m_, rest);
      scale(work_.data(), rest, taus_[k]);
      add_any(R(k) + k + 1, work_.data(), -1.0, rest);
      for (int i = k + 1; i < nv_; ++i) add_any(R(i) + k + 1, work_.data(), -R(i)[k], rest);
    }
    return m_ == 0 || least > tolerance * largest;
  }

  // The first m columns of the product of the reflections.
  void accumulate(double* Q) {
    std::fill(Q, Q + nv_ * m_, 0.0);
    for (int k = m_ - 1; k >= 0; --k) {
      const int size = m_ - k;
      double* q = Q + k * m_ + k;  // rows and columns from k on are all that is there
      q[0] = 1.0;
      std::copy(q, q + size, work_.begin());
      add_rows(work_.data(), q + m_, m_, nv_ - k - 1, 1.0, R(k + 1) + k, m_, size);
      scale(work_.data(), size, taus_[k]);
      add_any(q, work_.data(), -1.0, size);
      for (int i = k + 1; i < nv_; ++i) add_any(Q + i * m_ + k, work_.data(), -R(i)[k], size);
    }
  }

  std::vector<int> parents_, actuated_;
  int nv_, n_, m_;
  std::vector<double> H_;
  std::vector<std::pair<int, int>> ranges_;  // of actuated joints that a coordinate carries
  std::vector<double> R_, y_, taus_, work_;
};

}  // namespace HQP_ISA
}  // namespace hqp
