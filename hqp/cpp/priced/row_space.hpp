// The rows of a working set, grown row by row: Q' a of a row a (N) has entries at the pivots of the rows before it and
// at its own alone, Q a product of reflections. Each takes the largest remaining entry of its row as pivot, so that
// coordinates of very different size keep their own rounding (Cox and Higham 1998). Rows that pick one coordinate
// (frozen joints) need no reflection as long as no other row came before.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/dense.hpp"
#include "../solver/tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class RowSpace {
 public:
  // rounded: remainder of a dependent row by rounding, relative to its length.
  RowSpace(int most, int ld, double rounded)
      : rounded_(rounded),
        ld_(ld),
        most_(most),
        V_(static_cast<std::size_t>(most) * ld, 0.0),
        tau_(most),
        R_(static_cast<std::size_t>(most) * most),
        pivot_(most),
        end_(most),
        used_(ld, 0),
        square_(ld) {}

  int rank() const { return rank_; }
  // Return true if the first `count` rows determine coordinate j.
  bool determines(int j, int count) const { return used_[j] != 0 && used_[j] <= count; }
  // Set to true by an uncertain direction.
  bool uncertain = false;
  double threshold = kDirection;  // share of a row's length: a row that keeps more adds a direction
  double closest = INFINITY;      // nearest a row came to kDirection, as a ratio >= 1

  // Return true if the remainder of a row of this length is a direction.
  bool counts(double rest, double size, double rounding) {
    if (rest > rounding) closest = smaller(closest, larger(rest / (kDirection * size), kDirection * size / rest));
    return rest > larger(threshold * size, rounding);
  }

  void cut(int rank) {
    for (int k = rank; k < rank_; ++k) used_[pivot_[k]] = 0;
    rank_ = rank;
    if (picked_ > rank) picked_ = rank;
  }

  // Return true if picking rows need no reflection: no other row came before.
  bool picks() const { return rank_ == picked_; }
  // Add a picking row with its entry at j; return true if it adds a direction.
  bool pick(int j, double entry) {
    if (used_[j] || rank_ == most_) return false;
    double* r = &R_[static_cast<std::size_t>(rank_) * most_];
    std::fill(r, r + rank_, 0.0);
    r[rank_] = entry;
    pivot_[rank_++] = j;
    used_[j] = picked_ = rank_;
    return true;
  }
  // Add any row; return true if it adds a direction.  grade: length of a unit of a coordinate in the unit of size (the
  // row's length) and of rounding (a zero length); turned: number of first rows whose reflections are applied already.
  bool add(const double* row, int N, const double* grade, double size, double rounding, int turned = 0) {
    if (rank_ == most_) return false;
    double *v = &V_[static_cast<std::size_t>(rank_) * ld_], *r = &R_[static_cast<std::size_t>(rank_) * most_];
    std::copy(row, row + N, v);
    turn(v, N, turned, rank_);
    split(v, r);
    std::fill(v + N, v + lanes(N), 0.0);
    Vec4 own = splat(0.0), graded = own;
    for (int j = 0; j < N; j += kLane) {
      const Vec4 a = unaligned(v + j), g = a * unaligned(grade + j);
      own += unaligned(&square_[j]) = a * a;
      graded += g * g;
    }
    const double square = sum(own), rest = std::sqrt(sum(graded));
    const int p = largest(square_.data(), lanes(N));
    uncertain = uncertain || (rest < kUncertain * size && rest > larger(rounded_ * size, rounding));
    if (!counts(rest, size, rounding)) return false;
    const double length = std::sqrt(square);
    r[rank_] = v[p] > 0.0 ? -length : length;
    tau_[rank_] = 1.0 / (length * (length + std::fabs(v[p])));
    v[p] -= r[rank_];
    int end = N;
    while (v[end - 1] == 0.0) --end;
    end_[rank_] = lanes(end);
    pivot_[rank_++] = p;
    used_[p] = rank_;
    return true;
  }

  // v (N) := Q' v.
  void turn(double* v, int N) const { turn(v, N, 0, rank_); }
  // Apply the reflections of rows first to last.
  void turn(double* v, int N, int first, int last) const {
    for (int k = first > picked_ ? first : picked_; k < last; ++k) reflect(k, v, N);
  }
  // Apply them to rows (count, ld), N in whole vectors, four at a time.
  void turn(double* rows, int ld, int count, int N, int first, int last) const {
    int i = 0;
    for (; i + 4 <= count; i += 4)
      for (int k = first > picked_ ? first : picked_; k < last; ++k)
        reflect_four(k, rows + static_cast<std::size_t>(i) * ld, ld, N);
    for (; i < count; ++i) turn(rows + static_cast<std::size_t>(i) * ld, N, first, last);
  }
  // v (N) := Q v.
  void turn_back(double* v, int N) const {
    for (int k = rank_ - 1; k >= picked_; --k) reflect(k, v, N);
  }
  // Move the part (rank) of a turned vector in the space of the rows from v to part.
  void split(double* v, double* part) const {
    for (int k = 0; k < rank_; ++k) {
      part[k] = v[pivot_[k]];
      v[pivot_[k]] = 0.0;
    }
  }
  void join(double* v, const double* part) const {
    for (int k = 0; k < rank_; ++k) v[pivot_[k]] = part[k];
  }

  // part (rank) of the points y with a y = b for every row, b (rank).
  void meet(const double* b, double* part) const {
    for (int k = 0; k < rank_; ++k) {
      const double* r = &R_[static_cast<std::size_t>(k) * most_];
      part[k] = (b[k] - dot_any(r, part, k)) / r[k];
    }
  }

  // Move part (rank) by the least that changes the row added last by b, to its error; grown (rank): how far errors of
  // the rows move each entry.
  void reach(double b, double error, double* part, double* grown) const {
    const int k = rank_ - 1;
    const double* r = &R_[static_cast<std::size_t>(k) * most_];
    for (int j = 0; j < k; ++j) error += std::fabs(r[j]) * grown[j];
    const double by = b - dot_any(r, part, k);
    grown[k] = error / std::fabs(r[k]);
    part[k] = std::copysign(larger(std::fabs(by) - error, 0.0), by) / r[k];
  }

  // lambda (rank): the sum of lambda_k a_k has this part.
  void multipliers(const double* part, double* lambda) const {
    for (int k = 0; k < rank_; ++k) lambda[k] = part[k];
    for (int k = rank_ - 1; k >= 0; --k) {
      const double* r = &R_[static_cast<std::size_t>(k) * most_];
      lambda[k] /= r[k];
      add_any(lambda, r, -lambda[k], k);
    }
  }

 private:
  void reflect(int k, double* v, int N) const {
    const int end = std::min(end_[k], N);
    const double* u = &V_[static_cast<std::size_t>(k) * ld_];
    const double f = tau_[k] * dot_any(u, v, end);
    if (f != 0.0) add_any(v, u, -f, end);
  }

  void reflect_four(int k, double* rows, int ld, int N) const {
    const int end = std::min(end_[k], N);
    const double* u = &V_[static_cast<std::size_t>(k) * ld_];
    double* v[4];
    Vec4 f[4];
    for (int r = 0; r < 4; ++r) v[r] = rows + static_cast<std::size_t>(r) * ld, f[r] = splat(0.0);
    for (int j = 0; j < end; j += kLane) {
      const Vec4 a = unaligned(u + j);
      for (int r = 0; r < 4; ++r) f[r] += a * unaligned(v[r] + j);
    }
    for (int r = 0; r < 4; ++r) f[r] = splat(tau_[k] * sum(f[r]));
    for (int j = 0; j < end; j += kLane) {
      const Vec4 a = unaligned(u + j);
      for (int r = 0; r < 4; ++r) unaligned(v[r] + j) -= a * f[r];
    }
  }

  double rounded_;
  int ld_, most_, rank_ = 0, picked_ = 0;
  std::vector<double> V_, tau_, R_;      // R_: row k the part of row k of the set
  std::vector<int> pivot_, end_, used_;  // end_: last entry of a reflection; used_: row of a coordinate, from 1 on, 0
                                         // without one
  std::vector<double> square_;           // squared remainder of a row
};

}  // namespace HQP_ISA
}  // namespace hqp
