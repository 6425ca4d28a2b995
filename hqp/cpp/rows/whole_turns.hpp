// Whole turns of continuous joints, whose angles are measured up to them. See nearest_turns in hqp/angles.py.
#pragma once

#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace hqp {

constexpr double kTurn = 6.283185307179586476925;

class WholeTurns {
 public:
  // sizes: coefficient of each joint.
  explicit WholeTurns(std::vector<double> sizes) : sizes_(std::move(sizes)), turns_(sizes_.size()), best_(turns_) {
    for (std::size_t i = 0; i < sizes_.size(); ++i)
      if (std::fabs(sizes_[i]) > std::fabs(sizes_[most_])) most_ = i;
    while (limit_ > 0 && choices() > kChoices) --limit_;
  }
  // Turns of each joint that make |off + kTurn sizes turns| least, the fewest of equal ones.
  const std::vector<double>& nearest(double off) {
    for (double& turns : best_) turns = 0.0;
    if (sizes_.empty()) return best_;
    const double period = kTurn * sizes_[most_], margin = kSame * std::fabs(period);
    double least = INFINITY, fewest = INFINITY;
    for (double& turns : turns_) turns = -limit_;
    do {
      double here = off, count = 0.0;
      for (std::size_t i = 0; i < sizes_.size(); ++i)
        if (i != most_) here += kTurn * sizes_[i] * turns_[i], count += std::fabs(turns_[i]);
      turns_[most_] = -std::nearbyint(here / period);
      count += std::fabs(turns_[most_]);
      const double rest = std::fabs(here + period * turns_[most_]);
      if (rest < least - margin || (rest <= least + margin && count < fewest))
        least = rest, fewest = count, best_ = turns_;
    } while (next());
    return best_;
  }

 private:
  static constexpr double kChoices = 2e5, kSame = 1e-9;  // as in hqp/angles.py

  double choices() const { return std::pow(2.0 * limit_ + 1.0, double(sizes_.size()) - 1.0); }
  bool next() {  // all but the one that counts most, as digits of a number
    for (std::size_t i = 0; i < turns_.size(); ++i) {
      if (i == most_) continue;
      if (turns_[i] < limit_) return turns_[i] += 1.0, true;
      turns_[i] = -limit_;
    }
    return false;
  }

  std::vector<double> sizes_, turns_, best_;
  std::size_t most_ = 0;
  int limit_ = 10;
};

}  // namespace hqp
