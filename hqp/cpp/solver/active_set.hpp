// The search for the optimal working set: warm start, block exchange while it pays, then monotone descent.
#pragma once

#include "step.hpp"

namespace hqp {
inline namespace HQP_ISA {

class ActiveSet final : public Step {
 public:
  void solve(const Options& options) {
    options_ = &options;
    tableau.rank_tolerance = options.rank_tolerance;
    multipliers.tolerance = options.multiplier_tolerance;
    factorisations = iterations = judged = 0;
    settled = false;
    outcome = Outcome::optimal;
    cap_ = options.max_iterations > 0 ? options.max_iterations : 100 + 10 * (table.rows + table.n);
    level_search.deadline.start(options.time_limit);
    level_search.unseen.forget();
    changes_.forget();
    tableau.choose_bias();
    stopped_ = stalled_ = false;
    working_set();
    tableau.recording = false;
    if (table.inequalities == 0 && !table.boxed) {
      equality_point();
      accept();
    } else if (!block_exchange()) primal();
    if (outcome != Outcome::time_limit && (stopped_ || (outcome <= Outcome::rank_uncertain && doubtful()))) certify();
    warm_ = true;
    always_refactorise_ = false;
  }

 private:
  static constexpr int kAll = 1 << 30;
  static constexpr int kAlone = 2;  // highest levels that are solved one after the other, without those below

  // Swap everything that is violated or wrong-signed at once; true if that ends at the optimum.
  bool block_exchange() {
    int exchanges_left = options_->exchanges, fewest = 1 << 30;
    forget_start();
    for (;;) {
      equality_point();
      const int outside = violations();
      multipliers.judge(W, F, target_);
      const int infeasibilities = outside + multipliers.count;
      if (infeasibilities == 0) {
        if (!reduced()) {
          accept();
          return true;
        }
        unreduce();
        forget_start();
        continue;
      }
      const bool reduces = iterations == 1 && kFarStart * outside > table.n && reduce();
      if (reduces) exchanges_left = 0;
      keep_start();
      if (infeasibilities < fewest) fewest = infeasibilities;
      else if (--exchanges_left < 0 || infeasibilities > 2 * fewest) return false;
      if (iterations > 1 && out_of_time()) {
        go_to_start();
        if (reduced()) unreduce();
        return true;
      }
      changes_.start();
      for (int q = 0; q < table.inequalities; ++q) {
        const int r = table.unequal[q];
        if (!side_[r]) continue;
        W[r] = side_[r];
        changes_.note_join(r, side_[r]);
      }
      for (int i = 0; i < table.n; ++i)
        if (side_x_[i]) {
          F[i] = side_x_[i];
          changes_.note_join(table.rows + i, side_x_[i]);
        }
      if (reduces || multipliers.count) changes_.forget();
      for (int q = 0; q < multipliers.count; ++q) release(multipliers.to_release[q]);
    }
  }

  // Far from the optimum: go on in fewer variables, with the same working sets; false where that saves too little.
  bool reduce() {
    if (always_refactorise_ || !tableau.reduce(table)) return false;
    tableau.reduction.mark(W, kFree);
    return true;
  }

  bool reduced() const { return tableau.reduction.count > 0; }

  // Back to all variables, where the answer is judged.
  void unreduce() {
    tableau.reduction.mark(W, kEquality);
    tableau.reduction.undo(table);
    changes_.forget();
    product_is_current_ = false;
    seen_count_ = 0;
    if (options_->multipliers) tableau.factorise(W, F);  // a cap may leave it at that
    table.product(tableau.x, target_);
  }

  void forget_start() {
    for (int k = 0; k < table.blocks; ++k) start_slack_[k] = kInfinity;
  }

  // The point of the box next to the tableau's, with what works there, if it is lexicographically the best so far.
  void keep_start() {
    go_to_point();
    table.product(x, v);
    bool better = false;
    for (int k = 0; k + 1 < table.blocks; ++k) {
      const double slack = outside(k, v), old = start_slack_[k];
      const double same = kSame * (1.0 + smaller(slack, old));
      if (!better && slack > old + same) return;
      better = better || slack < old - same;
      change_[k] = slack;
    }
    if (!better) return;
    for (int k = 0; k + 1 < table.blocks; ++k) start_slack_[k] = change_[k];
    for (int r = 0; r < table.rows; ++r) start_W_[r] = W[r];
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      if (side_[r]) start_W_[r] = side_[r];
    }
    for (int i = 0; i < table.n; ++i) {
      start_F_[i] = side_x_[i] ? side_x_[i] : F[i];
      start_x_[i] = x[i];
    }
  }

  void go_to_start() {
    for (int i = 0; i < table.n; ++i) x[i] = start_x_[i];
  }

  // Lexicographic descent from the best point so far: x never leaves the box, no level rises for a lower one. It stops
  // where steps of no length follow one another or a working set comes again. Until the highest levels are optimal the
  // others are left out and x moves no further than those ask: what is far from x is soon stopped by a bound.
  void primal() {
    for (int r = 0; r < table.rows; ++r) W[r] = start_W_[r];
    for (int i = 0; i < table.n; ++i) F[i] = start_F_[i];
    go_to_start();
    changes_.forget();
    tableau.recording = true;
    seen_count_ = 0;
    product_is_current_ = false;
    int idle = 0;
    tableau.lowest = 0;
    while (!out_of_time()) {
      if (leaves_out()) table.rest_at(x);
      if (iterations % 16 == 0 || !product_is_current_) table.product(x, v);
      product_is_current_ = false;
      sort_rows();
      equality_point();
      if (!advance() || oversteps()) {
        idle = alpha_ > 0.0 ? 0 : idle + 1;
        stalled_ = stalled_ || idle > 0;
        if (idle <= kIdle) continue;
        if (leaves_out()) {
          take_all();
          idle = 0;
          continue;
        }
        stopped_ = true;
        break;
      }
      multipliers.judge(W, F, target_, true);
      if (multipliers.count == 0) {
        if (leaves_out()) {
          ++tableau.lowest;
          if (tableau.lowest == kAlone || !leaves_out()) take_all();
          changes_.start();
          continue;
        }
        if (reduced()) {
          unreduce();
          continue;
        }
        if (tableau.has_released) {
          changes_.forget();
          continue;
        }  // judged on a tableau of its own
        accept();
        return;
      }
      if (repeated()) {
        if (leaves_out()) {
          take_all();
          changes_.forget();
          continue;
        }
        if (reduced()) {
          unreduce();
          continue;
        }
        stopped_ = true;
        break;
      }
      release_some();
    }
    if (leaves_out()) take_all();
    if (reduced()) unreduce();
  }

  // Go to the tableau's point; whether it violates rows, by rounding that no step sees, which join the working set.
  bool oversteps() {
    go_to_point();
    if (violations() == 0) return false;
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      if (side_[r]) W[r] = side_[r];
    }
    changes_.forget();
    alpha_ = 0.0;
    return true;
  }

