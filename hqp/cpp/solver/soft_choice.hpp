// Completion if the metric is singular: along directions that neither the metric nor a level below the constraints
// sees, x minimises |x|^2 / 2 + sum over rows of the constraints, of unit length, of excess^2 / (2 softness^2). That is
// strictly convex (soft_rows.hpp), and a row is exceeded by at most softness |y|, y any point within all rows.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "dense.hpp"
#include "metric_root.hpp"
#include "problem.hpp"
#include "soft_rows.hpp"
#include "table.hpp"
#include "violated.hpp"

namespace hqp {
inline namespace HQP_ISA {

class SoftChoice {
 public:
  // Softness of bounds on single variables, relative to that of other rows: commands keep these bounds.
  static constexpr double kSingle = 1e-2;

  SoftChoice(int n, int rows, bool metric) : n_(n), rows_(metric ? n : 0, metric ? rows : 0) {
    if (!metric) return;
    const std::size_t width = static_cast<std::size_t>(n), all = static_cast<std::size_t>(rows);
    for (auto* part : {&root_, &Z_, &other_, &seen_}) part->resize(width * width);
    for (auto* part : {&left_, &own_, &start_, &a_}) part->resize(width);
    for (auto* part : {&rooms_, &allowed_}) part->resize(all);
    pivots_.resize(width);
  }

  // Find Z (free, n), an orthonormal basis of these directions, for the next take() too; return free.
  int unseen(const Problem& problem, double softness) {
    free_ = 0;
    if (problem.metric && softness > 0.0) find(problem);
    found_ = true;
    return free_;
  }
  const double* directions() const { return Z_.data(); }

  // x (n), a point within the rows, moves to the minimiser, or with `hard` any x to a point within the rows; false if
  // no direction is free or numbers are not finite, and x stays.
  bool take(const Problem& problem, double softness, double* x, bool hard = false) {
    if (!found_) unseen(problem, softness);
    found_ = false;
    if (!free_) return false;
    const double size = std::sqrt(dot_any(x, x, n_));
    if (!(size < INFINITY)) return false;
    rows_.begin(free_);
    double* const z = rows_.z();
    dots_any(x, Z_.data(), n_, free_, n_, z);
    add_rows(x, Z_.data(), n_, free_, -1.0, z, 1, n_);
    most_ = softness * size;
    if (hard) {  // x may be a soft minimum: shorter than all points within the rows
      std::copy(z, z + free_, start_.begin());
      gather(problem, softness, INFINITY, hard, x);
      rows_.minimise();
      if (rows_.kept(kViolated)) most_ = softness * larger(size, std::sqrt(dot_any(x, x, n_) + dot_any(z, z, free_)));
      std::copy(start_.begin(), start_.begin() + free_, z);
    }
    gather(problem, softness, most_, hard, x);
    rows_.minimise();
    add_rows(x, Z_.data(), n_, free_, 1.0, z, 1, n_);
    return true;
  }

  // True if the levels violate a row by no more than the choice may: the answer does not show which of them does.
  bool unclear() const { return unclear_; }

  // By how much each row of the constraints may be exceeded after take(); null if by nothing.
  const double* allowed() {
    if (!free_) return nullptr;
    for (int i = 0; i < read_; ++i) allowed_[i] = most_ * rooms_[i];
    return allowed_.data();
  }

 private:
  double* Z(int j) { return &Z_[static_cast<std::size_t>(j) * n_]; }

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
  void find(const Problem& problem) {
    const int rank = metric_root(problem.metric, n_, root_.data(), left_.data(), pivots_.data());
    if (rank < 0 || rank == n_) return;
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

  // Take out of Z what levels below the constraints, or the motion, see: kSeen of a row's length, and of kGraded of its
  // level's longest row. Rounding of rows that are products leaves 1e-12; coefficients of forces are 1e-3 and above.
  void narrow(const Problem& problem) {
    int seen = 0;
    const auto see = [&](const double* a, double longest) {
      if (seen == free_) return;
      const double least = kSeen * larger(std::sqrt(dot_any(a, a, n_)), Table::kGraded * longest);
      double* s = &seen_[static_cast<std::size_t>(seen) * free_];
      dots_any(a, Z_.data(), n_, free_, n_, s);
      if (std::sqrt(dot_any(s, s, free_)) <= least) return;
      if (unit(seen_.data(), seen, free_) > least) ++seen;
    };
    for (int k = problem.constraints; k < problem.count; ++k) {
      double longest = 0.0;
      const auto bounded = [&](const auto& call) {
        for_each(problem, k, k + 1, [&](const double* a, double low, double high) {
          if (low != -INFINITY || high != INFINITY) call(a);
        });
      };
      bounded([&](const double* a) { longest = larger(longest, dot_any(a, a, n_)); });
      bounded([&](const double* a) { see(a, std::sqrt(longest)); });
    }
    double longest = 0.0;
    for (int i = 0; i < problem.motion_rows; ++i) {
      const double* a = problem.motion + static_cast<std::ptrdiff_t>(i) * n_;
      longest = larger(longest, dot_any(a, a, n_));
    }
    for (int i = 0; i < problem.motion_rows; ++i)
      see(problem.motion + static_cast<std::ptrdiff_t>(i) * n_, std::sqrt(longest));
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
    read_ = 0;
    unclear_ = false;
    rows_.begin(free_);
    const double size = std::sqrt(dot_any(x, x, n_) + dot_any(rows_.z(), rows_.z(), free_));
    for_each(problem, 0, problem.constraints, [&](const double* a, double low, double high) {
      const double length = rooms_[read_++] = room(a);
      if (length == 0.0 || (low == -INFINITY && high == INFINITY)) return;
      double* b = rows_.next();
      for (int j = 0; j < free_; ++j) b[j] = own_[j] / length;
      const double base = dot_any(a, x, n_), value = base + length * dot_any(b, rows_.z(), free_);
      const double off = value > high ? value - high : value < low ? value - low : 0.0;
      double soft = hard ? smaller(softness, kMet) : entries(a) == 1 ? kSingle * softness : softness;
      const double bound = std::fabs(off > 0.0 ? high : low);
      const double past = std::fabs(off) - kViolated * (1.0 + bound) - kMet * size * length;
      unclear_ = unclear_ || (past > 0.0 && !(past > most * length));
      if (past > most * length) {
        low = high = value;
        soft = smaller(softness, kMet);
      }
      rows_.add(base / length, low / length, high / length, soft, length);
    });
  }

  int entries(const double* a) const { return static_cast<int>(n_ - std::count(a, a + n_, 0.0)); }

  int n_, free_ = 0, read_ = 0;
  bool found_ = false;  // Z is that of the present problem
  bool unclear_ = false;
  double most_ = 0.0;  // by how much a row of unit length may be exceeded
  std::vector<double> root_, Z_, other_, seen_, left_, own_, start_, a_, rooms_, allowed_;
  std::vector<int> pivots_;
  SoftRows rows_;
};

}  // namespace HQP_ISA
}  // namespace hqp
