// Rows and objective of one stage: rows handed down by the levels above, then those of the level with their slacks.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "hand_down.hpp"
#include "priced_rows.hpp"
#include "stage_rows.hpp"
#include "stage_search.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kFlatPull = 1e-10;  // largest pull of directions without motion or slacks, by the gradient

class Gather {
 public:
  Gather(PricedRows& levels, const HandDown& above, int n)
      : n_(n),
        levels_(levels),
        above_(above),
        variables_(n + levels.total() + levels.most()),
        rows_(n, rows_of_a_stage(), levels.total(), padded(variables_)),
        T_(static_cast<std::size_t>(levels.most()) * padded(variables_)),
        t_(levels.most()),
        sizes_(levels.most()),
        y_(padded(variables_)) {}

  int variables() const { return variables_; }  // largest number of a stage
  int rows_of_a_stage() const { return levels_.total() + levels_.most() + 2 * variables_; }
  // Rows no longer than this share of the longest are rounding: a level of such rows has no stage.
  double find_rounding() {
    rows_.rounding(kRounding * levels_.longest());
    return rows_.rounding();
  }

  // Gather the stage of level k in coordinates `at`, from x; return false if its rows are rounding.  price: 0 for an
  // exact level.
  bool stage(int k, double price, const Coordinates& at, const double* x) {
    k_ = k, priced_ = price > 0.0;
    rows_.begin(at, n_);
    size_ = n_;
    take_above(k, x);
    own_ = rows_.count();
    at.motion(x, y_.data());
    aim_ = {T_.data(), t_.data(), sizes_.data(), padded(variables_), 0, priced_ ? price : 1.0};
    const double longest = take_level(at, x);
    if (longest <= rows_.rounding()) return false;
    while (size_ % kLane) y_[size_++] = 0.0;  // coordinates that no row sees: whole vectors
    return true;
  }
  StageRows& rows() { return rows_; }
  const StageRows& rows() const { return rows_; }
  const Aim& aim() const { return aim_; }
  double* y() { return y_.data(); }
  int size() const { return size_; }  // count of coordinates
  int own() const { return own_; }    // first row of the level

  // Set the targets of equality rows for the present origin of the coordinates.
  void aim_at(const Coordinates& at) {
    const PricedLevel& level = levels_[k_];
    for (int i = 0, row = 0; priced_ && i < level.m; ++i) {
      if (level.left_out(i)) continue;
      if (level.lower[i] == level.upper[i]) t_[row] = level.lower[i] - dot_any(levels_.row(k_, i), at.still(), n_);
      ++row;
    }
  }
  // Return true if the cost of directions without motion pulls, at y, by more than rounding of the level's gradient
  // along them; x is written.
  bool flat_counts(const Coordinates& at, double* x) const {
    const double pull = aim_.price * at.flat_pull(y_.data());
    if (pull == 0.0) return false;
    double shortest = INFINITY, far = 1.0, unmet = 0.0, gradient = 0.0;
    at.point(y_.data(), x);
    for (int j = 0; j < n_; ++j) far = larger(far, std::abs(x[j]));
    const PricedLevel& level = levels_[k_];
    for (int i = 0, row = 0; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      const double own = levels_.length(k_, i), w = slack(levels_.value(k_, i, x), level.lower[i], level.upper[i]);
      const bool aimed = priced_ && level.lower[i] == level.upper[i];  // a row of T
      unmet += w * w;
      gradient += std::fabs(w) * (aimed ? at.flat_pull(&T_[static_cast<std::size_t>(row) * aim_.ld]) : own);
      ++row;
      if (own > rows_.rounding()) shortest = smaller(shortest, own);
    }
    unmet = std::sqrt(unmet);
    if (!(pull > kRounding * gradient)) return false;
    if (pull > kFlatPull * aim_.price * softest_ * far) return true;
    // w is known to a share of the row's terms, without a price in directions as short as these, with one u as well
    if (!priced_) return pull > kFlatPull * kUncertain * shortest * shortest * far;
    return pull * larger(1.0, unmet / (shortest * far)) > kFlatPull * shortest;
  }
  // Return true if the cost of slacks pulls by more than rounding of their own gradient.
  bool slacks_count() const {
    if (!priced_) return false;
    double most = 0.0;
    for (int i = own_; i < rows_.count(); ++i) most = larger(most, std::fabs(y_[rows_[i].band]));
    return aim_.price * kFreeShare * most > kFlatPull;
  }
  // Set the origin of the slacks to their present values.
  void count_slacks_from_here() {
    const PricedLevel& level = levels_[k_];
    for (int i = 0, row = 0, at = own_; i < level.m; ++i) {
      if (level.left_out(i)) continue;
      if (level.lower[i] != level.upper[i]) {
        double& y = y_[rows_[at].band];
        t_[row] += rows_[at].share * y;
        rows_.count_from(at++, y);
        y = 0.0;
      }
      ++row;
    }
  }

