// min ||M z - e|| + c/2 |z|^2 for a few rows M (m, N): singular values by Jacobi rotations, then a scalar equation.
#pragma once

#include <cmath>
#include <vector>

#include "../solver/dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Secular {
 public:
  // Rows M (m, ld) are replaced by the rotated ones, e (m) by U'e.
  void solve(double* M, int ld, int N, double* e, int m, double price) {
    m_ = m;
    U_.assign(static_cast<std::size_t>(m) * m, 0.0);
    square_.resize(m);
    for (int i = 0; i < m; ++i) U_[i * m + i] = 1.0;
    rotate(M, ld, N, e);
    double largest = 0.0, size = 0.0;
    for (int i = 0; i < m; ++i) {
      square_[i] = dot_any(M + i * ld, M + i * ld, N);
      largest = larger(largest, square_[i]);
      size = larger(size, std::abs(e[i]));
    }
    e_ = e;
    met_ = true;
    double reach = 0.0;
    for (int i = 0; i < m; ++i) {
      if (square_[i] <= 1e-26 * largest) {  // no direction
        square_[i] = 0.0;
        if (std::abs(e[i]) > 1e-13 * size) met_ = false;
      } else {
        const double u = e[i] / square_[i];
        reach += u * u;
      }
    }
    met_ = met_ && price * price * reach <= 1.0;
    multiplier_ = met_ ? 0.0 : root(price);
  }

  bool met() const { return met_; }

  // Weight of the rotated row i in z.
  double weight(int i) const {
    const double d = square_[i] + multiplier_;
    return square_[i] > 0.0 && d > 0.0 ? e_[i] / d : 0.0;
  }

  // u (m): w / ||w||, or the shortest multipliers where the level is met.
  void direction(double price, double* u) const {
    double length = 0.0;
    for (int i = 0; i < m_; ++i) u[i] = 0.0;
    for (int i = 0; i < m_; ++i) {
      double part;
      if (met_) {
        part = square_[i] > 0.0 ? -price * e_[i] / square_[i] : 0.0;
      } else {
        part = -e_[i] * multiplier_ / (square_[i] + multiplier_);
        length += part * part;
      }
      add_any(u, &U_[i * m_], part, m_);
    }
    if (!met_ && length > 0.0)
      for (int i = 0; i < m_; ++i) u[i] /= std::sqrt(length);
  }

 private:
  // One-sided Jacobi: pairs of rows are rotated until all are orthogonal.
  void rotate(double* M, int ld, int N, double* e) {
    for (int sweep = 0; sweep < 30; ++sweep) {
      bool done = true;
      for (int i = 0; i + 1 < m_; ++i) {
        for (int j = i + 1; j < m_; ++j) {
          double *a = M + i * ld, *b = M + j * ld;
          const double aa = dot_any(a, a, N), bb = dot_any(b, b, N), ab = dot_any(a, b, N);
          if (std::abs(ab) <= 1e-15 * std::sqrt(aa * bb) || ab == 0.0) continue;
          done = false;
          const double zeta = (bb - aa) / (2.0 * ab);
          const double t = (zeta > 0.0 ? 1.0 : -1.0) / (std::abs(zeta) + std::sqrt(1.0 + zeta * zeta));
          const double c = 1.0 / std::sqrt(1.0 + t * t), s = c * t;
          turn(a, b, c, s, N);
          turn(&U_[i * m_], &U_[j * m_], c, s, m_);
          turn(e + i, e + j, c, s, 1);
        }
      }
      if (done) return;
    }
  }

  static void turn(double* a, double* b, double c, double s, int n) {
    for (int k = 0; k < n; ++k) {
      const double x = a[k], y = b[k];
      a[k] = c * x - s * y;
      b[k] = s * x + c * y;
    }
  }

  // mu with sum (e_i / (s_i^2 + mu))^2 = 1 / c^2: Newton on its inverse root, from the left, halving where it leaves.
  double root(double price) const {
    double low = 0.0, norm = 0.0;
    for (int i = 0; i < m_; ++i) {
      low = larger(low, std::abs(e_[i]) * price - square_[i]);
      norm += e_[i] * e_[i];
    }
    double high = price * std::sqrt(norm), mu = larger(low, 1e-300);
    for (int step = 0; step < 100; ++step) {
      double phi = 0.0, slope = 0.0;
      for (int i = 0; i < m_; ++i) {
        const double d = 1.0 / (square_[i] + mu), q = e_[i] * d;
        phi += q * q;
        slope += q * q * d;
      }
      const double psi = 1.0 / std::sqrt(phi);
      if (psi < price) low = mu;
      else high = mu;
      double next = mu + (price - psi) * phi / (psi * slope);
      if (!(next > low && next < high)) next = 0.5 * (low + high);
      if (std::abs(next - mu) <= 1e-15 * mu) return next;
      mu = next;
    }
    return mu;
  }

  int m_ = 0;
  bool met_ = false;
  double multiplier_ = 0.0;
  const double* e_ = nullptr;
  std::vector<double> U_, square_;
};

}  // namespace HQP_ISA
}  // namespace hqp
