// Whether a level is still met for its price where the bound on its motion is too wide (motion_bound.hpp), as in fast
// motions, whose accelerations are bounded: from the multipliers of the last tick. With the inverse of
// B B' of an earlier tick they take up to four steps of iterative refinement. They show it where the last one leaves
// little of every residual and what follows is clear by a margin; else the level is tested in full.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "coordinates.hpp"
#include "motion_bound.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

constexpr double kClear = 0.9;     // c ||u|| that is clear of 1
constexpr double kStep = 0.02;     // of c ||u|| from one tick to the next
constexpr double kRefined = 0.05;  // of a residual, left by a step of refinement
constexpr double kMargin = 0.25;   // of that step, to a bound
constexpr double kFalling = 0.5;   // of it, so that one more step is worth its time
constexpr int kSteps = 4;          // in a tick
constexpr int kLongest = 100;      // ticks that one inverse serves

class Refined {
 public:
  Refined(int n, const std::vector<PricedLevel>& levels, int rows)
      : n_(n),
        level_(levels),
        first_(levels.size()),
        value_(padded(rows + 1)),
        residual_(padded(rows + 1)),
        change_(padded(rows + 1)),
        row_(padded(rows + 1)),
        moved_(rows),
        y_(padded(n)),
        b_(padded(n)),
        x_(padded(n)) {
    int before = 0;
    for (std::size_t k = 0; k < levels.size(); ++k) {
      first_[k] = before;
      before += levels[k].m;
    }
    known_ = std::make_shared<Known>(levels.size());
    for (std::size_t k = 0; k < levels.size(); ++k) {
      Last& last = known_->last[k];
      const std::size_t all = static_cast<std::size_t>(first_[k] + levels[k].m);
      last.rows.reserve(all);
      last.lambda.reserve(all);
      last.part.reserve(all);
      last.inverse.reserve(triangle(n));
    }
  }

  void forget() {
    if (known_) known_->forget();
  }
  void keep(CarryOver& warm) { warm.part(known_); }

  void begin(const Coordinates& coordinates, const double* prices, const double* x) {
    if (!known_) known_ = std::make_shared<Known>(level_.size());
    at_ = &coordinates;
    prices_ = prices;
    exact_ = x;
  }

  // Whether level k is met for its price by a margin; where it is not shown, a full test has to be taken first.
  bool clear(int k) {
    Last& last = known_->last[k];
    last.known = last.known && ++last.age <= kLongest && shown(k, last);
    return last.known;
  }

  // What a full test of level k found: c rows of the problem by number, how they are held (as Settled does), their
  // multipliers, the inverse of B B', and the point of least motion.
  void take(int k, int c, const int* number, const int* held, const double* lambda, const double* inverse,
            const double* x) {
    Last& last = known_->last[k];
    const int all = first_[k] + level_[k].m;
    last.known = true;
    last.age = 0;
    last.rows.assign(number, number + c);
    last.lambda.assign(all, 0.0);
    last.part.assign(all, kFree);
    for (int j = 0; j < c; ++j) {
      last.lambda[number[j]] = lambda[j];
      last.part[number[j]] = held[j] > 0 ? kAbove : held[j] < 0 ? kBelow : kEqual;
    }
    for (int l = 0; l <= k; ++l) {
      const PricedLevel& level = level_[l];
      for (int i = 0; i < level.m; ++i) {
        signed char& part = last.part[first_[l] + i];
        if (part != kFree) continue;
        const double value =
            level.A ? dot_any(level.A + static_cast<std::size_t>(i) * n_, x, n_) : level.scale[i] * x[level.index[i]];
        const double off = smaller(value - level.lower[i], level.upper[i] - value);
        if (level.lower[i] == level.upper[i]) part = kOut;
        else if (off <= kHolds * (1.0 + std::abs(value))) part = kFollows;
      }
    }
    const std::size_t size = static_cast<std::size_t>(c) * (c + 1) / 2;
    last.inverse.resize(size);
    for (int j = 0; j < c; ++j)
      std::copy(inverse + static_cast<std::size_t>(j) * c, inverse + static_cast<std::size_t>(j) * c + j + 1,
                &last.inverse[triangle(j)]);
  }

 private:
  // Rows as numbered in B, multipliers and parts of all rows down to the level, the inverse of B B'
  // as its lower triangle, of single precision: a step of refinement leaves a share of a residual in any case.
  struct Last {
    bool known = false;
    int age = 0;
    std::vector<int> rows;
    std::vector<double> lambda;
    std::vector<float> inverse;
    std::vector<signed char> part;
  };
  // From one tick to the next, of each level.
  struct Known final : WarmPart {
    explicit Known(std::size_t levels) : last(levels) {}
    void forget() override {
      for (Last& one : last) one.known = false;
    }
    void trim() override {
      for (Last& one : last)
        if (!one.known && !one.rows.empty()) one = Last();
    }
    std::size_t bytes() const override {
      std::size_t sum = sizeof(*this) + bytes_of(last);
      for (const Last& one : last)
        sum += bytes_of(one.rows) + bytes_of(one.lambda) + bytes_of(one.inverse) + bytes_of(one.part);
      return sum;
    }
    std::vector<Last> last;
  };
  // kFollows: at a bound without being held, as the other knee is where both feet stand and the base keeps its height.
  enum Part : signed char { kBelow = -1, kFree, kAbove, kFollows, kEqual, kOut };
  enum Shown { kNot, kNotYet, kClearly };

