// min ||M z - e|| + c/2 |z|^2 for rows M (m, N): z = M' (M M' + mu I)^-1 e with mu from a scalar equation. A few rows
// are rotated until they are orthogonal, so that each step of the equation costs O(m); for many M M' becomes
// tridiagonal, if mu is clear of rounding.
#pragma once

#include <cmath>
#include <vector>

#include "../solver/dense.hpp"
#include "../solver/rotation.hpp"
#include "../solver/tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr int kFew = 5;  // largest number of rotated rows: less than a pose has

class Secular {
 public:
  void reserve(std::size_t m) {
    for (auto* table : {&U_, &gram_}) table->reserve(m * m);
    for (auto* part : {&square_, &e_of_, &lambda_, &part_, &diagonal_, &beside_, &tau_}) part->reserve(m);
  }

  // Solve; few rows M (m, ld) are replaced by the rotated ones, and e (m) by U'e.
  void solve(double* M, int ld, int N, double* e, int m, double price) {
    m_ = m;
    reduced_ = m > kFew && reduced(M, ld, N, e, price);
    if (reduced_) return;
    U_.assign(static_cast<std::size_t>(m) * m, 0.0);
    square_.resize(m);
    for (int i = 0; i < m; ++i) U_[i * m + i] = 1.0;
    part_.resize(m);
    double size = 0.0;
    for (int i = 0; i < m; ++i) part_[i] = dot_any(M + i * ld, M + i * ld, N);
    rotate(M, ld, N, e);
    for (int i = 0; i < m; ++i) {
      square_[i] = dot_any(M + i * ld, M + i * ld, N);
      size = larger(size, std::abs(e[i]));
    }
    e_ = e;
    met_ = true;
    double reach = 0.0;
    for (int i = 0; i < m; ++i) {
      double own = 0.0;  // of the rows that it is made of
      for (int j = 0; j < m; ++j) own += U_[i * m + j] * U_[i * m + j] * part_[j];
      if (square_[i] <= kRounding * kRounding * own) {
        square_[i] = 0.0;
        if (std::abs(e[i]) > kOnRow * size) met_ = false;
      } else {
        uncertain = uncertain || square_[i] < kUncertain * kUncertain * own;
        const double u = e[i] / square_[i];
        reach += u * u;
      }
    }
    met_ = met_ && price * price * reach <= 1.0;
    multiplier_ = met_ || price == 0.0 ? 0.0 : root(price);
  }

  bool met() const { return met_; }
  // Set to true by an uncertain direction.
  bool uncertain = false;

  // Weight of row i, as solve has left it, in z.
  double weight(int i) const {
    if (reduced_) return lambda_[i];
    const double d = square_[i] + multiplier_;
    return square_[i] > 0.0 && d > 0.0 ? e_[i] / d : 0.0;
  }

  // u (m): w / ||w||, or the shortest multipliers if the level is met.
  void direction(double price, double* u) const {
    double length = 0.0;
    if (reduced_) {
      const double norm = std::sqrt(dot_any(lambda_.data(), lambda_.data(), m_));
      for (int i = 0; i < m_; ++i) u[i] = -lambda_[i] / norm;
      return;
    }
    for (int i = 0; i < m_; ++i) u[i] = 0.0;
    for (int i = 0; i < m_; ++i) {
      double part;
      if (met_) {
        part = square_[i] > 0.0 ? -price * e_[i] / square_[i] : 0.0;
      } else {
        part = square_[i] > 0.0 ? -e_[i] * multiplier_ / (square_[i] + multiplier_) : -e_[i];
        length += part * part;
      }
      add_any(u, &U_[i * m_], part, m_);
    }
    if (!met_ && length > 0.0)
      for (int i = 0; i < m_; ++i) u[i] /= std::sqrt(length);
  }

 private:
  // Find lambda_ = (M M' + mu I)^-1 e with |lambda_| = 1 / c; return false if mu is not clear of rounding, or the level
  // is met. Newton on 1 / |lambda_|, which is concave in mu, stays left of the root; it starts from the bound |lambda_|
  // >= |e| / (rho + mu), rho the Rayleigh quotient of e.
  bool reduced(const double* M, int ld, int N, const double* e, double price) {
    const int m = m_;
    gram_.resize(static_cast<std::size_t>(m) * m);
    for (auto* part : {&e_of_, &lambda_, &part_, &diagonal_, &beside_, &tau_}) part->resize(m);
    double largest = 0.0;
    for (int i = 0; i < m; ++i) {
      dots_any(M + i * ld, M, ld, i + 1, N, &gram_[i * m]);
      for (int j = 0; j < i; ++j) gram_[j * m + i] = gram_[i * m + j];
      largest += gram_[i * (m + 1)];
    }
    const double least = kClearOf * largest, size = std::sqrt(dot_any(e, e, m));
    if (!(price * size > least)) return false;
    std::copy(e, e + m, e_of_.begin());
    tridiagonal();
    double rayleigh = 0.0;
    for (int i = 0; i < m; ++i)
      rayleigh += e_of_[i] * (diagonal_[i] * e_of_[i] + (i ? 2.0 * beside_[i - 1] * e_of_[i - 1] : 0.0));
    multiplier_ = larger(least, price * size - rayleigh / (size * size));
    double off = INFINITY, slope;
    for (int step = 0; step < kEnough; ++step) {
      const double square = at(multiplier_, slope), psi = 1.0 / std::sqrt(square);
      if (!(square > 0.0 && std::isfinite(square))) return false;
      if (step == 0 && multiplier_ == least && !(psi < price)) return false;  // the root lies below
      if (!(std::abs(off) > kLost * multiplier_)) break;
      off = (price - psi) / (psi * psi * psi * slope);
      multiplier_ += off;
    }
    for (int k = m - 3; k >= 0; --k) reflect(k, lambda_.data());
    met_ = false;
    return true;
  }

