// A step of the descent: towards the working set's solution until something blocks.
#pragma once

#include "working_set.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Step : public WorkingSet {
 protected:
  // Rows violated at x work at their side, rows well inside do not, rows at a bound stay as they are.
  void sort_rows() {
    const double size = table.span(x);
    for (int r = 0; r < table.rows; ++r) {
      if (table.kind[r] != kUpper) continue;
      const double above = slackness(r, table.upper[r], size), below = slackness(r, table.lower[r], size);
      const std::int8_t old = W[r];
      if (v[r] > table.upper[r] + above) W[r] = kUpper;
      else if (v[r] < table.lower[r] - below) W[r] = kLower;
      else if (W[r] == kUpper && v[r] < table.upper[r] - above) W[r] = kFree;
      else if (W[r] == kLower && v[r] > table.lower[r] + below) W[r] = kFree;
      joins_only_ = joins_only_ && W[r] == old;
    }
  }

  // First level that the step changes: the levels above it must not be disturbed, those below do not count.
  int progress(double length, double size) const {
    for (int k = 0; k < table.blocks; ++k) {
      const Block& b = table.block[k];
      double square = 0.0;
      for (int r = b.begin; r < b.end; ++r) if (W[r]) square += change_[r] * change_[r];
      if (std::sqrt(square) > larger(1e-9 * b.norm, b.rounding) * (length + 1e-3 * size)) return k;
    }
    return table.blocks;
  }

  // Go towards the tableau's point until something blocks; true if nothing did.
  bool advance() {
    const int n = table.n;
    double length = 0.0;
    for (int i = 0; i < n; ++i) { step_[i] = tableau.x[i] - x[i]; length += step_[i] * step_[i]; }
    for (int r = 0; r < table.rows; ++r) change_[r] = target_[r] - v[r];
    const double size = table.span(tableau.x), tolerance = options_->feasibility_tolerance;
    const int level = progress_ = progress(std::sqrt(length), table.span(x));
    double alpha = 1.0;
    int row = -1, variable = -1;
    std::int8_t side = 0;
    for (int i = 0; i < n; ++i) {
      if (F[i] || step_[i] == 0.0) continue;
      const double bound = step_[i] > 0 ? table.hi[i] : table.lo[i];
      const double over = step_[i] > 0 ? tableau.x[i] - bound : bound - tableau.x[i];
      if (!(over > tolerance * (std::fabs(bound) + size))) continue;
      const double a = larger(0.0, (bound - x[i]) / step_[i]);
      if (a < alpha) { alpha = a; variable = i; side = step_[i] > 0 ? kUpper : kLower; }
    }
    const int rows = level < table.blocks ? table.block[level].begin : table.rows;
    for (int r = 0; r < rows; ++r) {
      if (table.kind[r] != kUpper || W[r] || change_[r] == 0.0) continue;
      const double bound = change_[r] > 0 ? table.upper[r] : table.lower[r];
      const double over = change_[r] > 0 ? target_[r] - bound : bound - target_[r];
      if (!(over > slackness(r, bound, size))) continue;
      const double a = larger(0.0, (bound - v[r]) / change_[r]);
      if (a < alpha) { alpha = a; row = r; variable = -1; side = change_[r] > 0 ? kUpper : kLower; }
    }
    if (level < table.blocks) bend(level, size, alpha, row, variable, side);
    if (alpha >= 1.0 && row < 0 && variable < 0) return true;
    for (int i = 0; i < n; ++i) if (!F[i]) x[i] = inside_box(i, x[i] + alpha * step_[i]);
    for (int r = 0; r < table.rows; ++r) v[r] += alpha * change_[r];
    followed_ = true;
    joins_only_ = variable >= 0 || row >= 0;
    if (variable >= 0) {
      F[variable] = side;
      x[variable] = side > 0 ? table.hi[variable] : table.lo[variable];
      note_join(table.rows + variable, side);
    }
    if (row >= 0) { W[row] = side; note_join(row, side); }
    return false;
  }

  // Rows of the level itself that the step would violate make its norm bend: stop where it is lowest. Where that
  // is at once, by rounding, the first of them joins the working set instead.
  void bend(int level, double size, double& alpha, int& row, int& variable, std::int8_t& side) const {
    double first = kInfinity;
    int nearest = -1;
    for (int r = table.block[level].begin; r < table.block[level].end; ++r) {
      if (table.kind[r] != kUpper || W[r] || change_[r] == 0.0) continue;
      const double bound = change_[r] > 0 ? table.upper[r] : table.lower[r];
      if (!((change_[r] > 0 ? target_[r] - bound : bound - target_[r]) > slackness(r, bound, size))) continue;
      const double a = larger(0.0, (bound - v[r]) / change_[r]);
      if (a < first) { first = a; nearest = r; }
    }
    if (nearest < 0) return;
    const double bottom = lowest(level, alpha);
    if (bottom > 1e-12 && bottom < alpha) { alpha = bottom; row = variable = -1; }
    else if (bottom <= 1e-12 && first <= alpha) {
      alpha = first; row = nearest; variable = -1; side = change_[nearest] > 0 ? kUpper : kLower;
    }
  }

  double slope(int begin, int end, double alpha) const {
    double s = 0.0;
    for (int r = begin; r < end; ++r) s += change_[r] * table.beyond(r, v[r] + alpha * change_[r]);
    return s;
  }

  // Where a level, a convex piecewise quadratic along the step, is lowest on [0, alpha].
  double lowest(int level, double alpha) const {
    const int begin = table.block[level].begin, end = table.block[level].end;
    const double start = slope(begin, end, 0.0);
    double low = 0.0, high = alpha, at_high = slope(begin, end, alpha), at_low = start;
    if (at_high <= 1e-12 * std::fabs(start)) return alpha;
    for (int r = begin; r < end; ++r) {              // shrink the bracket over the kinks inside it
      if (table.kind[r] != kUpper || change_[r] == 0.0) continue;
      for (int q = 0; q < 2; ++q) {
        const double kink = ((q ? table.upper[r] : table.lower[r]) - v[r]) / change_[r];
        if (!(kink > low && kink < high)) continue;
        const double s = slope(begin, end, kink);
        if (s >= 0.0) { high = kink; at_high = s; } else { low = kink; at_low = s; }
      }
    }
    const double a = at_high > at_low ? low - (high - low) * at_low / (at_high - at_low) : high;
    return a < alpha * (1.0 - 1e-12) ? larger(a, 0.0) : alpha;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
