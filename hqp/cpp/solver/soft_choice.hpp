// Completion if the metric is singular: along directions that neither the metric nor a level below the constraints
// sees, x minimises |x|^2 / 2 + sum over rows of the constraints, of unit length, of excess^2 / (2 softness^2). That is
// strictly convex: an error e of a row moves x by at most e / (2 softness), however many rows are at their bounds and
// however little they differ, and a row is exceeded by at most softness |y|, y any point within all rows. Newton's
// method: on the rows exceeded this is a least-squares problem (Householder, longest rows first).
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "dense.hpp"
#include "metric_root.hpp"
#include "problem.hpp"
#include "violated.hpp"

namespace hqp {
inline namespace HQP_ISA {

class SoftChoice {
 public:
  static constexpr double kHard = 1e-11;  // a softness that keeps rows to their bounds but for rounding
  // Softness of bounds on single variables, relative to that of other rows: commands keep these bounds.
  static constexpr double kSingle = 1e-2;

  SoftChoice(int n, int rows, bool metric) : n_(n) {
    if (!metric) return;
    const std::size_t width = static_cast<std::size_t>(n), all = static_cast<std::size_t>(rows);
    for (auto* part : {&root_, &Z_, &other_, &seen_}) part->resize(width * width);
    for (auto* part : {&left_, &own_, &z_, &start_, &step_, &a_}) part->resize(width);
    for (auto* part : {&low_, &high_, &base_, &value_, &slope_, &soft_, &length_, &rooms_, &allowed_})
      part->resize(all);
    rows_.resize(all * width);
    M_.resize((all + width) * (width + 1));
    side_.resize(all);
    order_.resize(std::max(all, width));
    pivots_.resize(width);
  }

  // x (n), a point within the rows, moves to the minimiser, or with `hard` any x to a point within the rows; false if
  // no direction is free or numbers are not finite, and x stays.
  bool take(const Problem& problem, double softness, double* x, bool hard = false) {
    free_ = 0;
    if (!problem.metric || !(softness > 0.0) || !find(problem)) return false;
    const double size = std::sqrt(dot_any(x, x, n_));
    if (!(size < INFINITY)) return false;
    dots_any(x, Z_.data(), n_, free_, n_, z_.data());
    add_rows(x, Z_.data(), n_, free_, -1.0, z_.data(), 1, n_);
    most_ = softness * size;
    if (hard) {  // x may be a soft minimum: shorter than all points within the rows
      std::copy(z_.begin(), z_.begin() + free_, start_.begin());
      gather(problem, softness, INFINITY, hard, x);
      minimise();
      if (kept()) most_ = softness * larger(size, std::sqrt(dot_any(x, x, n_) + dot_any(z_.data(), z_.data(), free_)));
      std::copy(start_.begin(), start_.begin() + free_, z_.begin());
    }
    gather(problem, softness, most_, hard, x);
    minimise();
    add_rows(x, Z_.data(), n_, free_, 1.0, z_.data(), 1, n_);
    return true;
  }

  // By how much each row of the constraints may be exceeded after take(); null if by nothing.
  const double* allowed() {
    if (!free_) return nullptr;
    for (int i = 0; i < read_; ++i) allowed_[i] = most_ * rooms_[i];
    return allowed_.data();
  }

 private:
  // Of the longest row: directions that a row sees less of are free of it. Rounding of rows that are products leaves
  // 1e-12; coefficients of forces are 1e-3 and above.
  static constexpr double kSeen = 1e-9;
  static constexpr double kStill = 1e-9;      // a step after which the rows that count as exceeded are certain
  static constexpr double kRounding = 1e-15;  // of a row, relative to its terms
  static constexpr int kRounds = 100, kHalvings = 60;

  double* Z(int j) { return &Z_[static_cast<std::size_t>(j) * n_]; }
  const double* row(int k) const { return &rows_[static_cast<std::size_t>(k) * free_]; }

  // Call with every row a (n) of levels from..to and its bounds.
  template <class Call>
  void for_each(const Problem& problem, int from, int to, const Call& call) {
    for (int k = from; k < to; ++k) {
      const Level& level = problem.levels[k];
      for (int i = 0; i < level.m; ++i) {
        const double* a = level.A + static_cast<std::ptrdiff_t>(i) * n_;
        if (!level.A) {
          std::fill(a_.begin(), a_.end(), 0.0);
          a_[level.index[i]] = level.scale[i];
          a = a_.data();
        }
        call(a, level.lower[i], level.upper[i]);
      }
    }
  }

  // The length of a row that sees a free direction, else 0.
  double room(const double* a) {
    dots_any(a, Z_.data(), n_, free_, n_, own_.data());
    const double length = std::sqrt(dot_any(a, a, n_));
    return std::sqrt(dot_any(own_.data(), own_.data(), free_)) > kSeen * length ? length : 0.0;
  }

  // Z (free, n), orthonormal: the null space of the metric, but for what levels or the motion see.
  bool find(const Problem& problem) {
    const int rank = metric_root(problem.metric, n_, root_.data(), left_.data(), pivots_.data());
    if (rank < 0 || rank == n_) return false;
    for (int j = 0; j < n_; ++j) {
      if (left_[j] < 0.0) continue;  // a pivot
      double* z = Z(free_++);
      std::fill(z, z + n_, 0.0);
      z[j] = 1.0;
      for (int k = rank - 1; k >= 0; --k) {
        const double* r = &root_[static_cast<std::size_t>(k) * n_];
        z[pivots_[k]] = -dot_any(r, z, n_) / r[pivots_[k]];
      }
    }
    for (int j = 0; j < free_; ++j) unit(Z_.data(), j, n_);
    narrow(problem);
    return free_ > 0;
  }

  // Vector j (width) orthonormal to those before it; its length beforehand.
  static double unit(double* vectors, int j, int width) {
    double *v = vectors + static_cast<std::ptrdiff_t>(j) * width, length = 0.0;
    for (int pass = 0; pass < 2; ++pass) {
      for (int i = 0; i < j; ++i) {
        const double* u = vectors + static_cast<std::ptrdiff_t>(i) * width;
        add_any(v, u, -dot_any(u, v, width), width);
      }
      const double left = std::sqrt(dot_any(v, v, width));
      if (pass == 0) length = left;
      if (left > 0.0) scale(v, width, 1.0 / left);
    }
    return length;
  }

  // Take out of Z what levels below the constraints, or the motion, see.
  void narrow(const Problem& problem) {
    double longest = 0.0;
    const auto all = [&](const auto& call) {
      for_each(problem, problem.constraints, problem.count, [&](const double* a, double low, double high) {
        if (low != -INFINITY || high != INFINITY) call(a);
      });
      for (int i = 0; i < problem.motion_rows; ++i) call(problem.motion + static_cast<std::ptrdiff_t>(i) * n_);
    };
    all([&](const double* a) { longest = larger(longest, dot_any(a, a, n_)); });
    longest = std::sqrt(longest);
    int seen = 0;
    all([&](const double* a) {
      if (seen == free_) return;
      double* s = &seen_[static_cast<std::size_t>(seen) * free_];
      dots_any(a, Z_.data(), n_, free_, n_, s);
      if (std::sqrt(dot_any(s, s, free_)) <= kSeen * longest) return;
      if (unit(seen_.data(), seen, free_) > kSeen * longest) ++seen;
    });
    if (!seen) return;
    const int rest = free_ - seen;
    for (int found = 0; found < rest; ++found) {  // complete the basis seen_ by the axes furthest from it
      double* to = &seen_[static_cast<std::size_t>(seen + found) * free_];
      int best = 0;
      double most = -1.0;
      for (int j = 0; j < free_; ++j) {
        double left = 1.0;
        for (int i = 0; i < seen + found; ++i) {
          const double c = seen_[static_cast<std::size_t>(i) * free_ + j];
          left -= c * c;
        }
        if (left > most) most = left, best = j;
      }
      std::fill(to, to + free_, 0.0);
      to[best] = 1.0;
      unit(seen_.data(), seen + found, free_);
    }
    std::fill(other_.begin(), other_.end(), 0.0);
    for (int j = 0; j < rest; ++j)
      add_rows(&other_[static_cast<std::size_t>(j) * n_], Z_.data(), n_, free_, 1.0,
               &seen_[static_cast<std::size_t>(seen + j) * free_], 1, n_);
    Z_.swap(other_);
    free_ = rest;
  }

  // The rows of the constraints along Z, from x, which has no part there, in units of their lengths. A row that is
  // violated by more than `most`, by which a soft one may be, keeps its value.
  void gather(const Problem& problem, double softness, double most, bool hard, const double* x) {
    count_ = read_ = 0;
    const double size = std::sqrt(dot_any(x, x, n_) + dot_any(z_.data(), z_.data(), free_));
    for_each(problem, 0, problem.constraints, [&](const double* a, double low, double high) {
      const double length = rooms_[read_++] = room(a);
      if (length == 0.0 || (low == -INFINITY && high == INFINITY)) return;
      double* b = &rows_[static_cast<std::size_t>(count_) * free_];
      for (int j = 0; j < free_; ++j) b[j] = own_[j] / length;
      const double base = dot_any(a, x, n_), value = base + length * dot_any(b, z_.data(), free_);
      const double off = value > high ? value - high : value < low ? value - low : 0.0;
      soft_[count_] = hard ? smaller(softness, kHard) : entries(a) == 1 ? kSingle * softness : softness;
      const double bound = std::fabs(off > 0.0 ? high : low);
      if (std::fabs(off) > kViolated * (1.0 + bound) + (most + kMet * size) * length) {
        (off > 0.0 ? high : low) = value;
        soft_[count_] = smaller(softness, kHard);
      }
      length_[count_] = length;
      base_[count_] = base / length;
      low_[count_] = low / length;
      high_[count_++] = high / length;
    });
  }

  double off(int k, double value) const {
    return value > high_[k] ? value - high_[k] : value < low_[k] ? value - low_[k] : 0.0;
  }

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
      if (side_[k] && side_[k] * ((value_[k] - bound(k)) + slope_[k]) >= 0.0) continue;
      const double there = value_[k] + slope_[k], out = off(k, there);
      const double rounding = kRounding * (std::fabs(base_[k]) + std::fabs(there));
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
      const double slope = slope_[k], end = far * (1.0 + kRounding);
      if (slope == 0.0) continue;
      const double up = (high_[k] - value_[k]) / slope, down = (low_[k] - value_[k]) / slope;
      const bool above = slope > 0.0 ? up <= end : up > end, below = slope > 0.0 ? down > end : down <= end;
      side_[k] = above && high_[k] < INFINITY ? 1 : below && low_[k] > -INFINITY ? -1 : 0;
    }
  }