  static std::size_t triangle(int row) { return static_cast<std::size_t>(row) * (row + 1) / 2; }

  bool shown(int k, Last& last) {
    at_->point(combined(k, last.lambda), x_.data());
    for (int l = 0; l <= k; ++l)
      for (int i = 0; i < level_[l].m && !level_[l].A; ++i)
        if (last.part[first_[l] + i] == kOut) x_[level_[l].index[i]] = exact_[level_[l].index[i]];
    for (int l = 0; l <= k; ++l) {
      const PricedLevel& level = level_[l];
      const signed char* part = &last.part[first_[l]];
      double* value = &value_[first_[l]];
      if (level.A) dots_any(x_.data(), level.A, n_, level.m, n_, value);
      for (int i = 0; i < level.m; ++i) {
        if ((level.lower[i] == level.upper[i]) != (part[i] >= kEqual)) return false;
        if (!level.A) value[i] = level.scale[i] * x_[level.index[i]];
        if (part[i] != kFree && part[i] != kFollows)
          value[i] = (part[i] == kBelow ? level.lower[i] : level.upper[i]) - value[i];
      }
    }
    for (int step = 0; step < kSteps; ++step) {
      const Shown found = refined(k, last);
      if (found != kNotYet) return found == kClearly;
    }
    return false;
  }

  // One step of refinement: the multipliers, and value_ of all rows (what held rows miss) after it.
  Shown refined(int k, Last& last) {
    const int c = static_cast<int>(last.rows.size());
    for (int j = 0; j < c; ++j) residual_[j] = value_[last.rows[j]];
    for (int j = 0; j < c; ++j) {
      std::copy_n(&last.inverse[triangle(j)], j + 1, row_.data());
      const double* row = row_.data();
      change_[j] = dot_any(row, residual_.data(), j + 1);
      add_any(change_.data(), row, residual_[j], j);
    }
    std::fill(moved_.begin(), moved_.end(), 0.0);
    Shown found = kClearly;
    double square = 0.0, moved = 0.0;
    for (int j = 0; j < c; ++j) {
      const int row = last.rows[j];
      moved_[row] = change_[j];
      const double lambda = last.lambda[row] += change_[j], size = std::abs(change_[j]);
      if (std::abs(last.part[row]) == 1 && !(last.part[row] * lambda < -size)) {
        if (last.part[row] * lambda > size) return kNot;
        found = kNotYet;
      }
      if (row < first_[k]) continue;
      square += lambda * lambda;
      moved += change_[j] * change_[j];
    }
    moved = prices_[k] * std::sqrt(moved);
    const double length = prices_[k] * std::sqrt(square);
    if (!(moved < kStep && length + 2.0 * moved < kClear)) {
      if (!(length - 2.0 * moved < kClear)) return kNot;
      found = kNotYet;
    }
    at_->step(combined(k, moved_), x_.data());
    double before = 0.0, after = 0.0;  // residuals
    for (int l = 0; l <= k; ++l) {
      const PricedLevel& level = level_[l];
      double* step = residual_.data();
      if (level.A) dots_any(x_.data(), level.A, n_, level.m, n_, step);
      for (int i = 0; i < level.m; ++i) {
        const int row = first_[l] + i;
        if (!level.A) step[i] = level.scale[i] * x_[level.index[i]];
        double& value = value_[row];
        switch (last.part[row]) {
          case kOut:
            break;
          case kFollows:
            value += step[i];
            after = larger(after, std::abs(slack(value, level.lower[i], level.upper[i])));
            break;
          case kFree: {
            value += step[i];
            const double size = std::abs(step[i]), inside = smaller(value - level.lower[i], level.upper[i] - value);
            if (inside >= kMargin * size - kHolds) break;
            if (inside < -size) return kNot;
            found = kNotYet;
            break;
          }
          default:  // held
            before = larger(before, std::abs(value));
            value -= step[i];
            after = larger(after, std::abs(value));
        }
      }
    }
    if (!(after <= kRefined * before + kHolds)) return after < kFalling * before ? kNotYet : kNot;
    return found;
  }

  // In motion coordinates: the sum of all rows down to level k.
  const double* combined(int k, const std::vector<double>& weights) {
    std::fill(y_.begin(), y_.end(), 0.0);
    for (int l = 0; l <= k; ++l) {
      const PricedLevel& level = level_[l];
      const double* weight = &weights[first_[l]];
      if (level.A) {
        add_rows(y_.data(), level.A, n_, level.m, 1.0, weight, 1, n_);
        continue;
      }
      for (int i = 0; i < level.m; ++i) y_[level.index[i]] += level.scale[i] * weight[i];
    }
    at_->row(y_.data(), b_.data());
    return b_.data();
  }

  int n_;
  const std::vector<PricedLevel>& level_;
  std::vector<int> first_;
  std::shared_ptr<Known> known_;
  std::vector<double> value_, residual_, change_, row_, moved_, y_, b_, x_;
  const Coordinates* at_ = nullptr;
  const double *prices_ = nullptr, *exact_ = nullptr;
};

}  // namespace HQP_ISA
}  // namespace hqp