  // Whether levels are left out below those at hand.
  bool leaves_out() const { return tableau.lowest < table.blocks - 1; }

  // From now on all levels count.
  void take_all() {
    tableau.lowest = kAll;
    table.rest_at(nullptr);
  }

  // At the highest level that is held back: the strongest and those at least half as strong.
  void release_some() {
    const WrongSign* wrong = multipliers.to_release;
    int level = 1 << 30;
    double most = 0.0;
    for (int q = 0; q < multipliers.count; ++q) level = wrong[q].level < level ? wrong[q].level : level;
    for (int q = 0; q < multipliers.count; ++q)
      if (wrong[q].level == level) most = larger(most, wrong[q].size);
    changes_.start(level);
    for (int q = 0; q < multipliers.count; ++q)
      if (wrong[q].level == level && wrong[q].size >= 0.5 * most) release(wrong[q]);
  }

  // Whether this working set was left before (64-bit hash).
  bool repeated() {
    const std::uint64_t hash = mixed(F, table.n, mixed(W, table.rows, 1469598103934665603ull));
    for (int q = 0; q < (seen_count_ < kSeen ? seen_count_ : kSeen); ++q)
      if (seen_[q] == hash) return true;
    seen_[seen_count_++ % kSeen] = hash;
    return false;
  }

