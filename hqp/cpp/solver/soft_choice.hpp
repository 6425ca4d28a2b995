// Completion if the metric is singular: along directions that neither the metric nor a level below the constraints
// sees, x minimises |x|^2 / 2 + sum over rows of the constraints, of unit length, of excess^2 / (2 softness^2). That is
// strictly convex (soft_rows.hpp), and a row is exceeded by at most softness |y|, y any point within all rows.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "basis.hpp"
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

  SoftChoice(int n, int rows, bool metric) : n_(n), Z_(metric ? n : 0), rows_(metric ? n : 0, metric ? rows : 0) {
    if (!metric) return;
    const std::size_t width = static_cast<std::size_t>(n), all = static_cast<std::size_t>(rows);
    root_.resize(width * width);
    for (auto* part : {&left_, &own_, &start_, &a_}) part->resize(width);
    for (auto* part : {&rooms_, &allowed_}) part->resize(all);
    pivots_.resize(width);
  }

  // Find Z (free, n), an orthonormal basis of these directions, for the next take() too; return free.
  int unseen(const Problem& problem, double softness) {
    Z_.count = 0;
    if (problem.metric && softness > 0.0) find(problem);
    found_ = true;
    return Z_.count;
  }
  const double* directions() const { return Z_.data(); }

  // x (n), a point within the rows, moves to the minimiser, or with `hard` any x to a point within the rows; false if
  // no direction is free or numbers are not finite, and x stays.
  bool take(const Problem& problem, double softness, double* x, bool hard = false) {
    if (!found_) unseen(problem, softness);
    found_ = false;
    const double size = std::sqrt(dot_any(x, x, n_));
    if (!Z_.count || !(size < INFINITY)) return false;
    most_ = softness * size;
    if (hard) {  // x may be a soft minimum: shorter than all points within the rows
      std::copy(x, x + n_, start_.begin());
      minimise(problem, softness, hard, x);
      if (rows_.kept(kViolated)) most_ = softness * larger(size, std::sqrt(dot_any(x, x, n_)));
      std::copy(start_.begin(), start_.end(), x);
    }
    keep(problem, x);
    minimise(problem, softness, hard, x);
    return true;
  }

  // True if the levels violate a row by no more than the choice may: the answer does not show which of them does.
  bool unclear() const { return unclear_; }

  // By how much each row of the constraints may be exceeded after take(); null if by nothing.
  const double* allowed() {
    if (!Z_.count) return nullptr;
    for (std::size_t i = 0; i < rooms_.size(); ++i) allowed_[i] = most_ * rooms_[i];
    return allowed_.data();
  }

 private:
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

  // Z (free, n), orthonormal: the null space of the metric, but for what levels or the motion see.
  void find(const Problem& problem) {
    const int rank = metric_root(problem.metric, n_, root_.data(), left_.data(), pivots_.data());
    if (rank < 0 || rank == n_) return;
    for (int j = 0; j < n_; ++j) {
      if (left_[j] < 0.0) continue;  // a pivot
      double* z = Z_.at(Z_.count);
      std::fill(z, z + n_, 0.0);
      z[j] = 1.0;
      for (int k = rank - 1; k >= 0; --k) {
        const double* r = &root_[static_cast<std::size_t>(k) * n_];
        z[pivots_[k]] = -dot_any(r, z, n_) / r[pivots_[k]];
      }
      for (int pass = 0; pass < 2; ++pass) {
        for (int i = 0; i < Z_.count; ++i) add_any(z, Z_.at(i), -dot_any(Z_.at(i), z, n_), n_);
        scale(z, n_, 1.0 / std::sqrt(dot_any(z, z, n_)));
      }
      ++Z_.count;
    }
    narrow(problem);
  }

  // Take out of Z what levels below the constraints, or the motion, see: kSeen of a row's length, and of kGraded of its
  // level's longest row. Rounding of rows that are products leaves 1e-12; coefficients of forces are 1e-3 and above.
  void narrow(const Problem& problem) {
    double longest = 0.0;
    const auto measure = [&](const double* a) { longest = larger(longest, std::sqrt(dot_any(a, a, n_))); };
    const auto see = [&](const double* a) {
      if (Z_.count) Z_.hold(a, kSeen * larger(std::sqrt(dot_any(a, a, n_)), Table::kGraded * longest));
    };
    for (int k = problem.constraints; k < problem.count; ++k) {
      const auto bounded = [&](const auto& call) {
        for_each(problem, k, k + 1, [&](const double* a, double low, double high) {
          if (low != -INFINITY || high != INFINITY) call(a);
        });
      };
      longest = 0.0;
      bounded(measure);
      bounded(see);
    }
    const auto row = [&](int i) { return problem.motion + static_cast<std::ptrdiff_t>(i) * n_; };
    longest = 0.0;
    for (int i = 0; i < problem.motion_rows; ++i) measure(row(i));
    for (int i = 0; i < problem.motion_rows; ++i) see(row(i));
  }

  // Take out of Z the rows of the constraints that x violates by more than `most`, by which a soft one may be: they
  // keep their values.
  void keep(const Problem& problem, const double* x) {
    unclear_ = false;
    const double size = std::sqrt(dot_any(x, x, n_));
    for_each(problem, 0, problem.constraints, [&](const double* a, double low, double high) {
      const double value = dot_any(a, x, n_), length = std::sqrt(dot_any(a, a, n_));
      const double off = value > high ? value - high : value < low ? low - value : 0.0;
      const double met = kViolated * (1.0 + std::fabs(value > high ? high : low));
      if (!(off > met)) return;
      if (!(off > met + (most_ + kMet * size) * length)) {
        unclear_ = unclear_ || Z_.see(a, own_.data()) > kSeen * length;
        return;
      }
      const double least = kSeen * length, seen = Z_.hold(a, least);
      unclear_ = unclear_ || (kEither * seen > least && seen < kEither * least);
    });
  }

  // Move x along Z to the minimum over the rows of the constraints, which count in units of their lengths.
  void minimise(const Problem& problem, double softness, bool hard, double* x) {
    rows_.begin(Z_.count);
    Z_.see(x, rows_.z());
    Z_.add(x, -1.0, rows_.z());
    int row = 0;
    for_each(problem, 0, problem.constraints, [&](const double* a, double low, double high) {
      double* const b = own_.data();
      const double length = std::sqrt(dot_any(a, a, n_)), seen = Z_.see(a, b);
      rooms_[static_cast<std::size_t>(row++)] = seen > kSeen * length ? length : 0.0;
      if (!(seen > kSeen * length) || (low == -INFINITY && high == INFINITY)) return;
      for (int j = 0; j < Z_.count; ++j) rows_.next()[j] = b[j] / length;
      const double soft = hard ? smaller(softness, kMet) : entries(a) == 1 ? kSingle * softness : softness;
      rows_.add(dot_any(a, x, n_) / length, low / length, high / length, soft, length);
    });
    rows_.minimise();
    Z_.add(x, 1.0, rows_.z());
  }

  int entries(const double* a) const { return static_cast<int>(n_ - std::count(a, a + n_, 0.0)); }

  int n_;
  bool found_ = false;  // Z is that of the present problem
  bool unclear_ = false;
  double most_ = 0.0;  // by how much a row of unit length may be exceeded
  Basis Z_;
  std::vector<double> root_, left_, own_, start_, a_, rooms_, allowed_;
  std::vector<int> pivots_;
  SoftRows rows_;
};

}  // namespace HQP_ISA
}  // namespace hqp