 private:
  // Row i of level k within these bounds.
  StageRow bounded(int k, int i, double low, double high) const {
    const PricedLevel& level = levels_[k];
    StageRow to;
    if (level.A) to.a = level.A + static_cast<std::size_t>(i) * n_;
    else to.only = static_cast<int>(level.index[i]), to.scale = level.scale[i];
    to.lower = low, to.upper = high;
    to.number = levels_.first(k) + i;
    to.size = levels_.length(k, i);
    return to;
  }
  // Add the rows of levels above k. A row of an anchor has a band: a coordinate y of its own that costs y^2 / 2.
  void take_above(int k, const double* x) {
    softest_ = INFINITY;
    above_.each(k, [&](int l, int i, double low, double high, const Anchor* anchor) {
      StageRow to = bounded(l, i, low, high);
      if (!anchor) {
        rows_.add(to);
        return;
      }
      if (to.size > rows_.rounding()) softest_ = smaller(softest_, to.size * to.size / anchor->allowance);
      add_band(to, std::sqrt(anchor->allowance), levels_.value(l, i, x));
    });
  }
  // Add the rows of the level and its objective; return the length of the longest, infinite for an exact level.
  double take_level(const Coordinates& at, const double* x) {
    const PricedLevel& level = levels_[k_];
    double longest = priced_ ? 0.0 : INFINITY;
    for (int i = 0; i < level.m; ++i) {
      const bool equal = level.lower[i] == level.upper[i];
      if (level.left_out(i) || (equal && !priced_)) continue;
      double* T = &T_[static_cast<std::size_t>(aim_.m) * aim_.ld];
      if (priced_) {
        longest = larger(longest, sizes_[aim_.m] = levels_.length(k_, i));
        std::fill(T, T + aim_.ld, 0.0);
        t_[aim_.m++] = 0.0;
        if (equal) {
          at.row(levels_.row(k_, i), T);
          continue;
        }
      }
      // lower <= a x - s <= upper with a slack s = unit y[N] that the level keeps small
      const double unit = priced_ ? 1.0 / kFreeShare : 1.0;
      rows_.grade(size_, 1.0 / unit);
      if (priced_) T[size_] = unit;
      add_band(bounded(k_, i, level.lower[i], level.upper[i]), unit, levels_.value(k_, i, x));
    }
    return longest;
  }
  // Add a row that moves by a coordinate of its own, by `unit`, from that value on.
  void add_band(StageRow to, double unit, double value) {
    y_[size_] = slack(value, to.lower, to.upper) / unit;
    to.band = size_;
    to.share = -unit;
    size_ += rows_.add(to);
  }

  int n_;
  PricedRows& levels_;
  const HandDown& above_;
  int variables_;
  StageRows rows_;
  std::vector<double> T_, t_, sizes_, y_;
  Aim aim_;
  int k_ = 0, size_ = 0, own_ = 0;
  bool priced_ = false;
  double softest_ = INFINITY;  // least pull of a row of an anchor, for an excess by its length
};

}  // namespace HQP_ISA
}  // namespace hqp
