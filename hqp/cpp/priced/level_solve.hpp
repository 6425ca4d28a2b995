// All levels in one solve: exactly if that settles every level with a price, else by stages from the first unsettled
// level on.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "../common/isa.hpp"
#include "../common/solve_call.hpp"
#include "../common/warm_sets.hpp"
#include "../solver/bound_kernel.hpp"
#include "stages.hpp"

namespace hqp {

constexpr int kUnsettled = 98;  // an outcome: the exact answer does not settle every priced level

class LevelSolve final : public SolveCall {
 public:
  // priced: true for each level that may have a price.
  LevelSolve(int n, const std::vector<int>& rows, bool metric, const Options& options, std::vector<char> priced,
             const Tolerances& tolerances)
      : exact_(n, rows, metric, options),
        metric_(metric),
        priced_(std::move(priced)),
        tolerances_(tolerances),
        points_(rows.size() * std::size_t(n), std::numeric_limits<double>::quiet_NaN()),
        end_(std::size_t(n)),
        limit_(options.time_limit) {
    if (std::find(priced_.begin(), priced_.end(), 1) != priced_.end()) make_stages();
  }
  LevelSolve(const LevelSolve&) = delete;

  // The exact kernel; its owner fills levels and problem.
  BoundKernel& exact() { return exact_; }
  // Bind the law after that; without prices the stages only know the rows.
  void bind(const Law& law) {
    if (!stages_) make_stages();
    law_ = law;
    has_prices_ = law.prices;
    none_.assign(count(), 0.0);
    if (!has_prices_) law_.prices = none_.data(), law_.eta = 1.0;
    for (std::size_t k = 0; k < count(); ++k) {
      const Level& level = exact_.levels[k];
      stages_->levels()[k] = {level.m, level.A, level.index, level.scale, level.lower, level.upper};
    }
    stages_->bind(law_, {exact_.problem.metric, exact_.problem.origin});
    exact_.problem.motion = has_prices_ ? law_.F : nullptr;
    exact_.problem.motion_rows = has_prices_ ? law_.r : 0;
    values_.resize(exact_.ends()), marks_.resize(std::size_t(exact_.total()));
    for (const auto& [level, prefix] : prefixes_) bind(*prefix), prefix->reset(false);
    prefix_ = 0, bound_ = true;
  }
  // Make the kernels of the levels above each possible first unsettled level.
  void make_prefixes() {
    if (!prefixes_.empty() || !has_prices_) return;
    for (std::size_t k = 1; k < count(); ++k) {
      if (!priced_[k]) continue;
      Options options = exact_.options;
      options.multipliers = false, options.time_limit = limit_, options.softness = 0.0;
      const auto& rows = exact_.rows();
      const std::vector<int> above(rows.begin(), rows.begin() + std::ptrdiff_t(k));
      prefixes_.emplace_back(static_cast<int>(k),
                             std::make_unique<BoundKernel>(exact_.size(), above, metric_, options));
      bind(*prefixes_.back().second);
    }
  }
  bool bound() const { return bound_; }
  const Law* law() const { return has_prices_ ? &law_ : nullptr; }
  PricedStages& stages() { return *stages_; }

  Solved run(const double*) override {
    Solved found = solve();
    if (found.outcome != kUnsettled || !stages_->ended() || stages_->doubtful()) return found;
    double square = 0.0;
    for (const double x : end_) square += x * x;
    if (!(square < INFINITY)) return found;
    std::copy(end_.begin(), end_.end(), values_.begin());
    if (describe(end_.data(), values_.data() + end_.size(), marks_.data())) return found;
    found.outcome = kOptimal;
    found.iterations += stages_->iterations();
    found.values = values_.data(), found.active = marks_.data();
    found.points = points_.data(), found.point_count = points_.size();
    return found;
  }
  // Solve; the caller reports the answer of stages, at end().
  Solved solve() {
    Solved found;
    if (begin(found)) return found;
    found = summary(solve_exact());
    // Far out of reach the exact answer is so large that its lower levels cannot be certified; the stages only need
    // the levels without a price met.
    const double* x = exact_.hard().data();
    const bool near = begins(found) || (found.outcome == kNotCertified && has_prices_ && stages_->unpriced_met(x));
    if (near && follow(x, 0) >= 0) found.outcome = kUnsettled;
    return found;
  }
  // Begin with stages from the level that was unmet last, on its last active set, or from the exact answer of the
  // levels above: far out of reach the exact answer of all levels is large, ill-conditioned and useless.  False if
  // that level is met by now, or the levels above have no optimum: the exact hierarchy decides in the remaining time.
  bool begin(Solved& found) {
    began_ = Clock::now();
    if (!prefix_) return false;
    make_prefixes();
    const int level = std::exchange(prefix_, 0);
    if (follow(nullptr, level) >= 0) {
      found.outcome = kUnsettled;
      return true;
    }
    BoundKernel& prefix = this->prefix(level);
    found = summary(prefix.solve());
    if (begins(found) && follow(prefix.numbers().data(), level) >= 0) {
      found.outcome = kUnsettled;
      return true;
    }
    const bool cut = found.outcome == kTimeLimit || found.outcome == kIterationLimit;
    if (cut) prefix_ = level;  // a cut solve does not show another first unmet level
    shortened_ = limit_ > 0.0;
    if (shortened_) exact_.limit(left());
    return false;
  }
  Answer solve_exact() {
    source_ = 0, staged_ = false;
    const Answer answer = exact_.solve();
    if (std::exchange(shortened_, false)) exact_.limit(limit_);
    return answer;
  }
  // The stages from x, an answer of the exact kernel or another.
  int follow_from(const double* x) {
    std::vector<double>& hard = exact_.hard();
    if (!std::equal(x, x + hard.size(), exact_.numbers().begin())) {
      std::copy(x, x + hard.size(), hard.begin());
      exact_.choose(hard.data(), true);
    }
    return follow(hard.data(), 0);
  }
  // See PricedStages::solve.
  int follow(const double* x, int prefix) {
    if (!has_prices_) return -1;
    const int first = stages_->solve(x, prefix, left(), points_.data(), end_.data());
    if (first >= 0 && stages_->ended()) {
      int count = 0;
      const double* const unseen = exact_.unseen(count);
      stages_->complete(unseen, count, end_.data());
      exact_.choose(end_.data(), false);
    }
    staged_ = first >= 0 && stages_->ended();
    source_ = first < 0 || (staged_ && x) ? prefix : -1;
    prefix_ = std::max(first, 0);
    return first;
  }

