// A kernel bound once to the arrays of a problem, and room for its answers.
#pragma once

#include <memory>
#include <vector>

#include "kernel.hpp"

namespace hqp {

class BoundKernel {
 public:
  BoundKernel(int n, std::vector<int> rows, bool metric, const Options& given) : options(given), n_(n), rows_(rows) {
    for (const int m : rows_) pairs_ += total_ += m;
    kernel_.reset(make_kernel(n, static_cast<int>(rows_.size()), rows_.data(), metric));
    ends_ = static_cast<std::size_t>(n_) + total_;
    numbers_.resize(ends_ + static_cast<std::size_t>(total_) / sizeof(double) + 1);
    lambda_.resize(static_cast<std::size_t>(pairs_) + 1);
    hard_.resize(static_cast<std::size_t>(n_));
    levels.resize(rows_.size());
  }

  Options options;
  std::vector<Level> levels;  // to be filled by whoever binds it, as is the problem
  Problem problem;
  const double* prices =
      nullptr;  // prices of the problem, which may be refilled: all zero, or this is no problem to solve

  Answer solve() {
    Answer answer;
    for (std::size_t k = 0; prices && k < rows_.size(); ++k)
      if (prices[k] != 0.0) answer.outcome = Outcome::invalid;
    if (answer.outcome == Outcome::invalid) return answer;
    answer.x = numbers_.data();
    answer.hard = hard_.data();
    answer.slack = numbers_.data() + n_;
    answer.active = marks();
    answer.multipliers = options.multipliers ? lambda_.data() : nullptr;
    kernel_->solve(problem, options, answer);
    return answer;
  }
  // Seconds for the next solves, none if zero.
  void limit(double seconds) { options.time_limit = seconds; }

  // Write multipliers of the latest answer into multipliers(); false if they are not available.
  bool write_multipliers() {
    Answer answer;
    answer.slack = numbers_.data() + n_;
    answer.multipliers = lambda_.data();
    return kernel_->write_multipliers(problem, answer);
  }
  // x (n) moves to the soft choice, or with `hard` to a point within the rows.
  void choose(double* x, bool hard) { kernel_->choose(problem, options, x, hard); }
  // Directions (count, n) of the soft choice, orthonormal; choose() must follow.
  const double* unseen(int& count) { return kernel_->unseen(problem, options, count); }
  // By how much each row of the constraints may be exceeded at the latest choice; null if by nothing.
  const double* allowed() { return kernel_->allowed(); }
  void reset(bool plain) { kernel_->reset(plain); }
  void keep(CarryOver& warm) { kernel_->keep(warm); }

  int size() const { return n_; }
  int total() const { return total_; }
  int pairs() const { return pairs_; }
  const std::vector<int>& rows() const { return rows_; }
  std::size_t ends() const { return ends_; }           // end of x and slacks in numbers(), start of the marks
  std::vector<double>& numbers() { return numbers_; }  // x, slacks, and the marks as bytes behind them
  std::vector<double>& hard() { return hard_; }        // (n,) x before the soft choice
  std::int8_t* marks() { return reinterpret_cast<std::int8_t*>(numbers_.data() + ends_); }
  std::vector<double>& multipliers() { return lambda_; }

 private:
  int n_;
  std::vector<int> rows_;
  int total_ = 0, pairs_ = 0;
  std::unique_ptr<Kernel> kernel_;
  std::size_t ends_ = 0;
  std::vector<double> numbers_, lambda_, hard_;
};

}  // namespace hqp
