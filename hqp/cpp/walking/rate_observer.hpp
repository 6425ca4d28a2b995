// Rates without their noise: measured rates correct the rates that the last command leads to by a share.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace hqp {

class RateObserver {
 public:
  // columns: the noisy rates; keeps: share of an expectation in the estimate, 0 for rates as measured; most: largest
  // difference between estimated and measured rates.
  RateObserver(std::vector<std::size_t> columns, double keeps, double most = std::numeric_limits<double>::infinity())
      : columns_(std::move(columns)), keeps_(keeps), most_(most), expected_(columns_.size()) {}

  // Correct measured rates in place.
  void update(double* v) {
    for (std::size_t k = 0; k < columns_.size(); ++k) {
      double& rate = v[columns_[k]];
      if (knows_) rate += std::min(std::max(keeps_ * (expected_[k] - rate), -most_), most_);
      expected_[k] = rate;
    }
    knows_ = true;
  }
  // next(column): rate of the next tick; nothing is expected of rates that are not finite.
  template <class Next>
  void expect(const Next& next) {
    double sum = 0.0;
    for (std::size_t k = 0; k < columns_.size(); ++k) sum += 0.0 * (expected_[k] = next(columns_[k]));
    knows_ = sum == 0.0;
  }
  void forget() { knows_ = false; }

 private:
  std::vector<std::size_t> columns_;
  double keeps_, most_;
  std::vector<double> expected_;
  bool knows_ = false;
};

}  // namespace hqp
