// A step of the descent: towards the working set's solution until something blocks.
#pragma once

#include "level_along_step.hpp"
#include "working_set.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Step : public WorkingSet {
 protected:
  static constexpr double kTie = 1e-14;                     // lengths of steps nearer than this are equal
  static constexpr double kLengths[] = {0.2, 0.04, 0.008};  // parts of a step that are tried clipped

  // Rows violated at x work at their side, rows well inside do not, rows at a bound stay as they are.
  void sort_rows() {
    const double size = table.span(x);
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      const double above = slackness(r, table.upper[r], size), below = slackness(r, table.lower[r], size);
      const std::int8_t old = W[r];
      if (v[r] > table.upper[r] + above) W[r] = kUpper;
      else if (v[r] < table.lower[r] - below) W[r] = kLower;
      else if (W[r] == kUpper && v[r] < table.upper[r] - above) W[r] = kFree;
      else if (W[r] == kLower && v[r] > table.lower[r] + below) W[r] = kFree;
      if (W[r] != old) changes_.forget();
    }
  }

  // First level that the step changes: the levels above it must not be disturbed, those below do not count.
  int progress(double length, double size) const {
    for (int k = 0; k < table.blocks; ++k) {
      const Block& b = table.block[k];
      double square = 0.0;
      if (b.equalities) square = dot_any(change_ + b.begin, change_ + b.begin, b.end - b.begin);
      else
        for (int r = b.begin; r < b.end; ++r)
          if (W[r]) square += change_[r] * change_[r];
      if (std::sqrt(square) > larger(1e-9 * b.norm, b.rounding) * (length + 1e-3 * size)) return k;
    }
    return table.blocks;
  }

  // Go towards the tableau's point until something blocks; true if nothing did.
  bool advance() {
    const int n = table.n;
    double length = 0.0;
    for (int i = 0; i < n; ++i) {
      step_[i] = tableau.x[i] - x[i];
      length += step_[i] * step_[i];
    }
    for (int r = 0; r < table.rows; ++r) change_[r] = target_[r] - v[r];
    const double size = table.span(tableau.x), tolerance = options_->feasibility_tolerance;
    const int level = progress_ = progress(std::sqrt(length), table.span(x));
    double alpha = 1.0;
    int row = -1, variable = -1;
    std::int8_t side = 0;
    for (int i = 0; i < n; ++i) {
      reach_[i] = kInfinity;
      if (F[i] || step_[i] == 0.0) continue;
      const double bound = step_[i] > 0 ? table.hi[i] : table.lo[i];
      const double over = step_[i] > 0 ? tableau.x[i] - bound : bound - tableau.x[i];
      if (!(over > tolerance * (std::fabs(bound) + size))) continue;
      const double a = reach_[i] = larger(0.0, (bound - x[i]) / step_[i]);
      if (a < alpha) {
        alpha = a;
        variable = i;
        side = step_[i] > 0 ? kUpper : kLower;
      }
    }
    const int above = level < table.blocks ? table.block[level].unequal_begin : table.inequalities;
    for (int q = 0; q < above; ++q) {
      const int r = table.unequal[q];
      if (W[r] || change_[r] == 0.0) continue;
      const double bound = change_[r] > 0 ? table.upper[r] : table.lower[r];
      const double over = change_[r] > 0 ? target_[r] - bound : bound - target_[r];
      if (!is_over(r, over, bound, size)) continue;
      const double a = larger(0.0, (bound - v[r]) / change_[r]);
      if (a < alpha) {
        alpha = a;
        row = r;
        variable = -1;
        side = change_[r] > 0 ? kUpper : kLower;
      }
    }
    if (level < table.blocks) bend(level, size, alpha, row, variable, side);
    alpha_ = alpha;
    if (alpha >= 1.0 && row < 0 && variable < 0) return true;
    if (level == 0 && project(alpha)) {
      alpha_ = 1.0;
      return false;
    }
    for (int i = 0; i < n; ++i)
      if (!F[i]) x[i] = inside_box(i, x[i] + alpha * step_[i]);
    for (int r = 0; r < table.rows; ++r) v[r] += alpha * change_[r];
    product_is_current_ = true;
    changes_.start();
    if (variable >= 0)
      for (int i = 0; i < n; ++i)  // those met at the same length together
        if (!(reach_[i] > alpha + kTie)) {
          F[i] = step_[i] > 0 ? kUpper : kLower;
          x[i] = step_[i] > 0 ? table.hi[i] : table.lo[i];
          changes_.note_join(table.rows + i, F[i]);
        }
    if (row >= 0) {
      W[row] = side;
      changes_.note_join(row, side);
    }
    return false;
  }

  // At the top level only the box is in the way: a longer step, clipped into it, where that lowers the level more.
  bool project(double alpha) {
    for (int r = table.block[0].begin; r < table.block[0].end; ++r) trial_v_[r] = v[r] + alpha * change_[r];
    const double straight = outside(0, trial_v_);
    for (const double a : kLengths) {
      if (a <= 2.0 * alpha) return false;
      if (!(clipped(a) < straight)) continue;
      changes_.start();
      for (int i = 0; i < table.n; ++i) {
        const double end = x[i] + a * step_[i];
        const std::int8_t side = F[i] ? kFree : end > table.hi[i] ? kUpper : end < table.lo[i] ? kLower : kFree;
        if (side) {
          F[i] = side;
          changes_.note_join(table.rows + i, side);
        }
      }
      for (int i = 0; i < table.n; ++i) x[i] = trial_x_[i];
      for (int r = 0; r < table.rows; ++r) v[r] = trial_v_[r];
      product_is_current_ = true;
      return true;
    }
    return false;
  }

  // What the top level misses where the step to a is clipped into the box.
  double clipped(double a) {
    for (int i = 0; i < table.n; ++i) trial_x_[i] = F[i] ? x[i] : inside_box(i, x[i] + a * step_[i]);
    tableau.reduction.follow(trial_x_, table.n);
    table.product(trial_x_, trial_v_);
    return outside(0, trial_v_);
  }

  // Rows of the level itself that the step would violate make its norm bend: stop where it is lowest. Where that
  // is at once, by rounding, the first of them joins the working set instead.
  void bend(int level, double size, double& alpha, int& row, int& variable, std::int8_t& side) const {
    double first = kInfinity;
    int nearest = -1;
    for (int q = table.block[level].unequal_begin; q < table.block[level].unequal_end; ++q) {
      const int r = table.unequal[q];
      if (W[r] || change_[r] == 0.0) continue;
      const double bound = change_[r] > 0 ? table.upper[r] : table.lower[r];
      if (!is_over(r, change_[r] > 0 ? target_[r] - bound : bound - target_[r], bound, size)) continue;
      const double a = larger(0.0, (bound - v[r]) / change_[r]);
      if (a < first) {
        first = a;
        nearest = r;
      }
    }
    if (nearest < 0) return;
    const double bottom = LevelAlongStep{table, table.block[level], v, change_}.lowest(alpha, 1e-12);
    if (bottom > 1e-12 && bottom < alpha) {
      alpha = bottom;
      row = variable = -1;
    } else if (bottom <= 1e-12 && first <= alpha) {
      alpha = first;
      row = nearest;
      variable = -1;
      side = change_[nearest] > 0 ? kUpper : kLower;
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
