// Completion of an answer that levels leave undetermined: of the points x + Z z within the bounds of rows the one
// nearest to the origin, by the metric if there is one. The soft choice determines the rest (solver/soft_choice.hpp).
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/basis.hpp"
#include "../solver/metric_root.hpp"
#include "../solver/soft_rows.hpp"
#include "coordinates.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Choice {
 public:
  // n, rows: at most.
  Choice(int n, int rows) : n_(n), Z_(n), at_(n, kLost, kUncertain, true), rows_(n, rows) {
    const std::size_t all = static_cast<std::size_t>(n);
    for (auto* part : {&stack_, &root_}) part->resize(all * all);
    for (auto* part : {&z_, &step_, &target_}) part->resize(all);
    y_.resize(padded(n));
    a_.resize(static_cast<std::size_t>(rows) * all);
    bounds_.reserve(rows);
    at_.reserve(n);
  }

  // The directions in which x may move, to be filled before begin().
  Basis& basis() { return Z_; }
  // From x (n) on, without rows.
  void begin(const double* x) {
    x_ = x;
    unclear_ = false;
    bounds_.clear();
  }
  // Keep the value of a row a (n). All of these go before add().
  void hold(const double* a) {
    const double least = kDirection * std::sqrt(dot_any(a, a, n_)), seen = Z_.hold(a, least);
    unclear_ = unclear_ || (kEither * seen > least && seen < kEither * least);
  }
  // One more row a (n), within these bounds.
  void add(const double* a, double low, double high) {
    if (low == -INFINITY && high == INFINITY) return;
    double* b = &a_[bounds_.size() * static_cast<std::size_t>(Z_.count)];
    if (Z_.see(a, b) <= kDirection * std::sqrt(dot_any(a, a, n_))) return;
    const double value = dot_any(a, x_, n_);
    bounds_.push_back({b, smaller(low - value, 0.0), larger(high - value, 0.0)});
  }
  // True if a row that was held may see a direction or not.
  bool unclear() const { return unclear_; }

  // Move x, the point of begin(), to the answer; return false if that fails.  metric (n, n), origin (n), or null.
  bool take(const double* metric, const double* origin, double* x) {
    std::fill(z_.begin(), z_.end(), 0.0);
    if (!metric) by_length(origin);
    else if (!by_metric(metric, origin)) return true;
    rows_.begin(Z_.count);
    at_.motion(z_.data(), rows_.z());
    for (const Bound& row : bounds_) {
      at_.row(row.a, y_.data());
      const double length = std::sqrt(dot_any(y_.data(), y_.data(), Z_.count)),
                   base = dot_any(row.a, at_.still(), Z_.count);
      if (length == 0.0) continue;
      for (int j = 0; j < Z_.count; ++j) rows_.next()[j] = y_[j] / length;
      rows_.add(base / length, row.low / length, row.high / length, kMet, length);
    }
    if (!rows_.minimise()) return false;
    std::copy(rows_.z(), rows_.z() + Z_.count, y_.begin());
    at_.point(y_.data(), z_.data());
    Z_.add(x, 1.0, z_.data());
    return true;
  }

 private:
  // Coordinates y in which |y|^2 / 2 is half the square of the length of x + Z z - origin.
  void by_length(const double* origin) {
    at_.resize(Z_.count);
    away(origin);
    for (int q = 0; q < Z_.count; ++q)
      target_[q] = -dot_any(Z_.data() + static_cast<std::size_t>(q) * n_, step_.data(), n_);
    at_.set(nullptr, target_.data(), 0);
  }
  // As by_length(), with the length by the metric; return false if that sees no direction.
  bool by_metric(const double* metric, const double* origin) {
    at_.resize(Z_.count);
    const int rank = metric_root(metric, n_, root_.data(), step_.data());
    away(origin);
    std::fill(stack_.begin(), stack_.end(), 0.0);
    std::fill(target_.begin(), target_.end(), 0.0);
    bool sees = false;
    for (int i = 0; i < rank; ++i) {
      const double* a = &root_[static_cast<std::size_t>(i) * n_];
      double* b = &stack_[static_cast<std::size_t>(i) * Z_.count];
      dots_any(a, Z_.data(), n_, Z_.count, n_, b);
      if (dot_any(b, b, Z_.count) > kDirection * kDirection * dot_any(a, a, n_)) {
        target_[i] = -dot_any(a, step_.data(), n_);
        sees = true;
      } else {
        std::fill(b, b + Z_.count, 0.0);
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

  int n_;
  bool unclear_ = false;
  const double* x_ = nullptr;
  Basis Z_;
  Coordinates at_;
  SoftRows rows_;
  std::vector<Bound> bounds_;
  std::vector<double> stack_, root_, z_, step_, target_, y_, a_;
};

}  // namespace HQP_ISA
}  // namespace hqp
