// A level k without a price below unmet ones, min ||w_k||^2 / 2 + R_k, as the last level of an exact hierarchy: over
// (z, v) with x_j = z_j / size_j and v the motion of anchored rows,
//   [A_a, -sqrt(eta c_a omega_a) I] (x, v) = A_a x_a    instead of the rows of an unmet level a,
//   last level: the rows of level k, those of F weighed by the anchors, v = 0.
// Where F is a diagonal and level k picks variables, rows that share a variable are one, and size makes it of length 1:
// the last level is then a selection of nearly everything, which the kernel need not factorise.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "anchors.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Remainder {
 public:
  Remainder(int n, const std::vector<PricedLevel>& levels, const bool* priced)
      : n_(n), level_(levels), slot_(levels.size()), size_(n), square_(n), sum_(n) {
    wide_ = n;
    for (std::size_t k = 0; k < levels.size(); ++k) {
      slot_[k] = wide_;
      if (priced[k]) wide_ += levels[k].m;
    }
  }

  // low, high: bounds of all rows as they are handed down.
  void write(int k, const std::vector<Anchor>& anchors, const double* low, const double* high, Motions& motions,
             Room* above, const Room& own, const Completion& completion) {
    motions.weigh(anchors, 0.0);
    std::fill(size_.begin(), size_.end(), 1.0);
    if (own.scale) pick(level_[k], motions, own);
    else weigh(level_[k], motions, own);
    std::size_t next = 0;
    for (int j = 0; j < k; ++j) {
      const Anchor* anchor = next < anchors.size() && anchors[next].level == j ? &anchors[next++] : nullptr;
      keep(j, anchor, low, high, above[j]);
      low += level_[j].m;
      high += level_[j].m;
    }
    complete(completion);
  }

  // x (n,) of (z, v).
  void point(const double* z, double* x) const {
    for (int j = 0; j < n_; ++j) x[j] = z[j] / size_[j];
  }

 private:
  static constexpr double kInf = std::numeric_limits<double>::infinity();
  static constexpr double kSlight = 1e-12, kNone = 1e-26;  // squares of weights: no scale of x_j, and rounding

  // The last level where rows pick variables: those of level k that are no equalities, one for each x_j, one for each
  // v.
  void pick(const PricedLevel& level, const Motions& motions, const Room& own) {
    for (int j = 0; j < n_; ++j) {
      const double weight = motions.weight(j) * motions.size(j);
      square_[j] = weight * motions.size(j);
      sum_[j] = weight * motions.mean(j);
    }
    for (int i = 0; i < level.m; ++i) {
      if (level.lower[i] != level.upper[i]) continue;
      const int j = static_cast<int>(level.index[i]);
      square_[j] += level.scale[i] * level.scale[i];
      sum_[j] += level.scale[i] * level.lower[i];
    }
    const double most = *std::max_element(square_.begin(), square_.end());
    for (int j = 0; j < n_; ++j)
      if (square_[j] > kSlight * most) size_[j] = std::sqrt(square_[j]);
    for (int i = 0; i < level.m; ++i) {
      const bool equal = level.lower[i] == level.upper[i];
      own.scale[i] = equal ? 1.0 : level.scale[i] / size_[level.index[i]];
      own.lower[i] = equal ? -kInf : level.lower[i];
      own.upper[i] = equal ? kInf : level.upper[i];
    }
    double *lower = own.lower + level.m, *upper = own.upper + level.m, *scale = own.scale + level.m;
    for (int j = 0; j < n_; ++j) {
      const bool asks = square_[j] > kNone * most;
      scale[j] = asks && size_[j] == 1.0 ? std::sqrt(square_[j]) : 1.0;
      lower[j] = asks ? sum_[j] / (size_[j] * scale[j]) : -kInf;
      upper[j] = asks ? lower[j] : kInf;
    }
    for (int j = n_; j < wide_; ++j) {
      scale[j] = 1.0;
      lower[j] = upper[j] = 0.0;
    }
  }

  // The last level of any rows: those of level k, those of F, v = 0.
  void weigh(const PricedLevel& level, const Motions& motions, const Room& own) {
    double* A = own.A;
    for (int i = 0; i < level.m; ++i, A += wide_) row(level, i, A);
    std::copy(level.lower, level.lower + level.m, own.lower);
    std::copy(level.upper, level.upper + level.m, own.upper);
    double *lower = own.lower + level.m, *upper = own.upper + level.m;
    for (int j = 0; j < motions.count(); ++j, A += wide_) {
      const double root = std::sqrt(motions.weight(j));
      std::fill(A, A + wide_, 0.0);
      if (motions.diagonal()) A[j] = root * motions.size(j);
      else
        for (int i = 0; i < n_; ++i) A[i] = root * motions.row(j)[i];
      lower[j] = root > 0.0 ? root * motions.mean(j) : -kInf;
      upper[j] = root > 0.0 ? lower[j] : kInf;
    }
    lower += motions.count();
    upper += motions.count();
    for (int j = n_; j < wide_; ++j, A += wide_) {
      std::fill(A, A + wide_, 0.0);
      A[j] = 1.0;
      lower[j - n_] = upper[j - n_] = 0.0;
    }
  }

  // Level j as the levels below find it.
  void keep(int j, const Anchor* anchor, const double* low, const double* high, const Room& to) {
    const PricedLevel& level = level_[j];
    std::copy(low, low + level.m, to.lower);
    std::copy(high, high + level.m, to.upper);
    if (to.scale) {
      for (int i = 0; i < level.m; ++i) to.scale[i] = level.scale[i] / size_[level.index[i]];
      return;
    }
    const double root = anchor ? std::sqrt(anchor->give) : 0.0;
    double* A = to.A;
    for (int i = 0; i < level.m; ++i, A += wide_) {
      row(level, i, A);
      if (!anchor || !anchor->held[i]) continue;
      A[slot_[j] + i] = -root;
      to.lower[i] = anchor->low[i];
      to.upper[i] = anchor->high[i];
    }
  }

  void complete(const Completion& completion) const {
    if (completion.metric)
      for (int i = 0; i < n_; ++i)
        for (int j = 0; j < n_; ++j)
          completion.wide_metric[static_cast<std::size_t>(i) * wide_ + j] =
              completion.metric[static_cast<std::size_t>(i) * n_ + j] / (size_[i] * size_[j]);
    if (completion.origin)
      for (int j = 0; j < n_; ++j) completion.wide_origin[j] = completion.origin[j] * size_[j];
  }

  // Row i of a level over (z, v).
  void row(const PricedLevel& level, int i, double* to) const {
    if (level.A) {
      const double* a = level.A + static_cast<std::size_t>(i) * n_;
      for (int j = 0; j < n_; ++j) to[j] = a[j] / size_[j];
      std::fill(to + n_, to + wide_, 0.0);
      return;
    }
    std::fill(to, to + wide_, 0.0);
    to[level.index[i]] = level.scale[i] / size_[level.index[i]];
  }

  int n_, wide_ = 0;
  const std::vector<PricedLevel>& level_;
  std::vector<int> slot_;  // where the v of a level begin
  std::vector<double> size_, square_, sum_;
};

}  // namespace HQP_ISA
}  // namespace hqp