  // Points (levels, n) of the latest stages, and the answer.
  std::vector<double>& points() { return points_; }
  std::vector<double>& end() { return end_; }
  // Write slacks and marks of all rows at x; return true if a constraint is violated.
  bool describe(const double* x, double* slack, std::int8_t* marks) {
    return stages_->describe(x, exact_.problem.constraints, exact_.allowed(), slack, marks);
  }
  // The level above which all are settled, for the next solve; 0 if unknown.
  int prefix() const { return prefix_; }
  // Time since the latest solve began [s].
  double elapsed() const { return std::chrono::duration<double>(Clock::now() - began_).count(); }

  // The kernel with multipliers of the latest answer, of the levels above the stages if stages gave it; null if they
  // are not at hand, or if stages began on a face, which meets all rows above.
  BoundKernel* teller() {
    BoundKernel* kernel = source_ < 0 ? nullptr : source_ ? &prefix(source_) : &exact_;
    return kernel && kernel->write_multipliers() ? kernel : nullptr;
  }
  bool staged() const { return staged_; }
  // Mark the latest answer as found elsewhere.
  void without_multipliers() { source_ = -1, staged_ = false; }

  // Set the time for the next solves [s], 0 for no limit; the exact kernel has its own.
  void limit(double seconds) override {
    exact_.limit(seconds);
    limit_stages(seconds);
  }
  void limit_stages(double seconds) {
    limit_ = seconds;
    for (const auto& [level, prefix] : prefixes_) prefix->limit(seconds);
  }
  bool limited() const { return limit_ > 0.0; }

  // Collect all state that one solve hands to the next.
  void keep(CarryOver& warm) {
    exact_.keep(warm);
    for (const auto& [level, prefix] : prefixes_) prefix->keep(warm);
    warm.take(prefix_);
    if (has_prices_) stages_->keep(warm);
  }
  // Exclude the rows of these elements from the next solves, see WarmSets.
  void turn(const WarmSets::Out& out) {
    make_prefixes();
    sets_.turn(*this, out);
  }
  void make_room(std::size_t elements) { sets_.make_room(*this, elements); }  // for all sets of these
  WarmSets& sets() { return sets_; }
  void reset() {
    exact_.reset(false);
    for (const auto& [level, prefix] : prefixes_) prefix->reset(false);
    if (stages_) stages_->reset();
    prefix_ = 0;
    sets_.forget();
  }

 private:
  using Clock = std::chrono::steady_clock;

  std::size_t count() const { return exact_.rows().size(); }
  void make_stages() {
    const std::unique_ptr<bool[]> marks(new bool[count()]());
    std::copy(priced_.begin(), priced_.end(), marks.get());
    stages_.reset(HQP_FOR_MACHINE(make_stages, exact_.size(), static_cast<int>(count()), exact_.rows().data(),
                                  marks.get(), tolerances_));
  }
  // Bind the kernel of the levels above.
  void bind(BoundKernel& prefix) const {
    prefix.levels.assign(exact_.levels.begin(), exact_.levels.begin() + std::ptrdiff_t(prefix.rows().size()));
    prefix.problem = exact_.problem;
    prefix.problem.levels = prefix.levels.data();
    prefix.problem.count = static_cast<int>(prefix.levels.size());
    prefix.problem.constraints = std::min(exact_.problem.constraints, prefix.problem.count);
  }
  BoundKernel& prefix(int level) {
    return *std::find_if(prefixes_.begin(), prefixes_.end(), [&](const auto& one) {
              return one.first == level;
            })->second;
  }
  double left() const { return limit_ > 0.0 ? std::max(limit_ - elapsed(), std::numeric_limits<double>::min()) : 0.0; }
  static Solved summary(const Answer& answer) {
    const bool unsure = answer.unsure || answer.outcome == Outcome::rank_uncertain;
    return {static_cast<int>(answer.outcome), answer.iterations, answer.factorisations, answer.judged, unsure};
  }
  // Return true if stages can start from an answer: an optimum, constraints met or violated, also of uncertain rank.
  static bool begins(const Solved& solved) { return solved.outcome <= kViolated; }

  BoundKernel exact_;
  bool metric_;
  std::vector<char> priced_;
  Tolerances tolerances_;
  std::unique_ptr<PricedStages> stages_;
  std::vector<std::pair<int, std::unique_ptr<BoundKernel>>> prefixes_;
  WarmSets sets_;
  Law law_;
  bool bound_ = false, has_prices_ = false;
  std::vector<double> none_, points_, end_, values_;
  std::vector<std::int8_t> marks_;
  double limit_;
  bool shortened_ = false;
  int prefix_ = 0;
  int source_ = 0;  // origin of the latest answer: 0 exact kernel, else the level of a prefix, or -1
  bool staged_ = false;
  Clock::time_point began_;
};

}  // namespace hqp