  // gram_ = Q T Q' with T (diagonal_, beside_) tridiagonal, Q the reflections that its rows become; e_of_ := Q' e_of_.
  void tridiagonal() {
    const int m = m_;
    for (int k = 0; k < m; ++k) {
      const int rest = m - k - 1;
      double *v = &gram_[k * m + k + 1], *A = v + m, *w = part_.data();
      diagonal_[k] = v[-1];
      if (rest == 0) continue;
      const double length = std::sqrt(dot_any(v, v, rest));
      beside_[k] = v[0];
      tau_[k] = 0.0;
      if (rest == 1 || length == 0.0) continue;
      beside_[k] = v[0] > 0.0 ? -length : length;
      tau_[k] = 1.0 / (length * (length + std::abs(v[0])));
      v[0] -= beside_[k];
      dots_any(v, A, m, rest, rest, w);
      const double half = 0.5 * tau_[k] * dot_any(v, w, rest);
      for (int i = 0; i < rest; ++i) w[i] = tau_[k] * (w[i] - half * v[i]);
      for (int i = 0; i < rest; ++i) {
        add_any(A + i * m, v, -w[i], rest);
        add_any(A + i * m, w, -v[i], rest);
      }
      reflect(k, e_of_.data());
    }
  }
  void reflect(int k, double* y) const {
    const int rest = m_ - k - 1;
    const double* v = &gram_[k * m_ + k + 1];
    add_any(y + k + 1, v, -tau_[k] * dot_any(v, y + k + 1, rest), rest);
  }

  // lambda_ = (T + mu I)^-1 e_of_, |lambda_|^2, and slope = lambda_' (T + mu I)^-1 lambda_.
  double at(double mu, double& slope) {
    const int m = m_;
    double square = 0.0, before = 0.0, ratio = 0.0;
    for (int i = 0; i < m; ++i) {  // T + mu I = L D L', part_ the inverse of D
      part_[i] = 1.0 / (diagonal_[i] + mu - (i ? ratio * beside_[i - 1] : 0.0));
      lambda_[i] = before = e_of_[i] - ratio * before;
      ratio = beside_[i] * part_[i];
    }
    for (int i = m - 1; i >= 0; --i) {
      lambda_[i] = part_[i] * (lambda_[i] - (i + 1 < m ? beside_[i] * lambda_[i + 1] : 0.0));
      square += lambda_[i] * lambda_[i];
    }
    slope = before = 0.0;
    for (int i = 0; i < m; ++i) {
      before = lambda_[i] - (i ? beside_[i - 1] * part_[i - 1] * before : 0.0);
      slope += before * before * part_[i];
    }
    return square;
  }

  // One-sided Jacobi: pairs of rows are rotated until all are orthogonal.
  void rotate(double* M, int ld, int N, double* e) {
    for (int sweep = 0; sweep < kEnough; ++sweep) {
      bool done = true;
      for (int i = 0; i + 1 < m_; ++i) {
        for (int j = i + 1; j < m_; ++j) {
          double *a = M + i * ld, *b = M + j * ld;
          const double aa = dot_any(a, a, N), bb = dot_any(b, b, N), ab = dot_any(a, b, N);
          if (std::abs(ab) <= kLastDigits * std::sqrt(aa * bb) || ab == 0.0) continue;
          done = false;
          const Rotation rotation(aa, bb, ab);
          rotation.turn(a, b, N);
          rotation.turn(&U_[i * m_], &U_[j * m_], m_);
          rotation.turn(e + i, e + j, 1);
        }
      }
      if (done) return;
    }
  }

  // mu with sum (e_i / (s_i^2 + mu))^2 = 1 / c^2: Newton on its inverse root, from the left, halving where it leaves.
  double root(double price) const {
    double low = 0.0, norm = 0.0;
    for (int i = 0; i < m_; ++i) {
      low = larger(low, std::abs(e_[i]) * price - square_[i]);
      norm += e_[i] * e_[i];
    }
    double high = price * std::sqrt(norm), mu = larger(low, kTiny);
    for (int step = 0; step < kEnough; ++step) {
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
      if (std::abs(next - mu) <= kLastDigits * mu) return next;
      mu = next;
    }
    return mu;
  }

  int m_ = 0;
  bool met_ = false, reduced_ = false;
  double multiplier_ = 0.0;
  const double* e_ = nullptr;
  std::vector<double> U_, square_, gram_, e_of_, lambda_, part_, diagonal_, beside_, tau_;
};

}  // namespace HQP_ISA
}  // namespace hqp
