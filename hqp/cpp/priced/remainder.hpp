// A level k without a price below unmet ones, min ||w_k||^2 / 2 + R_k, as the last level of an exact hierarchy: over
// (z, v, s) with x = still + P z, v the motion of anchored rows and s the slacks of level k's inequalities,
//   [A_a, -sqrt(eta c_a omega_a) I] (x, v) = A_a x_a    instead of the rows of an unmet level a,
//   lower <= A_k x - s <= upper                         for inequality rows of level k,
//   last level: z_j = 0 for j < rank, v = 0, s = 0.
// z are coordinates in which the equality rows of level k and the rows of F weighed by the anchors are |z|^2 / 2 over
// the first `rank`: the last level picks variables, which the kernel need not factorise.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "anchors.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kLost = 1e-11;  // of the longest column of the last level: directions that it does not see

class Remainder {
 public:
  Remainder(int n, const std::vector<PricedLevel>& levels, const bool* priced)
      : n_(n), ends_(n), level_(levels), slot_(levels.size()), at_(n, kLost, 1.0), size_(n), sum_(n), row_(padded(n)) {
    for (std::size_t k = 0; k < levels.size(); ++k) {
      slot_[k] = ends_;
      if (priced[k]) ends_ += levels[k].m;
    }
  }

  // low, high: bounds of all rows as they are handed down.  x: where level k begins.
  void write(int k, const std::vector<Anchor>& anchors, const double* low, const double* high, Motions& motions,
             Room* above, const Remaining& rest, const Completion& completion) {
    const PricedLevel& level = level_[k];
    wide_ = rest.wide;
    motions.weigh(anchors, 0.0);
    double *lower = rest.last.lower, *upper = rest.last.upper;
    if (rest.slack.A) {
      stack(level, motions);
      slacks(level, rest.slack);
    } else {
      pick(level, motions);
      for (int i = 0; i < level.m; ++i, ++lower, ++upper) {
        const bool equal = level.lower[i] == level.upper[i];
        const std::int64_t j = level.index[i];
        rest.last.scale[i] = equal ? 1.0 : at_.picked(static_cast<int>(j), level.scale[i]);
        *lower = equal ? -kInf : level.lower[i] - level.scale[i] * at_.still()[j];
        *upper = equal ? kInf : level.upper[i] - level.scale[i] * at_.still()[j];
      }
    }
    for (int j = 0; j < wide_; ++j) {
      lower[j] = sees(j) ? 0.0 : -kInf;
      upper[j] = -lower[j];
    }
    std::size_t next = 0;
    for (int j = 0; j < k; ++j) {
      const Anchor* anchor = next < anchors.size() && anchors[next].level == j ? &anchors[next++] : nullptr;
      keep(j, anchor, low, high, above[j]);
      low += level_[j].m;
      high += level_[j].m;
    }
    complete(completion);
  }

  // Below the last level, which has a price, where motion is flat: min ||F (x - end)||^2, which is 0, over what the
  // levels leave, anchored rows as they are at the end of that level; the completion chooses.
  void finish(const std::vector<Anchor>& anchors, const double* low, const double* high, Motions& motions,
              const double* end, Room* above, const Remaining& rest, const Completion& completion) {
    wide_ = rest.wide;
    stack_.clear();
    sum_.clear();
    for (int j = 0; j < motions.count(); ++j) push(motions.row(j), 1.0, motions.moved(j, end));
    at_.set(stack_.data(), sum_.data(), motions.count());
    for (int j = 0; j < wide_; ++j) {
      rest.last.lower[j] = sees(j) ? 0.0 : -kInf;
      rest.last.upper[j] = -rest.last.lower[j];
    }
    std::size_t next = 0;
    for (std::size_t k = 0; k < level_.size(); ++k) {
      const PricedLevel& level = level_[k];
      const bool anchored = next < anchors.size() && anchors[next].level == static_cast<int>(k);
      if (anchored) {
        kept_low_.assign(low, low + level.m);
        kept_high_.assign(high, high + level.m);
        for (int i = 0; i < level.m; ++i) {
          if (level.left_out(i)) continue;
          const double value = dot_any(row(level, i), end, n_);
          const bool equal = level.lower[i] == level.upper[i];
          kept_low_[i] = equal || value < level.lower[i] ? value : level.lower[i];
          kept_high_[i] = equal || value > level.upper[i] ? value : level.upper[i];
        }
        ++next;
      }
      keep(static_cast<int>(k), nullptr, anchored ? kept_low_.data() : low, anchored ? kept_high_.data() : high,
           above[k]);
      low += level.m;
      high += level.m;
    }
    complete(completion);
  }

  // x (n,) of (z, v, s).
  void point(const double* z, double* x) const { at_.point(z, x); }

 private:
  static constexpr double kInf = std::numeric_limits<double>::infinity();
  static constexpr double kNone = 1e-26;  // a square of a weight that is rounding

  bool sees(int j) const { return j >= n_ || (at_.diagonal() ? size_[j] > 0.0 : j < at_.rank()); }

