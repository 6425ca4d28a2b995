// A step of the descent: from a point towards the equality problem's solution until something blocks.
#pragma once

#include "level_along_step.hpp"
#include "search_state.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Step {
 public:
  double length = 0.0;  // length of the last step, 1 for a whole one

  Step(EqualityProblem& problem, Point& point)
      : problem_(problem), table_(problem.table), set_(problem.set), point_(point) {}

  void layout(Arena& arena, int n, int rows) {
    arena.place(dx_, n);
    arena.place(dv_, rows);
    arena.place(reach_, n);
  }

  // Go there; true if nothing blocked. The blocking row is in the working set then.
  bool advance() {
    const int n = table_.n;
    const double *goal = problem_.tableau.x, *values = problem_.values;
    double *x = point_.x, *v = point_.v, distance = 0.0;
    for (int i = 0; i < n; ++i) {
      dx_[i] = goal[i] - x[i];
      distance += dx_[i] * dx_[i];
    }
    for (int r = 0; r < table_.rows; ++r) dv_[r] = values[r] - v[r];
    const double size = table_.span(goal);
    const int level = problem_.progress = first_level(std::sqrt(distance), table_.span(x));
    Obstacle obstacle;
    for (int i = 0; i < n; ++i) {
      reach_[i] = kInfinity;
      if (set_.F[i] || dx_[i] == 0.0) continue;
      const double bound = dx_[i] > 0 ? table_.hi[i] : table_.lo[i];
      const double over = dx_[i] > 0 ? goal[i] - bound : bound - goal[i];
      if (!(over > table_.tolerance * (std::fabs(bound) + size))) continue;
      const double a = reach_[i] = larger(0.0, (bound - x[i]) / dx_[i]);
      if (a < obstacle.at) obstacle = {a, -1, i};
    }
    const int above = level < table_.blocks ? table_.block[level].unequal_begin : table_.inequalities;
    for (int q = 0; q < above; ++q) {
      const double a = reach_of(table_.unequal[q], size);
      if (a < obstacle.at) obstacle = {a, table_.unequal[q], -1};
    }
    if (level < table_.blocks) bend(level, size, obstacle);
    length = obstacle.at;
    if (length >= 1.0 && obstacle.row < 0 && obstacle.variable < 0) return true;
    for (int i = 0; i < n; ++i)
      if (!set_.F[i]) x[i] = table_.inside_box(i, x[i] + length * dx_[i]);
    for (int r = 0; r < table_.rows; ++r) v[r] += length * dv_[r];
    point_.current = true;
    set_.changes.start();
    if (obstacle.variable >= 0)
      for (int i = 0; i < n; ++i)  // obstacles at equal length together
        if (!(reach_[i] > length + kNoStep)) {
          x[i] = dx_[i] > 0 ? table_.hi[i] : table_.lo[i];
          set_.hold(table_, i, dx_[i] > 0 ? kUpper : kLower);
        }
    if (obstacle.row >= 0) set_.join(obstacle.row, dv_[obstacle.row] > 0 ? kUpper : kLower);
    return false;
  }

 private:
  struct Obstacle {  // end of the step, and the blocking row or variable, -1 if there is none
    double at = 1.0;
    int row = -1, variable = -1;
  };

  EqualityProblem& problem_;
  Table& table_;
  WorkingSet& set_;
  Point& point_;
  double *dx_ = nullptr, *dv_ = nullptr, *reach_ = nullptr;

  // First level that the step changes: the levels above it must not be disturbed, those below do not count.
  int first_level(double distance, double size) const {
    for (int k = 0; k < table_.blocks; ++k) {
      const Block& b = table_.block[k];
      double square = 0.0;
      if (b.equalities) square = dot_any(dv_ + b.begin, dv_ + b.begin, b.end - b.begin);
      else
        for (int r = b.begin; r < b.end; ++r)
          if (set_.W[r]) square += dv_[r] * dv_[r];
      if (std::sqrt(square) > larger(kSeen * b.norm, b.rounding) * (distance + kRests * size)) return k;
    }
    return table_.blocks;
  }

  // The length at which row r meets a bound that the whole step violates, infinite where it violates none.
  double reach_of(int r, double size) const {
    if (set_.W[r] || dv_[r] == 0.0) return kInfinity;
    const double bound = dv_[r] > 0 ? table_.upper[r] : table_.lower[r];
    const double over = dv_[r] > 0 ? problem_.values[r] - bound : bound - problem_.values[r];
    if (!table_.is_over(r, over, bound, size, problem_.tableau.x)) return kInfinity;
    return larger(0.0, (bound - point_.v[r]) / dv_[r]);
  }

  // Rows of the level itself that the step would violate make its norm bend: stop where it is lowest. If rounding puts
  // it at the start, the first of them joins the working set instead.
  void bend(int level, double size, Obstacle& obstacle) const {
    double first = kInfinity;
    int nearest = -1;
    for (int q = table_.block[level].unequal_begin; q < table_.block[level].unequal_end; ++q) {
      const double a = reach_of(table_.unequal[q], size);
      if (!(a < first)) continue;
      first = a;
      nearest = table_.unequal[q];
    }
    if (nearest < 0) return;
    const double bottom = LevelAlongStep{table_, table_.block[level], point_.v, dv_}.lowest(obstacle.at, kNoRate);
    if (bottom > kNoRate && bottom < obstacle.at) obstacle = {bottom, -1, -1};
    else if (bottom <= kNoRate && first <= obstacle.at) obstacle = {first, nearest, -1};
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