  // z_ goes to the minimum by Newton's method.
  void minimise() {
    look();
    for (int k = 0; k < count_; ++k) {
      const double out = off(k, value_[k]);
      side_[k] = out > 0.0 ? 1 : out < 0.0 ? -1 : 0;
    }
    for (int round = 0; round < kRounds && solve(); ++round) {
      for (int k = 0; k < count_; ++k) slope_[k] = dot_any(row(k), step_.data(), free_);
      const double length = dot_any(step_.data(), step_.data(), free_), size = dot_any(z_.data(), z_.data(), free_);
      double far = 1.0, low = 0.0;
      if (length > kStill * kStill * (1.0 + size) && rise(1.0) > 0.0)
        for (int half = 0; half < kHalvings; ++half) {
          const double middle = 0.5 * (low + far);
          (rise(middle) > 0.0 ? far : low) = middle;
        }
      const bool other = arrive(), whole = !other || far == 1.0;
      if (!whole) pass(far);
      add_any(z_.data(), step_.data(), whole ? 1.0 : far, free_);
      look();
      if (!other && length <= kStill * kStill * (1.0 + size)) return;
    }
  }

  // Whether no row is violated at z_.
  bool kept() const {
    for (int k = 0; k < count_; ++k) {
      const double out = off(k, value_[k]), bound = out > 0.0 ? high_[k] : low_[k];
      if (std::fabs(out) > kViolated * (1.0 / length_[k] + std::fabs(bound))) return false;
    }
    return true;
  }

