// A late tick: continue the motion of the answers before, or take the cut answer if it is better.
//
// Levels are compared from the top; the first one whose ||w_k|| differs by more than its tolerance for levels below
// decides. There the better point has the smaller ||w_k|| and the smaller objective ||w_k|| + c_k E(x), with the price
// c_k on motion: an answer that was cut before its priced stages often has smaller slacks, at a motion that later ticks
// undo.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "../common/carry_over.hpp"
#include "../priced/stages.hpp"
#include "../solver/problem.hpp"

namespace hqp {

// Rate of the answers of a session, from the last two that were solved.
class Trend {
 public:
  static constexpr int kLongest = 25;  // late ticks after which the trend is obsolete

  explicit Trend(std::size_t n) : x_(n), rate_(n) {}

  void forget() { known_ = 0; }
  bool known() const { return known_ > 0; }
  // Take a solved answer, with the number of its tick.
  void take(const double* x, std::int64_t tick) {
    if (known_ > 0 && tick > tick_) {
      for (std::size_t i = 0; i < x_.size(); ++i) rate_[i] = (x[i] - x_[i]) / double(tick - tick_);
      known_ = 2;
    }
    std::copy(x, x + x_.size(), x_.begin());
    known_ = std::max(known_, 1);
    tick_ = tick;
  }
  // Extrapolate the last x to this tick; without two answers return it.
  void after(const double* last, std::int64_t tick, double* to) const {
    const bool moves = known_ == 2 && tick <= tick_ + kLongest;
    for (std::size_t i = 0; i < x_.size(); ++i) to[i] = moves ? last[i] + rate_[i] : last[i];
  }
  std::size_t size() const { return x_.size(); }
  void keep(CarryOver& state) {
    state.take(known_), state.take(tick_);
    if (known_ > 0) state.take(x_.data(), x_.size());
    if (known_ == 2) state.take(rate_.data(), rate_.size());
  }

 private:
  std::vector<double> x_, rate_;
  int known_ = 0;  // answers
  std::int64_t tick_ = 0;
};

// Value of row i of a level at x (n).
inline double value(const Level& level, int i, const double* x, int n) {
  if (!level.A) return level.scale[i] * x[level.index[i]];
  const double* row = level.A + std::ptrdiff_t(i) * n;
  double sum = 0.0;
  for (int j = 0; j < n; ++j) sum += row[j] * x[j];
  return sum;
}

// Replacement of a cut answer.
class Late {
 public:
  // levels, law: live; violation: VIOLATION_TOLERANCE.  Without a law no level has a price.
  Late(int n, std::vector<Level> levels, int constraints, const hqp::Law& law, double violation)
      : n_(n), levels_(std::move(levels)), constraints_(constraints), law_(law), violation_(violation) {
    for (const Level& level : levels_) rows_ += std::size_t(level.m);
    for (Point* point : {&here_, &on_, &cut_}) {
      point->x.resize(std::size_t(n));
      point->slack.resize(rows_);
      for (auto* part : {&point->size, &point->cost, &point->band}) part->resize(levels_.size());
    }
  }

  // Choose x from the cut answer, the last x and the extrapolated one: `ahead`, unless `last` is better, or the cut
  // answer by more than the next ticks make up. Each is clipped into the box of this tick; a change of a joint above
  // its share of `changes` is shortened along the line from `last`, for residuals are convex.
  const double* choose(const double* cut, const double* last, const double* ahead, const std::vector<int>& joints,
                       const std::vector<double>& changes) {
    take(here_, last), box(here_), judge(here_);
    take(on_, ahead), towards(on_, joints, changes), box(on_), judge(on_);
    take(cut_, cut), box(cut_), towards(cut_, joints, changes), judge(cut_);
    const Point& best = better(here_, on_, false) ? here_ : on_;
    return (better(cut_, best, true) ? cut_ : best).x.data();
  }

