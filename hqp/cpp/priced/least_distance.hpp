// The point of least |y| within the rows of a stage: their multipliers by nonnegative least squares (Lawson and Hanson
// 1974, chapter 23, problem LDP). It needs no working set, so the answer is unique with any number of active rows,
// nearly equal ones too.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/arena.hpp"
#include "../solver/nonnegative.hpp"
#include "row_space.hpp"
#include "stage_rows.hpp"

namespace hqp {
inline namespace HQP_ISA {

class LeastDistance {
 public:
  // n: largest size of y.  deadline: ends every solve.
  LeastDistance(int n, int rows, Deadline& deadline) : ld_(padded(n + 1)), space_(n, padded(n), 0.0) {
    const std::size_t sides = 2 * static_cast<std::size_t>(rows);
    for (const bool placed : {false, true}) {
      if (placed) arena_.take();
      least_.layout(arena_, n + 1, static_cast<int>(sides));
    }
    least_.rounding = kNoStep;
    least_.deadline = &deadline;
    columns_.resize(sides * ld_);
    tolerated_.resize(sides);
    own_.resize(sides);
    target_.resize(ld_);
    free_.reserve(n);
  }

  // Move y (N), a feasible point, to the least one; equalities keep their values. Return false if that fails.
  bool solve(StageRows& rows, int N, double* y) {
    space_.cut(0);
    for (int i = 0; i < rows.count(); ++i)
      if (rows[i].equal()) space_.add(rows.row(i, N, [](double*) {}), N, rows.grades(), rows[i].size, rows.rounding());
    const double size = 1.0 + std::sqrt(dot_any(y, y, N));
    space_.turn(y, N);
    free_.clear();
    for (int j = 0; j < N; ++j)
      if (!determines(j)) free_.push_back(j);
    least_.count = 0;
    for (int i = 0; i < rows.count(); ++i)
      if (!rows[i].equal()) bound(rows, i, N, y, size);
    const int count = static_cast<int>(free_.size());
    std::fill(target_.begin(), target_.end(), 0.0);
    target_[count] = 1.0;
    const bool reached = least(count);
    if (reached) {
      const double length = take(y, count, size);
      // to the own bounds of rows that the start violates if the point is hardly farther: independent of the start
      if (inside(count) && least(count) && keeps(count) && distance(count, size) <= (1.0 + kRests) * length)
        take(y, count, size);
    }
    space_.turn_back(y, N);
    return reached;
  }

  // Return true if the equalities of the latest solve determine coordinate j.
  bool determines(int j) const { return space_.determines(j, space_.rank()); }

 private:
  // Return true if a point within the columns is found.
  bool least(int count) {
    bool reached = false;
    for (const double dependent : {kSeen, kNoRate}) {  // the second if the answer would violate a row
      least_.dependent = dependent;
      reached = std::isfinite(least_.solve(target_.data(), count + 1)) && least_.rest[count] > 0.0;
      if (!reached || keeps(count)) break;
    }
    return reached;
  }

  // Its distance.
  double distance(int count, double size) const {
    return size * std::sqrt(dot_any(least_.rest, least_.rest, count)) / least_.rest[count];
  }

  // Move y there; return its distance.
  double take(double* y, int count, double size) const {
    for (int j = 0; j < count; ++j) y[free_[j]] = -size * least_.rest[j] / least_.rest[count];
    return distance(count, size);
  }

  // Use the own bounds of rows that y violated from now on; return true if there are such rows.
  bool inside(int count) {
    bool any = false;
    for (int k = 0; k < least_.count; ++k) {
      double& to = columns_[static_cast<std::size_t>(k) * ld_ + count];
      any = any || to != own_[k];
      to = own_[k];
    }
    return any;
  }

  // Add a column for each bound of row i: its free coordinates and the bound, or its value at y if that is outside, in
  // units of `size`.
  void bound(StageRows& rows, int i, int N, const double* y, double size) {
    const double* a = rows.row(i, N, [&](double* row) { space_.turn(row, N); });
    const double here = rows.shift(i) + dot_any(a, y, N);
    double fixed = here, square = 0.0;
    for (const int j : free_) {
      fixed -= a[j] * y[j];
      square += a[j] * a[j];
    }
    if (square == 0.0) return;
    const double unit = 1.0 / std::sqrt(square), spare = rows[i].spare;
    for (const int side : {-1, 1}) {
      const double bound = rows[i].bound(side);
      if (std::isinf(bound)) continue;
      double* column = &columns_[static_cast<std::size_t>(least_.count) * ld_];
      for (std::size_t j = 0; j < free_.size(); ++j) column[j] = -side * unit * a[free_[j]];
      const double own = side * bound + spare, allowed = larger(own, side * here);
      column[free_.size()] = unit * (side * fixed - allowed) / size;
      own_[least_.count] = unit * (side * fixed - own) / size;
      tolerated_[least_.count] = unit * rows[i].tolerated / size;
      least_.column[least_.count] = column;
      least_.sign[least_.count++] = 1.0;
    }
  }

  // Return true if the answer is within all rows, also those without a direction of their own.
  bool keeps(int count) const {
    const double* rest = least_.rest;
    for (int k = 0; k < least_.count; ++k)
      if (dot_any(least_.column[k], rest, count + 1) > tolerated_[k] * rest[count]) return false;
    return true;
  }

  int ld_;
  RowSpace space_;
  Arena arena_;
  NonnegativeLeastSquares least_;
  std::vector<double> columns_, own_, tolerated_, target_;
  std::vector<int> free_;
};

}  // namespace HQP_ISA
}  // namespace hqp
