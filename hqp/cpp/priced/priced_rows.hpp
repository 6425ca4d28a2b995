// Rows of the levels: values, lengths, and the decision whether a level is met.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "../solver/dense.hpp"
#include "../solver/violated.hpp"
#include "stages.hpp"

namespace hqp {
inline namespace HQP_ISA {

// Value of row i of a level at x (n).
inline double row_value(const PricedLevel& level, int i, const double* x, int n) {
  if (!level.A) return level.scale[i] * x[level.index[i]];
  return dot_any(level.A + static_cast<std::size_t>(i) * n, x, n);
}
// Coefficients of the row (n), written into `room` if it picks a variable.
inline const double* coefficients(const PricedLevel& level, int i, int n, std::vector<double>& room) {
  if (level.A) return level.A + static_cast<std::size_t>(i) * n;
  std::fill(room.begin(), room.end(), 0.0);
  room[level.index[i]] = level.scale[i];
  return room.data();
}

class PricedRows {
 public:
  PricedRows(int n, int levels, const int* m, const Tolerances& tolerances)
      : n_(n), tolerances_(tolerances), level_(levels), first_(levels), a_(padded(n)), extent_(n) {
    for (int k = 0; k < levels; ++k) {
      level_[k].m = m[k];
      first_[k] = total_;
      total_ += m[k];
      most_ = std::max(most_, m[k]);
    }
    lengths_.resize(total_ + 1);
    w_.resize(most_);
  }

  std::vector<PricedLevel>& all() { return level_; }
  const std::vector<PricedLevel>& all() const { return level_; }
  const PricedLevel& operator[](int k) const { return level_[k]; }
  int count() const { return static_cast<int>(level_.size()); }
  int total() const { return total_; }           // rows of all levels
  int most() const { return most_; }             // largest number in a level, at least 1
  int first(int k) const { return first_[k]; }   // first row of level k among all
  const double* w() const { return w_.data(); }  // slacks of the latest met()
  double length(int k, int i) const { return lengths_[first_[k] + i]; }
  double longest() const { return *std::max_element(lengths_.begin(), lengths_.end()); }

  const double* row(int k, int i) { return coefficients(level_[k], i, n_, a_); }
  double value(int k, int i, const double* x) const { return row_value(level_[k], i, x, n_); }

  // Return true if any row of level k has a bound; a level without leaves x unchanged.
  bool bounded(int k) const {
    for (int i = 0; i < level_[k].m; ++i)
      if (!level_[k].left_out(i)) return true;
    return false;
  }

  // Measure the lengths of all rows; return true if they are finite and no bounds cross.
  bool measure() {
    double sum = 0.0;
    bool apart = true;
    for (std::size_t k = 0; k < level_.size(); ++k) {
      const PricedLevel& level = level_[k];
      for (int i = 0; i < level.m; ++i) {
        const double *a = level.A + static_cast<std::size_t>(i) * n_, low = level.lower[i], high = level.upper[i];
        sum += lengths_[first_[k] + i] = level.A ? std::sqrt(dot_any(a, a, n_)) : std::abs(level.scale[i]);
        apart = apart && low <= high && low < INFINITY && high > -INFINITY;
      }
    }
    return apart && sum < INFINITY;
  }

  // Take the extent of x, by which is_met() and met() know the rounding of rows.
  void rest_at(const double* x) {
    double largest = 1.0;
    for (int j = 0; j < n_; ++j) largest = larger(largest, std::abs(x[j]));
    const double left = kMet / tolerances_.met * std::sqrt(dot_any(x, x, n_));  // the exact kernel may leave this much
    for (int j = 0; j < n_; ++j) extent_[j] = std::abs(x[j]) + larger(tolerances_.resting * largest, left);
  }
  // Return true if slack w of a row is rounding there, or no more than this share of its terms and bound.
  bool is_met(int k, int i, double w) const { return is_met(k, i, w, tolerances_.met); }
  bool is_met(int k, int i, double w, double share) const { return w == 0.0 || std::abs(w) <= share * size(k, i); }
  // Return true if level k is met at x: w, of rows of unit length, is rounding.
  bool met(int k, const double* x) {
    const PricedLevel& level = level_[k];
    rest_at(x);
    const double* const length = &lengths_[first_[k]];
    const double longest = level.m ? *std::max_element(length, length + level.m) : 0.0;
    double off = 0.0, size = 0.0;
    for (int i = 0; i < level.m; ++i) {
      const double unit = length[i] > 0.0 ? length[i] : longest > 0.0 ? longest : 1.0;
      w_[i] = slack(value(k, i, x), level.lower[i], level.upper[i]);
      off += w_[i] / unit * (w_[i] / unit);
      size = larger(size, this->size(k, i) / unit);
    }
    return std::sqrt(off) <= tolerances_.met * size;
  }

 private:
  // Size to which the rounding of row i is relative: its terms and its bound.
  double size(int k, int i) const {
    const PricedLevel& level = level_[k];
    const double terms = level.A ? absolute_dot(level.A + static_cast<std::size_t>(i) * n_, extent_.data(), n_)
                                 : std::abs(level.scale[i]) * extent_[level.index[i]];
    const double low = level.lower[i], high = level.upper[i];
    return terms + std::abs(std::isfinite(low) ? low : std::isfinite(high) ? high : 0.0);
  }

  int n_, total_ = 0, most_ = 1;
  Tolerances tolerances_;
  std::vector<PricedLevel> level_;
  std::vector<int> first_;
  std::vector<double> a_, extent_, lengths_, w_;
};

}  // namespace HQP_ISA
}  // namespace hqp
