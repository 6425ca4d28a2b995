// An orthonormal basis of the rows of a working set, grown row by row: W = R' Q with Q (rank, N) and R upper
// triangular.
#pragma once

#include <cmath>
#include <vector>

#include "../solver/dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kDependent = 1e-10;  // what a row of unit length must keep to add a direction

class RowSpace {
 public:
  RowSpace(int most, int ld)
      : ld_(ld), Q_(static_cast<std::size_t>(most) * ld, 0.0), R_(most * most), parts_(most), z_(most), most_(most) {}

  int rank() const { return rank_; }
  void cut(int rank) { rank_ = rank; }
  const double* basis(int j) const { return &Q_[static_cast<std::size_t>(j) * ld_]; }

  // Whether the row, of unit length, adds a direction.
  bool add(const double* row, int N) {
    if (rank_ == most_) return false;
    double* q = &Q_[static_cast<std::size_t>(rank_) * ld_];
    double* r = &R_[rank_];  // column rank_
    for (int j = 0; j < N; ++j) q[j] = row[j];
    for (int j = N; j < ld_; ++j) q[j] = 0.0;
    for (int j = 0; j < rank_; ++j) r[j * most_] = 0.0;
    double length = 0.0;
    for (int pass = 0; pass < 2; ++pass) {
      take_out(q, N);
      for (int j = 0; j < rank_; ++j) r[j * most_] += parts_[j];
      length = std::sqrt(dot_any(q, q, N));
      if (length > 0.7) break;  // little was taken out, and so little rounding is left
    }
    if (!(length > kDependent)) return false;
    for (int j = 0; j < N; ++j) q[j] /= length;
    r[rank_ * most_] = length;
    ++rank_;
    return true;
  }

  // y (N) = the shortest point with W y = b, b (rank).
  void shortest(const double* b, double* y, int N) {
    for (int j = 0; j < N; ++j) y[j] = 0.0;
    for (int k = 0; k < rank_; ++k) {
      double z = b[k];
      for (int j = 0; j < k; ++j) z -= R_[j * most_ + k] * z_[j];
      z_[k] = z / R_[k * most_ + k];
      add_any(y, basis(k), z_[k], N);
    }
  }

  // v (N) without its part in the row space.
  void project(double* v, int N) {
    for (int pass = 0; pass < 2; ++pass) take_out(v, N);
  }

  // lambda (rank) with W' lambda = the part of g (N) in the row space.
  void multipliers(const double* g, double* lambda, int N) {
    dots_any(g, Q_.data(), ld_, rank_, N, parts_.data());
    for (int k = rank_ - 1; k >= 0; --k) {
      double s = parts_[k];
      for (int j = k + 1; j < rank_; ++j) s -= R_[k * most_ + j] * lambda[j];
      lambda[k] = s / R_[k * most_ + k];
    }
  }

 private:
  // v less its parts along the basis; twice is enough for rounding.
  void take_out(double* v, int N) {
    dots_any(v, Q_.data(), ld_, rank_, N, parts_.data());
    subtract_rows(v, Q_.data(), ld_, rank_, parts_.data(), N);
  }

  int ld_;
  std::vector<double> Q_, R_, parts_, z_;
  int most_, rank_ = 0;
};

}  // namespace HQP_ISA
}  // namespace hqp
