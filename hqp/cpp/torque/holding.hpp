// The torque that holds a robot at rest where the constraints are as many as the motors that are missing;
// hqp/gravity.py has the equation.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace hqp {

class Holding {
 public:
  // Every coordinate is one of actuated and others; the latter are as many as constraints.
  Holding(std::vector<int> actuated, std::vector<int> others)
      : actuated_(std::move(actuated)),
        others_(std::move(others)),
        m_(static_cast<int>(others_.size())),
        nv_(m_ + static_cast<int>(actuated_.size())),
        rows_(m_ * (m_ + 1)) {}

  // J (m, nv) row-major: tau = g - J^T f on the actuated coordinates, with the f that makes it zero on the others.
  // False where no f does.
  bool torque(const double* J, const double* g, double* tau) {
    for (int i = 0; i < m_; ++i) {
      for (int k = 0; k < m_; ++k) row(i)[k] = J[k * nv_ + others_[i]];
      row(i)[m_] = g[others_[i]];
    }
    if (!solve()) return false;
    for (std::size_t a = 0; a < actuated_.size(); ++a) {
      tau[a] = g[actuated_[a]];
      for (int k = 0; k < m_; ++k) tau[a] -= row(k)[m_] * J[k * nv_ + actuated_[a]];
    }
    return true;
  }

 private:
  double* row(int i) { return rows_.data() + i * (m_ + 1); }

  // Gauss with partial pivoting; the solution is left in the last column.
  bool solve() {
    for (int k = 0; k < m_; ++k) {
      int best = k;
      for (int i = k + 1; i < m_; ++i)
        if (std::abs(row(i)[k]) > std::abs(row(best)[k])) best = i;
      if (row(best)[k] == 0.0) return false;
      if (best != k) std::swap_ranges(row(k) + k, row(k) + m_ + 1, row(best) + k);
      for (int i = k + 1; i < m_; ++i) {
        const double factor = row(i)[k] / row(k)[k];
        for (int c = k + 1; c <= m_; ++c) row(i)[c] -= factor * row(k)[c];
      }
    }
    for (int k = m_ - 1; k >= 0; --k) {
      for (int c = k + 1; c < m_; ++c) row(k)[m_] -= row(k)[c] * row(c)[m_];
      row(k)[m_] /= row(k)[k];
    }
    return true;
  }

  std::vector<int> actuated_, others_;
  int m_, nv_;
  std::vector<double> rows_;  // of J^T on the other coordinates, and g
};

}  // namespace hqp
