// An exact solve, and the stages of the levels that it does not settle, as one solve.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "../common/solve_call.hpp"
#include "../common/warm_sets.hpp"
#include "stages.hpp"

namespace hqp {

constexpr int kUnsettled = 98;  // an outcome: the exact answer does not settle every priced level

class StagedSolve final : public SolveCall {
 public:
  StagedSolve(int n, std::vector<int> rows, std::unique_ptr<PricedStages> stages)
      : n_(n), rows_(std::move(rows)), stages_(std::move(stages)) {}

  PricedStages& stages() { return *stages_; }
  int size() const { return n_; }
  std::size_t levels() const { return rows_.size(); }
  int rows(std::size_t k) const { return rows_[k]; }
  std::size_t total() const { return std::accumulate(rows_.begin(), rows_.end(), std::size_t{0}); }

  // To be called once the levels' arrays are there.
  void bind(const Law& law, const Completion& completion) {
    stages_->bind(law, completion);
    head_ = 0;
    heads_.clear();
    answers_ = false;
  }
  // The exact solve that run() begins with, its x, and where stages (levels, n) and the last point (n) go.
  void after(SolveCall* exact, const double* x, double* stages, double* last) {
    exact_ = exact, x_ = x, to_ = stages, end_ = last;
  }
  // The solve of the levels above one that may be the first that is not settled, and the x that it writes.
  void above(int head, SolveCall* solve, const double* x) { heads_.push_back({head, solve, x}); }
  // run() answers itself where the stages reach their optima and no row of the first levels is violated; the rest as
  // for describe().
  void answers(int constraints) {
    constraints_ = constraints;
    values_.resize(n_ + total());
    marks_.resize(total());
    answers_ = true;
  }

  Solved run(const double* v) override {
    began_ = Clock::now();
    used_ = 0;
    const int level = head_;
    bool cut = false;
    if (level) {
      const auto at = std::find_if(heads_.begin(), heads_.end(), [&](const Head& h) { return h.level == level; });
      if (at == heads_.end()) return {kAskPython};
      head_ = 0;
      used_ = level;
      Solved solved = at->solve->run(v);
      if (begins(solved) && staged(at->x, level) >= 0) return answered(solved);
      cut = solved.outcome == kTimeLimit || solved.outcome == kIterationLimit;
      if (limit_ > 0.0) exact_->limit(left());
    }
    used_ = 0;
    Solved solved = exact_->run(v);
    if (level && limit_ > 0.0) exact_->limit(limit_);
    if (cut) head_ = level;  // nothing tells that another level is the first that is not met
    return begins_all(solved) && staged(x_, 0) >= 0 ? answered(solved) : solved;
  }
  // Time for run() [s], none for 0.
  void limit(double seconds) override { limit_ = seconds; }

  // As PricedStages::solve.
  int start(const double* x, int head, double seconds, double* stages, double* last) {
    const int first = stages_->solve(x, head, seconds, stages, last);
    settled_ = first < 0;
    answered_ = false;
    head_ = std::max(first, 0);
    return first;
  }

  // The level above which all are settled, for the next solve; 0 for none known.
  int head() const { return head_; }
  void begin_at(int head) { head_ = head; }
  // Of the latest run(): whether all levels were settled, whether it answered itself; the level above which it solved
  // exactly, 0 for all; the time since it began [s].
  bool settled() const { return settled_; }
  bool answered() const { return answered_; }
  int used() const { return used_; }
  double elapsed() const { return std::chrono::duration<double>(Clock::now() - began_).count(); }
  // The latest answer is none of the stages': they were not asked.
  void unasked() { settled_ = answered_ = false; }
  void keep(CarryOver& warm) {
    warm.take(head_);
    stages_->keep(warm);
  }
  // The next solves are without the rows of these elements, see WarmSets.
  void turn(const WarmSets::Out& out) { sets_.turn(*this, out); }
  void reset() {
    stages_->reset();
    sets_.forget();
    head_ = 0;
  }

 private:
  using Clock = std::chrono::steady_clock;

  struct Head {
    int level;
    SolveCall* solve;
    const double* x;
  };

  double left() const { return limit_ > 0.0 ? std::max(limit_ - elapsed(), 1e-6) : 0.0; }

  int staged(const double* x, int head) { return start(x, head, left(), to_, end_); }

  // Whether stages can start from an answer: one of uncertain rank keeps to the levels above as well.
  static bool begins(const Solved& solved) { return solved.outcome == kOptimal || solved.outcome == kUncertain; }
  // Far out of reach the exact answer is so large that its lower levels cannot be certified; the stages need only that
  // the levels without a price are met.
  bool begins_all(const Solved& solved) {
    return begins(solved) || (solved.outcome == kNotCertified && stages_->unpriced_met(x_));
  }

  // The answer of the stages; kUnsettled where there is more to tell than an optimum.
  Solved answered(Solved solved) {
    solved.outcome = kUnsettled;
    if (!answers_ || !stages_->ended() || stages_->doubtful()) return solved;
    double square = 0.0;
    for (int i = 0; i < n_; ++i) square += end_[i] * end_[i];
    if (!(square < INFINITY)) return solved;
    std::copy(end_, end_ + n_, values_.begin());
    if (stages_->describe(end_, constraints_, values_.data() + n_, marks_.data())) return solved;
    solved.outcome = kOptimal;
    solved.iterations += stages_->iterations();
    solved.values = values_.data(), solved.active = marks_.data();
    solved.points = to_, solved.point_count = rows_.size() * n_;
    answered_ = true;
    return solved;
  }

  int n_;
  std::vector<int> rows_;
  std::unique_ptr<PricedStages> stages_;
  WarmSets sets_;
  SolveCall* exact_ = nullptr;
  const double* x_ = nullptr;
  double *to_ = nullptr, *end_ = nullptr;
  int head_ = 0, used_ = 0;
  bool settled_ = false, answered_ = false;
  std::vector<Head> heads_;
  bool answers_ = false;
  int constraints_ = 0;
  std::vector<double> values_;
  std::vector<std::int8_t> marks_;
  double limit_ = 0.0;
  Clock::time_point began_;
};

}  // namespace hqp
