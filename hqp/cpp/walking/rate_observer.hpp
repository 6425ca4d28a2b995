// Rates without their noise: measured rates correct those that the last command and a steady unknown acceleration lead
// to, a Butterworth filter of both.
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
      : columns_(std::move(columns)),
        keeps_(keeps),
        learns_(0.5 * (1.0 - keeps) * (1.0 - keeps)),
        most_(most),
        expected_(columns_.size()),
        unknown_(columns_.size()) {}

  // Correct measured rates in place.
  void update(double* v) {
    for (std::size_t k = 0; k < columns_.size(); ++k) {
      double& rate = v[columns_[k]];
      if (knows_) {
        const double off = expected_[k] - rate;
        unknown_[k] -= learns_ * bounded(off);
        rate += bounded(keeps_ * off);
      }
      expected_[k] = rate;
    }
    knows_ = true;
  }
  // next(column): rate of the next tick by the command; nothing is expected of rates that are not finite.
  template <class Next>
  void expect(const Next& next) {
    double sum = 0.0;
    for (std::size_t k = 0; k < columns_.size(); ++k) sum += 0.0 * (expected_[k] = next(columns_[k]) + unknown_[k]);
    if (sum != 0.0) return forget();
    knows_ = true;
  }
  void forget() {
    knows_ = false;
    std::fill(unknown_.begin(), unknown_.end(), 0.0);
  }

 private:
  double bounded(double x) const { return std::min(std::max(x, -most_), most_); }

  std::vector<std::size_t> columns_;
  double keeps_, learns_, most_;            // learns: share of an error that becomes unknown
  std::vector<double> expected_, unknown_;  // unknown: change of a rate in a tick that no command causes
  bool knows_ = false;
};

}  // namespace hqp