  // How fast the value rises along step_, that far along it.
  double rise(double far) const {
    double sum = 0.0;
    for (int j = 0; j < free_; ++j) sum += (z_[j] + far * step_[j]) * step_[j];
    for (int k = 0; k < count_; ++k) sum += off(k, value_[k] + far * slope_[k]) / soft_[k] * (slope_[k] / soft_[k]);
    return sum;
  }

  int entries(const double* a) const { return static_cast<int>(n_ - std::count(a, a + n_, 0.0)); }

  // step_: from z_ to the minimiser if the rows of side_ were equalities and there were no others. Columns of M_, the
  // right-hand side last; first the rows, the hardest before the others, below them the identity.
  bool solve() {
    int m = 0;
    for (int k = 0; k < count_; ++k) {
      if (!side_[k]) continue;
      int at = m++;
      for (; at > 0 && soft_[order_[at - 1]] > soft_[k]; --at) order_[at] = order_[at - 1];
      order_[at] = k;
    }
    const int height = m + free_;
    const auto column = [&](int j) { return &M_[static_cast<std::size_t>(j) * height]; };
    std::fill(M_.begin(), M_.begin() + static_cast<std::ptrdiff_t>(height) * (free_ + 1), 0.0);
    for (int i = 0; i < m; ++i) {
      const int k = order_[i];
      for (int j = 0; j < free_; ++j) column(j)[i] = row(k)[j] / soft_[k];
      column(free_)[i] = (bound(k) - value_[k]) / soft_[k];
    }
    for (int j = 0; j < free_; ++j) column(j)[m + j] = 1.0, column(free_)[m + j] = -z_[j], order_[j] = j;
    for (int k = 0; k < free_; ++k) {
      int best = k;
      double most = -1.0;
      for (int j = k; j < free_; ++j) {
        const double left = dot_any(column(j) + k, column(j) + k, height - k);
        if (left > most) most = left, best = j;
      }
      if (!(most > 0.0 && most < INFINITY)) return false;
      if (best != k) std::swap_ranges(column(k), column(k) + height, column(best)), std::swap(order_[k], order_[best]);
      double* v = column(k);
      const double length = std::sqrt(most), pivot = v[k] > 0.0 ? -length : length;
      v[k] -= pivot;
      const double factor = -1.0 / (pivot * v[k]);
      for (int j = k + 1; j <= free_; ++j)
        add_any(column(j) + k, v + k, -factor * dot_any(v + k, column(j) + k, height - k), height - k);
      v[k] = pivot;
    }
    for (int k = free_ - 1; k >= 0; --k) {
      double value = column(free_)[k];
      for (int j = k + 1; j < free_; ++j) value -= column(j)[k] * step_[order_[j]];
      step_[order_[k]] = value / column(k)[k];
    }
    return true;
  }

  int n_, free_ = 0, count_ = 0, read_ = 0;
  double most_ = 0.0;  // by how much a row of unit length may be exceeded
  std::vector<double> root_, Z_, other_, seen_, left_, own_, z_, start_, step_, a_;
  std::vector<double> rows_, M_, low_, high_, base_, value_, slope_, soft_, length_, rooms_, allowed_;
  std::vector<int> side_, order_, pivots_;
};

}  // namespace HQP_ISA
}  // namespace hqp
