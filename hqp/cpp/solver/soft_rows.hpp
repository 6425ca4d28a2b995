// min 1/2 |z|^2 + sum of squared excesses of rows, each divided by 2 softness^2. It is strictly convex: an error e of a
// row moves z by at most e / (2 softness), however many rows are at their bounds and however little they differ.
// Newton's method: on the rows exceeded this is a least-squares problem (Householder, longest rows first).
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "row_sorted_least_squares.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class SoftRows {
 public:
  SoftRows(int n, int rows) {
    const std::size_t width = static_cast<std::size_t>(n), all = static_cast<std::size_t>(rows);
    for (auto* part : {&z_, &step_}) part->resize(width);
    for (auto* part : {&low_, &high_, &base_, &value_, &slope_, &soft_, &length_}) part->resize(all);
    rows_.resize(all * width);
    side_.resize(all);
    order_.resize(all);
    least_.layout(arena_, n, n + rows);
    arena_.take();
    least_.layout(arena_, n, n + rows);
  }

  // Of `free` variables, without rows; z is to be filled.
  void begin(int free) { free_ = free, count_ = 0; }
  double* z() { return z_.data(); }
  // Coefficients (free) of the next row, to be filled before add().
  double* next() { return &rows_[static_cast<std::size_t>(count_) * free_]; }
  // low <= base + next() z <= high; length: the row's before it was divided by it.
  void add(double base, double low, double high, double soft, double length) {
    base_[count_] = base, low_[count_] = low, high_[count_] = high;
    soft_[count_] = soft, length_[count_++] = length;
  }

  // z goes to the minimum; false if it is not found.
  bool minimise() {
    look();
    for (int k = 0; k < count_; ++k) {
      const double out = off(k, value_[k]);
      side_[k] = is_equality(k) || out > 0.0 ? 1 : out < 0.0 ? -1 : 0;
    }
    double last = INFINITY;  // the square of the step before, on the same rows: it shrinks until it is rounding
    for (int round = 0; round < kEnough && solve(); ++round) {
      for (int k = 0; k < count_; ++k) slope_[k] = dot_any(row(k), step_.data(), free_);
      const double length = dot_any(step_.data(), step_.data(), free_), size = dot_any(z_.data(), z_.data(), free_);
      const bool small = length <= kSeen * kSeen * (1.0 + size);
      double far = 1.0, low = 0.0;
      if (!small && rise(1.0) > 0.0)
        for (int half = 0; half < kEnough; ++half) {
          const double middle = 0.5 * (low + far);
          if (!(middle > low && middle < far)) break;
          (rise(middle) > 0.0 ? far : low) = middle;
        }
      const bool other = arrive(), whole = !other || far == 1.0;
      if (!whole) pass(far);
      add_any(z_.data(), step_.data(), whole ? 1.0 : far, free_);
      look();
      if (!other && (small || kEither * kEither * length > last)) return true;
      last = other ? INFINITY : length;
    }
    return false;
  }

  // Return true if no row is violated at z, by this share of 1 + |bound| before its division by its length.
  bool kept(double share) const {
    for (int k = 0; k < count_; ++k) {
      const double out = off(k, value_[k]), bound = out > 0.0 ? high_[k] : low_[k];
      if (std::fabs(out) > share * (1.0 / length_[k] + std::fabs(bound))) return false;
    }
    return true;
  }

 private:
  const double* row(int k) const { return &rows_[static_cast<std::size_t>(k) * free_]; }

  double off(int k, double value) const {
    return value > high_[k] ? value - high_[k] : value < low_[k] ? value - low_[k] : 0.0;
  }

  // An equality counts as exceeded wherever z is.
  bool is_equality(int k) const { return low_[k] == high_[k]; }

  // value_ at z_.
  void look() {
    for (int k = 0; k < count_; ++k) value_[k] = base_[k] + dot_any(row(k), z_.data(), free_);
  }
  double bound(int k) const { return side_[k] > 0 ? high_[k] : low_[k]; }

  // Set side_ to the rows exceeded after step_; return true if other rows were exceeded before. solve() has the excess
  // of a row more accurately than its value: the excess of a stiff row is less than rounding of its bound. Other rows
  // count if they are exceeded by more than rounding.
  bool arrive() {
    bool other = false;
    for (int k = 0; k < count_; ++k) {
      if (is_equality(k) || (side_[k] && side_[k] * ((value_[k] - bound(k)) + slope_[k]) >= 0.0)) continue;
      const double there = value_[k] + slope_[k], out = off(k, there);
      const double rounding = kLastDigits * (std::fabs(base_[k]) + std::fabs(there));
      const int now = out > rounding ? 1 : out < -rounding ? -1 : 0;
      other = other || now != side_[k];
      side_[k] = now;
    }
    return other;
  }

  // side_: the rows exceeded behind the point that far along step_. Stiff rows are exceeded there by less than
  // rounding.
  void pass(double far) {
    for (int k = 0; k < count_; ++k) {
      const double slope = slope_[k], end = far * (1.0 + kLastDigits);
      if (slope == 0.0 || is_equality(k)) continue;
      const double up = (high_[k] - value_[k]) / slope, down = (low_[k] - value_[k]) / slope;
      const bool above = slope > 0.0 ? up <= end : up > end, below = slope > 0.0 ? down > end : down <= end;
      side_[k] = above && high_[k] < INFINITY ? 1 : below && low_[k] > -INFINITY ? -1 : 0;
    }
  }

  // How fast the value rises along step_, that far along it.
  double rise(double far) const {
    double sum = 0.0;
    for (int j = 0; j < free_; ++j) sum += (z_[j] + far * step_[j]) * step_[j];
    for (int k = 0; k < count_; ++k) sum += off(k, value_[k] + far * slope_[k]) / soft_[k] * (slope_[k] / soft_[k]);
    return sum;
  }

  // step_: from z_ to the minimiser if the rows of side_ were equalities and there were no others; the hardest rows
  // before the others, below them the identity. False if numbers are not finite.
  bool solve() {
    int m = 0;
    for (int k = 0; k < count_; ++k) {
      if (!side_[k]) continue;
      int at = m++;
      for (; at > 0 && soft_[order_[at - 1]] > soft_[k]; --at) order_[at] = order_[at - 1];
      order_[at] = k;
    }
    for (int i = 0; i < m; ++i) {
      const int k = order_[i];
      least_.set(i, row(k), free_, 1.0 / soft_[k], (bound(k) - value_[k]) / soft_[k]);
    }
    for (int j = 0; j < free_; ++j) {
      std::fill(step_.begin(), step_.end(), 0.0);
      step_[j] = 1.0;
      least_.set(m + j, step_.data(), free_, 1.0, -z_[j]);
    }
    least_.solve(m + free_, free_, 0.0);
    std::copy(least_.z, least_.z + free_, step_.begin());
    return std::isfinite(dot_any(step_.data(), step_.data(), free_));
  }

  Arena arena_;
  RowSortedLeastSquares least_;
  int free_ = 0, count_ = 0;
  std::vector<double> z_, step_, rows_, low_, high_, base_, value_, slope_, soft_, length_;
  std::vector<int> side_, order_;
};

}  // namespace HQP_ISA
}  // namespace hqp