  // z where F is a diagonal and level k picks variables.
  void pick(const PricedLevel& level, const Motions& motions) {
    for (int j = 0; j < n_; ++j) {
      const double weight = motions.weight(j) * motions.size(j);
      size_[j] = weight * motions.size(j);
      sum_[j] = weight * motions.mean(j);
    }
    for (int i = 0; i < level.m; ++i) {
      if (level.lower[i] != level.upper[i]) continue;
      size_[level.index[i]] += level.scale[i] * level.scale[i];
      sum_[level.index[i]] += level.scale[i] * level.lower[i];
    }
    const double most = *std::max_element(size_.begin(), size_.end());
    scale_.resize(n_);
    for (int j = 0; j < n_; ++j) {
      size_[j] = size_[j] > kNone * most ? std::sqrt(size_[j]) : 0.0;
      scale_[j] = size_[j] > 0.0 ? size_[j] : std::sqrt(most > 0.0 ? most : 1.0);
      sum_[j] = size_[j] > 0.0 ? sum_[j] / size_[j] : 0.0;
    }
    at_.set(scale_.data(), sum_.data(), 0);
  }

  // z where the quadratic is of any rows: those of level k, those of F.
  void stack(const PricedLevel& level, const Motions& motions) {
    stack_.clear();
    sum_.clear();
    for (int i = 0; i < level.m; ++i) {
      if (level.lower[i] != level.upper[i]) continue;
      push(row(level, i), 1.0, level.lower[i]);
    }
    for (int j = 0; j < motions.count(); ++j) {
      const double root = std::sqrt(motions.weight(j));
      if (!(root > 0.0)) continue;
      if (motions.diagonal()) {
        std::fill(row_.begin(), row_.end(), 0.0);
        row_[j] = motions.size(j);
      }
      push(motions.diagonal() ? row_.data() : motions.row(j), root, root * motions.mean(j));
    }
    std::fill(row_.begin(), row_.end(), 0.0);
    if (sum_.empty()) push(row_.data(), 0.0, 0.0);
    at_.set(stack_.data(), sum_.data(), static_cast<int>(sum_.size()));
  }

  void push(const double* a, double scale, double target) {
    for (int j = 0; j < n_; ++j) stack_.push_back(scale * a[j]);
    sum_.push_back(target);
  }

  // Inequality rows of level k, whose slacks come last.
  void slacks(const PricedLevel& level, const Room& to) {
    double* A = to.A;
    for (int i = 0; i < level.m; ++i, A += wide_) {
      const bool equal = level.lower[i] == level.upper[i];
      to.lower[i] = -kInf;
      to.upper[i] = kInf;
      std::fill(A, A + wide_, 0.0);
      A[ends_ + i] = -1.0;
      if (equal || level.left_out(i)) continue;
      turn(row(level, i), level.lower[i], level.upper[i], A, to.lower[i], to.upper[i]);
    }
  }

  // Level j as the levels below find it.
  void keep(int j, const Anchor* anchor, const double* low, const double* high, const Room& to) {
    const PricedLevel& level = level_[j];
    if (to.scale) {
      for (int i = 0; i < level.m; ++i) {
        const int at = static_cast<int>(level.index[i]);
        const double shift = level.scale[i] * at_.still()[at];
        to.scale[i] = at_.picked(at, level.scale[i]);
        to.lower[i] = low[i] - shift;
        to.upper[i] = high[i] - shift;
      }
      return;
    }
    const double root = anchor ? std::sqrt(anchor->give) : 0.0;
    double* A = to.A;
    for (int i = 0; i < level.m; ++i, A += wide_) {
      const bool held = anchor && anchor->held[i];
      std::fill(A + n_, A + wide_, 0.0);
      turn(row(level, i), held ? anchor->low[i] : low[i], held ? anchor->high[i] : high[i], A, to.lower[i],
           to.upper[i]);
      if (held) A[slot_[j] + i] = -root;
    }
  }

  // low <= a x <= high over z.
  void turn(const double* a, double low, double high, double* A, double& lower, double& upper) {
    const double shift = dot_any(a, at_.still(), n_);
    lower = low - shift;
    upper = high - shift;
    at_.row(a, A);
  }

  // P'M P, and the origin in z.
  void complete(const Completion& completion) {
    std::fill(row_.begin(), row_.end(), 0.0);
    if (completion.wide_origin) at_.motion(completion.origin ? completion.origin : row_.data(), completion.wide_origin);
    if (!completion.wide_metric) return;
    product_.resize(static_cast<std::size_t>(n_) * n_);  // M P, then P'M P
    for (int i = 0; i < n_; ++i) {
      row_[i] = 1.0;
      const double* row = completion.metric ? completion.metric + static_cast<std::size_t>(i) * n_ : row_.data();
      at_.row(row, &product_[static_cast<std::size_t>(i) * n_]);
      row_[i] = 0.0;
    }
    for (int j = 0; j < n_; ++j) {
      for (int i = 0; i < n_; ++i) row_[i] = product_[static_cast<std::size_t>(i) * n_ + j];
      at_.row(row_.data(), completion.wide_metric + static_cast<std::size_t>(j) * wide_);
    }
  }

  const double* row(const PricedLevel& level, int i) {
    if (level.A) return level.A + static_cast<std::size_t>(i) * n_;
    std::fill(row_.begin(), row_.end(), 0.0);
    row_[level.index[i]] = level.scale[i];
    return row_.data();
  }

  int n_, ends_, wide_ = 0;  // ends_: where slacks begin
  const std::vector<PricedLevel>& level_;
  std::vector<int> slot_;  // where the v of a level begin
  Coordinates at_;
  std::vector<double> size_, sum_, row_, scale_, stack_, product_, kept_low_, kept_high_;
};

}  // namespace HQP_ISA
}  // namespace hqp