 private:
  struct Point {
    std::vector<double> x, slack, size, cost, band;
  };
  static constexpr double kMargin = 2.0;  // the cut answer must gain this many changes like the last ones,
  static constexpr double kWorth = 0.02;  // and this share of the residual: the next solved tick makes up for less

  void take(Point& to, const double* x) const { std::copy(x, x + n_, to.x.begin()); }

  // Clip into the bounds on single variables that lead the hierarchy.
  void box(Point& to) const {
    for (int k = 0; k < constraints_; ++k) {
      const Level& level = levels_[std::size_t(k)];
      for (int i = 0; !level.A && i < level.m; ++i) {
        const double one = level.lower[i] / level.scale[i], other = level.upper[i] / level.scale[i];
        double& x = to.x[std::size_t(level.index[i])];
        x = std::min(std::max(x, std::min(one, other)), std::max(one, other));
      }
    }
  }

  // Shorten the way from `here` so that no joint moves by more than its change.
  void towards(Point& to, const std::vector<int>& joints, const std::vector<double>& changes) const {
    double reach = 1.0;
    for (std::size_t i = 0; i < joints.size(); ++i) {
      const std::size_t k = std::size_t(joints[i]);
      reach = std::max(reach, std::fabs(to.x[k] - here_.x[k]) / changes[i]);
    }
    if (reach == 1.0) return;
    for (std::size_t i = 0; i < to.x.size(); ++i) to.x[i] = here_.x[i] + (to.x[i] - here_.x[i]) / reach;
  }

  // Compute slacks, and for every level ||w||, ||w|| + c E(x) and its tolerance for levels below.
  void judge(Point& at) const {
    const double motion = law_.prices ? energy(at.x) : 0.0;
    double* w = at.slack.data();
    for (std::size_t k = 0; k < levels_.size(); ++k) {
      const Level& level = levels_[k];
      double square = 0.0;
      for (int i = 0; i < level.m; ++i, ++w) {
        *w = slack(value(level, i, at.x.data(), n_), level.lower[i], level.upper[i]);
        square += *w * *w;
      }
      const double size = std::sqrt(square), price = law_.prices ? law_.prices[k] : 0.0;
      at.size[k] = size;
      at.cost[k] = size + price * motion;
      at.band[k] = violation_ * (1.0 + size) + (price > 0.0 ? law_.eta * size : 0.0);
    }
  }
  double energy(const std::vector<double>& x) const {  // E(x) = 1/2 ||F x - f||^2
    double square = 0.0;
    for (int i = 0; i < (law_.r ? law_.r : n_); ++i) {
      double moved = x[std::size_t(law_.r ? 0 : i)];
      if (law_.r) {
        moved = 0.0;
        for (int j = 0; j < n_; ++j) moved += law_.F[std::ptrdiff_t(i) * n_ + j] * x[std::size_t(j)];
      } else if (law_.F) {
        moved *= law_.F[i];
      }
      if (law_.f) moved -= law_.f[i];
      square += moved * moved;
    }
    return 0.5 * square;
  }

  // Return true if one is better in the first level that differs; soon: require more than the next ticks make up.
  bool better(const Point& one, const Point& other, bool soon) const {
    std::size_t at = 0;
    for (std::size_t k = 0; k < levels_.size(); at += std::size_t(levels_[k++].m)) {
      const double gain = other.size[k] - one.size[k], band = std::min(one.band[k], other.band[k]);
      if (!(std::fabs(gain) > band)) continue;
      double least = band;
      if (soon) {
        double square = 0.0;
        for (std::size_t i = at; i < at + std::size_t(levels_[k].m); ++i)
          square += (on_.slack[i] - here_.slack[i]) * (on_.slack[i] - here_.slack[i]);
        least += kMargin * std::sqrt(square) + kWorth * here_.size[k];
      }
      return gain > least && other.cost[k] - one.cost[k] > band;
    }
    return false;
  }

  int n_;
  std::vector<Level> levels_;
  int constraints_;
  hqp::Law law_;
  double violation_;
  std::size_t rows_ = 0;
  Point here_, on_, cut_;
};

}  // namespace hqp
