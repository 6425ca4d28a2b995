// An orthonormal basis of the rows of a working set, grown row by row: W = R' Q with Q (rank, N) and R upper
// triangular. Rows that pick one coordinate (frozen joints), as long as no other row came before, take it out of the
// rows that follow for nothing.
#pragma once

#include <cmath>
#include <vector>

#include "../solver/dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kDependent = 1e-10;  // what a row of unit length must keep to add a direction
constexpr double kUncertain = 1e-6;   // less than this, and more than rounding, is an uncertain direction

class RowSpace {
 public:
  RowSpace(int most, int ld)
      : ld_(ld),
        Q_(static_cast<std::size_t>(most) * ld, 0.0),
        R_(most * most),
        parts_(most),
        z_(most),
        picks_(most),
        most_(most) {}

  int rank() const { return rank_; }
  // Whether a direction was uncertain since this was last set to false.
  bool uncertain = false;
  void cut(int rank) {
    rank_ = rank;
    if (picked_ > rank) picked_ = rank;
  }
  const double* basis(int j) const { return &Q_[static_cast<std::size_t>(j) * ld_]; }

  // Whether the row, of unit length, adds a direction.  only: the place of its one entry, -1 where it has more.
  bool add(const double* row, int N, int only = -1) {
    if (rank_ == most_) return false;
    double* q = &Q_[static_cast<std::size_t>(rank_) * ld_];
    double* r = &R_[rank_];  // column rank_
    for (int j = 0; j < N; ++j) q[j] = row[j];
    for (int j = N; j < ld_; ++j) q[j] = 0.0;
    for (int j = 0; j < rank_; ++j) r[j * most_] = 0.0;
    if (only >= 0 && rank_ == picked_) return pick(only, q, r);
    double length = 0.0;
    for (int pass = 0; pass < 2; ++pass) {
      take_out(q, N);
      for (int j = 0; j < rank_; ++j) r[j * most_] += parts_[j];
      length = std::sqrt(dot_any(q, q, N));
      if (length > 0.7) break;  // little was taken out, and so little rounding is left
    }
    uncertain = uncertain || (length < kUncertain && length > 1e-14);
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
  bool pick(int at, double* q, double* r) {
    for (int k = 0; k < picked_; ++k)
      if (picks_[k] == at) return false;
    r[rank_ * most_] = q[at];
    q[at] = 1.0;
    picks_[picked_++] = at;
    ++rank_;
    return true;
  }

  // v less its parts along the basis; twice is enough for rounding.
  void take_out(double* v, int N) {
    for (int k = 0; k < picked_; ++k) {
      parts_[k] = v[picks_[k]];
      v[picks_[k]] = 0.0;
    }
    if (picked_ == rank_) return;
    const double* from = basis(picked_);
    dots_any(v, from, ld_, rank_ - picked_, N, &parts_[picked_]);
    add_rows(v, from, ld_, rank_ - picked_, -1.0, &parts_[picked_], 1, N);
  }

  int ld_;
  std::vector<double> Q_, R_, parts_, z_;
  std::vector<int> picks_;  // (picked), coordinates of the rows that pick one, which come first
  int most_, rank_ = 0, picked_ = 0;
};

}  // namespace HQP_ISA
}  // namespace hqp