  static std::uint64_t mixed(const std::int8_t* marks, int count, std::uint64_t hash) {
    for (int i = 0; i < count; i += 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, marks + i, static_cast<std::size_t>(count - i < 8 ? count - i : 8));
      hash = (hash ^ word) * 0x9e3779b97f4a7c15ull;
      hash ^= hash >> 32;
    }
    return hash;
  }

  // Whether rounding or a rank decision may have made the answer what it is.
  bool doubtful() const {
    return tableau.closest < kNear || tableau.growth > kGrown || multipliers.doubted || overlooked_ || table.uneven;
  }

  // The answer is judged in orthogonal coordinates; what is not optimal is lowered level by level, from x and then from
  // zero.
  void certify() {
    if (options_->max_iterations > 0 && outcome == Outcome::iteration_limit) return;
    judged = 1 + 4 * stalled_ + 8 * (tableau.closest < kNear) + 16 * (tableau.growth > kGrown) +
             32 * (multipliers.doubted || overlooked_) + 64 * table.uneven + 128 * stopped_;
    if (outcome == Outcome::iteration_limit) outcome = Outcome::optimal;
    Deadline& deadline = level_search.deadline;
    const bool passed = level_search.judge(x);
    if (deadline.passed()) {
      outcome = Outcome::time_limit;
      return;
    }
    if (passed && level_search.gap <= kGood) {
      if (stopped_) take_working_set();
      outcome = Outcome::optimal;
      doubt();
      return;
    }
    judged += 1;
    bool found = level_search.search(x);
    iterations += level_search.solves;
    if (!found && !passed)  // lower than where it began, or the same
      for (int i = 0; i < table.n; ++i) x[i] = level_search.x[i];
    if (!found && !passed && !deadline.passed()) {
      for (int i = 0; i < table.n; ++i) v[i] = inside_box(i, 0.0);
      found = level_search.search(v);
      iterations += level_search.solves;
    }
    if (found)
      for (int i = 0; i < table.n; ++i) x[i] = level_search.x[i];
    if (!found && passed) {
      outcome = Outcome::rank_uncertain;
      return;
    }  // as good as it gets
    if (!found && deadline.passed()) {
      outcome = Outcome::time_limit;
      return;
    }
    take_working_set();
    outcome = found ? Outcome::optimal : Outcome::not_certified;
    if (found) doubt();
  }

  // An optimum that rests on an unclear rank is uncertain, unless the data's last digits do not move it.
  void doubt() {
    if (!uncertain()) return;
    settled = !moves();
    if (!settled) outcome = Outcome::rank_uncertain;
  }

  // Whether the working set has its point elsewhere than at x, or moves it by more than kUnmoved, relative, where what
  // its rows are worth is off by kDigits.
  bool moves() {
    double size = 1.0;
    for (int i = 0; i < table.n; ++i) size = larger(size, std::fabs(x[i]));
    bool still = !level_search.deadline.passed();
    for (int pattern = 0; pattern < 3 && still; ++pattern) {
      for (int r = 0; r < table.rows && pattern; ++r) {
        if (!W[r]) continue;
        double& bound = W[r] == kLower ? table.lower[r] : table.upper[r];
        trial_v_[r] = bound;
        const double off = kDigits * (std::fabs(bound) + table.terms(r, x));
        bound += (static_cast<std::uint32_t>(r + 1) * 2654435761u >> (28 + pattern)) & 1u ? off : -off;
      }
      tableau.factorise(W, F);
      ++factorisations;
      for (int r = 0; r < table.rows && pattern; ++r)
        if (W[r]) (W[r] == kLower ? table.lower[r] : table.upper[r]) = trial_v_[r];
      for (int i = 0; i < table.n && still; ++i)
        still = std::fabs(inside_box(i, tableau.x[i]) - x[i]) <= kUnmoved * size;
    }
    tableau.factorise(W, F);
    ++factorisations;
    table.product(tableau.x, target_);
    return !still;
  }

  // Whether a rank that the answer or its verdict rests on was no clear decision.
  bool uncertain() const { return tableau.closest < kDoubt || level_search.closest < kDoubt; }

  // The working set that the search level by level ended with, for the next problem.
  void take_working_set() {
    table.product(x, v);
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      const double out = table.beyond(r, v[r]);
      const std::int8_t side = out > 0.0 ? kUpper : out < 0.0 ? kLower : kFree, held = level_search.held(table.n + r);
      W[r] = held ? held : side;
    }
    for (int i = 0; i < table.n; ++i)
      if (!table.fixed[i]) F[i] = level_search.held(i);
    if (options_->multipliers) {
      tableau.factorise(W, F);
      ++factorisations;
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
