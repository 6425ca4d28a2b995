// The second phase of a search: lexicographic descent, in which x never leaves the box and no level rises for a lower
// one.
#pragma once

#include "block_exchange.hpp"
#include "step.hpp"

namespace hqp {
inline namespace HQP_ISA {

// The working sets that a descent left, by their 64-bit hashes, the latest of them.
class SeenSets {
 public:
  void layout(Arena& arena) { arena.place(hashes_, kMost); }
  void forget() { count_ = 0; }

  // Return true if it was left before; noted if not.
  bool contains(std::uint64_t hash) {
    for (int q = 0; q < (count_ < kMost ? count_ : kMost); ++q)
      if (hashes_[q] == hash) return true;
    hashes_[count_++ % kMost] = hash;
    return false;
  }

 private:
  static constexpr int kMost = 512;
  std::uint64_t* hashes_ = nullptr;
  int count_ = 0;
};

// It stops where steps of no length follow one another or a working set comes again.
class PrimalDescent {
 public:
  explicit PrimalDescent(SearchState& state)
      : state_(state),
        problem_(state.problem),
        table_(state.problem.table),
        tableau_(state.problem.tableau),
        set_(state.problem.set),
        point_(state.point),
        step_(state.problem, state.point) {}

  void layout(Arena& arena, int n, int rows) {
    step_.layout(arena, n, rows);
    seen_.layout(arena);
  }

  // False if it was given up at x, which need not be optimal.
  bool run(const Start& start) {
    set_.restore(table_, start.set);
    for (int i = 0; i < table_.n; ++i) point_.x[i] = start.x[i];
    point_.current = false;
    seen_.forget();
    tableau_.recording = true;
    if (start.current) release_some();
    return descend();
  }

 private:
  SearchState& state_;
  EqualityProblem& problem_;
  Table& table_;
  Tableau& tableau_;
  WorkingSet& set_;
  Point& point_;
  Step step_;
  SeenSets seen_;

  bool descend() {
    const Multipliers& multipliers = state_.multipliers;
    int idle = 0;
    while (!state_.out_of_time()) {
      if (state_.iterations % 16 == 0 || !point_.current) table_.product(point_.x, point_.v);
      point_.current = false;
      set_.sort(table_, point_.v, table_.span(point_.x));
      state_.solve();
      if (!step_.advance() || oversteps()) {
        idle = step_.length > 0.0 ? 0 : idle + 1;
        if (idle > kIdle) return false;
        continue;
      }
      state_.multipliers.judge(set_.W, set_.F, problem_.values, true);
      if (multipliers.count == 0) {
        if (!tableau_.has_released || !state_.doubtful()) {
          state_.accept();
          return true;
        }
        set_.changes.forget();  // judged on a tableau of its own
      } else if (!seen_.contains(set_.hash(table_))) {
        release_some();
      } else {
        return false;
      }
    }
    return true;
  }

  // Go to the solution; return true if it violates rows, by rounding that no step sees, which join the working set.
  bool oversteps() {
    state_.go_to_solution();
    if (state_.violations.find(problem_) == 0) return false;
    for (int q = 0; q < table_.inequalities; ++q) {
      const int r = table_.unequal[q];
      if (state_.violations.row[r]) set_.W[r] = state_.violations.row[r];
    }
    set_.changes.forget();
    step_.length = 0.0;
    return true;
  }

  // At the highest level that is held back: the strongest and those at least half as strong.
  void release_some() {
    const Multipliers& multipliers = state_.multipliers;
    const WrongSign* wrong = multipliers.to_release;
    const int level = multipliers.highest();
    double most = 0.0;
    for (int q = 0; q < multipliers.count; ++q)
      if (wrong[q].level == level) most = larger(most, wrong[q].size);
    set_.changes.start(level);
    for (int q = 0; q < multipliers.count; ++q)
      if (wrong[q].level == level && wrong[q].size >= 0.5 * most) set_.release(table_, wrong[q]);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
