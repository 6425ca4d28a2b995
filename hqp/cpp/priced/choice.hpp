// Completion of an answer that levels leave undetermined: of the points x + Z z within the bounds of rows the one
// nearest to the origin, by the metric if there is one. The soft choice determines the rest (solver/soft_choice.hpp).
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/metric_root.hpp"
#include "../solver/soft_rows.hpp"
#include "coordinates.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Choice {
 public:
  // n, rows: at most.
  Choice(int n, int rows) : n_(n), at_(n, kLost, kUncertain, true), rows_(n, rows) {
    const std::size_t all = static_cast<std::size_t>(n);
    for (auto* part : {&Z_, &stack_, &root_}) part->resize(all * all);
    for (auto* part : {&z_, &step_, &target_}) part->resize(all);
    y_.resize(padded(n));
    a_.resize(static_cast<std::size_t>(rows) * all);
    bounds_.reserve(rows);
    at_.reserve(n);
  }

  // Z (free, n), orthonormal, to be filled before begin().
  double* basis() { return Z_.data(); }
  // Take count directions (count, n), orthonormal, out of the basis, which spans them; return how many are left.
  int reduce(int free, const double* unseen, int count) {
    for (int q = 0; q < free; ++q) {
      double* z = &Z_[static_cast<std::size_t>(q) * n_];
      for (int pass = 0; pass < 2; ++pass)
        for (int k = 0; k < count; ++k) {
          const double* u = unseen + static_cast<std::ptrdiff_t>(k) * n_;
          add_any(z, u, -dot_any(u, z, n_), n_);
        }
    }
    if (!count) return free;
    const int left = std::max(free - count, 0);
    for (int found = 0; found < left; ++found) {  // the longest remainder first
      double* to = &Z_[static_cast<std::size_t>(found) * n_];
      double *best = to, most = -1.0;
      for (int q = found; q < free; ++q) {
        double* z = &Z_[static_cast<std::size_t>(q) * n_];
        if (const double size = dot_any(z, z, n_); size > most) most = size, best = z;
      }
      if (best != to) std::swap_ranges(to, to + n_, best);
      scale(to, n_, 1.0 / std::sqrt(most));
      for (int q = found + 1; q < free; ++q) {
        double* z = &Z_[static_cast<std::size_t>(q) * n_];
        for (int pass = 0; pass < 2; ++pass) add_any(z, to, -dot_any(to, z, n_), n_);
      }
    }
    return left;
  }
  // From x (n) on, without rows.
  void begin(int free, const double* x) {
    free_ = free;
    x_ = x;
    unclear_ = false;
    bounds_.clear();
  }
  // Keep the value of a row a (n): the basis loses the direction that it sees. All of these go before add().
  void hold(const double* a) {
    double* const b = y_.data();
    const double length = std::sqrt(dot_any(a, a, n_)), seen = see(a, b);
    if (length > 0.0 && seen > kDirection / kEither * length && seen < kDirection * kEither * length) unclear_ = true;
    if (seen <= kDirection * length) return;
    b[0] += b[0] < 0.0 ? -seen : seen;  // reflect the basis so that its first direction is the one
    std::fill(step_.begin(), step_.end(), 0.0);
    add_rows(step_.data(), Z_.data(), n_, free_, 2.0 / dot_any(b, b, free_), b, 1, n_);
    for (int q = 1; q < free_; ++q) add_any(&Z_[static_cast<std::size_t>(q) * n_], step_.data(), -b[q], n_);
    std::copy(Z_.begin() + n_, Z_.begin() + static_cast<std::ptrdiff_t>(free_--) * n_, Z_.begin());
  }
  // One more row a (n), within these bounds.
  void add(const double* a, double low, double high) {
    if (low == -INFINITY && high == INFINITY) return;
    double* b = &a_[bounds_.size() * static_cast<std::size_t>(free_)];
    if (see(a, b) <= kDirection * std::sqrt(dot_any(a, a, n_))) return;
    const double value = dot_any(a, x_, n_);
    bounds_.push_back({b, smaller(low - value, 0.0), larger(high - value, 0.0)});
  }
  int free() const { return free_; }
  // True if a row that was held may see a direction or not.
  bool unclear() const { return unclear_; }

  // Move x, the point of begin(), to the answer; return false if that fails.  metric (n, n), origin (n), or null.
  bool take(const double* metric, const double* origin, double* x) {
    std::fill(z_.begin(), z_.end(), 0.0);
    if (!metric) by_length(origin);
    else if (!by_metric(metric, origin)) return true;
    rows_.begin(free_);
    at_.motion(z_.data(), rows_.z());
    for (const Bound& row : bounds_) {
      at_.row(row.a, y_.data());
      const double length = std::sqrt(dot_any(y_.data(), y_.data(), free_)), base = dot_any(row.a, at_.still(), free_);
      if (length == 0.0) continue;
      for (int j = 0; j < free_; ++j) rows_.next()[j] = y_[j] / length;
      rows_.add(base / length, row.low / length, row.high / length, kMet, length);
    }
    if (!rows_.minimise()) return false;
    std::copy(rows_.z(), rows_.z() + free_, y_.begin());
    at_.point(y_.data(), z_.data());
    add_rows(x, Z_.data(), n_, free_, 1.0, z_.data(), 1, n_);
    return true;
  }

 private:
  // b (free,) = a along the basis; its length.
  double see(const double* a, double* b) const {
    dots_any(a, Z_.data(), n_, free_, n_, b);
    return std::sqrt(dot_any(b, b, free_));
  }
  // Coordinates y in which |y|^2 / 2 is half the square of the length of x + Z z - origin.
  void by_length(const double* origin) {
    at_.resize(free_);
    away(origin);
    for (int q = 0; q < free_; ++q)
      target_[q] = -dot_any(Z_.data() + static_cast<std::size_t>(q) * n_, step_.data(), n_);
    at_.set(nullptr, target_.data(), 0);
  }
  // As by_length(), with the length by the metric; return false if that sees no direction.
  bool by_metric(const double* metric, const double* origin) {
    at_.resize(free_);
    const int rank = metric_root(metric, n_, root_.data(), step_.data());
    away(origin);
    std::fill(stack_.begin(), stack_.end(), 0.0);
    std::fill(target_.begin(), target_.end(), 0.0);
    bool sees = false;
    for (int i = 0; i < rank; ++i) {
      const double* a = &root_[static_cast<std::size_t>(i) * n_];
      double* b = &stack_[static_cast<std::size_t>(i) * free_];
      dots_any(a, Z_.data(), n_, free_, n_, b);
      if (dot_any(b, b, free_) > kDirection * kDirection * dot_any(a, a, n_)) {
        target_[i] = -dot_any(a, step_.data(), n_);
        sees = true;
      } else {
        std::fill(b, b + free_, 0.0);
      }
    }
    if (sees) at_.set(stack_.data(), target_.data(), rank);
    return sees;
  }
  void away(const double* origin) {
    for (int j = 0; j < n_; ++j) step_[j] = x_[j] - (origin ? origin[j] : 0.0);
  }

  // A row along the basis, and its bounds from x on.
  struct Bound {
    const double* a;
    double low, high;
  };

  int n_, free_ = 0;
  bool unclear_ = false;
  const double* x_ = nullptr;
  Coordinates at_;
  SoftRows rows_;
  std::vector<Bound> bounds_;
  std::vector<double> Z_, stack_, root_, z_, step_, target_, y_, a_;
};

}  // namespace HQP_ISA
}  // namespace hqp
