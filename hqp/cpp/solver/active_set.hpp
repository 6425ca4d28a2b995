// The search for the optimal working set: warm start, block exchange while it pays, descent, and a verdict on doubt.
#pragma once

#include "../common/carry_over.hpp"
#include "level_search.hpp"
#include "primal_descent.hpp"

namespace hqp {
inline namespace HQP_ISA {

class ActiveSet {
 public:
  SearchState state;
  int judged = 0;        // 1: the answer was doubted and judged, 2: it was refused and searched for level by level
  bool settled = false;  // an unclear rank does not matter: the data's last digits do not move x

  ActiveSet() : exchange_(state), descent_(state), judge_(conditions_), level_search_(conditions_, judge_) {}
  ActiveSet(const ActiveSet&) = delete;
  ActiveSet& operator=(const ActiveSet&) = delete;

  void layout(Arena& arena, int n, int levels, const int* m, int* blocks_m, bool metric) {
    problem_.table.layout(arena, n, levels, m, metric);
    int total = 0, most = n, count = 0;
    for (int k = 0; k < levels; ++k) {
      total += m[k];
      most = m[k] > most ? m[k] : most;
      blocks_m[count++] = m[k];
    }
    if (metric) {
      blocks_m[count++] = n;
      total += n;
    }
    blocks_m[count++] = n;
    total += n;
    // the box may leave level 0 out, which shifts the blocks: room for either numbering
    for (int k = 0; k + 1 < count; ++k) blocks_m[k] = blocks_m[k + 1] > blocks_m[k] ? blocks_m[k + 1] : blocks_m[k];
    total_ = total;
    state.layout(arena, n, total, most, count, blocks_m);
    exchange_.start.layout(arena, n, total, count);
    descent_.layout(arena, n, total);
    conditions_.layout(arena, n, total, most, count);
    level_search_.layout(arena, n, total);
    arena.place(from_, n);
    arena.place(last_, n);
    arena.place(bound_, total);
  }

  void wire() {
    state.wire();
    state.deadline = &conditions_.deadline;
    conditions_.wire(&problem_.table);
  }

  // Begin without the last working set and the last point; plain: factorise every one in the next search.
  void forget(bool plain) {
    warm_ = false;
    for (int i = 0; i < problem_.table.n; ++i) last_[i] = 0.0;
    problem_.updating = !plain;
  }

  // All that goes over from one solve to the next.
  void keep(CarryOver& warm) {
    warm.take(warm_);
    warm.take(problem_.updating);
    warm.take(problem_.set.W, total_);
    warm.take(problem_.set.F, problem_.table.n);
    warm.take(last_, problem_.table.n);
  }

  void solve(const Options& options) {
    judged = 0;
    settled = false;
    conditions_.deadline.start(options.time_limit);
    conditions_.unseen.forget();
    state.start(options, warm_);
    bool ended = true;
    if (problem_.table.inequalities == 0 && !problem_.table.boxed) {
      state.solve();
      state.accept();
    } else if (!exchange_.run(last_)) {
      ended = descent_.run(exchange_.start);
    }
    if (!ended || (state.outcome <= Outcome::rank_uncertain && state.doubtful())) certify(ended);
    if (state.outcome == Outcome::time_limit || state.outcome == Outcome::iteration_limit) take_if_better(last_);
    for (int i = 0; i < problem_.table.n; ++i) last_[i] = state.point.x[i];
    warm_ = true;
    problem_.updating = true;
  }

  // An optimum that was judged is uncertain if it leaves rows by more than their error, and moves where it meets them.
  // If it has a part of a gradient left, it is lowered: the completion magnifies the motion.  free (count, n):
  // directions that no level sees.
  void doubt_rows(const double* free, int count) {
    if (conditions_.to_bounds(free, count) > kUncertain) {
      state.outcome = Outcome::rank_uncertain;
      return;
    }
    if (!(judge_.gap > kNoRate)) return;
    const int n = problem_.table.n;
    level_search_.lower_from(state.point.x);
    if (!(conditions_.motion_from(state.point.x, free, count) > kActive)) return;
    std::copy(conditions_.x, conditions_.x + n, from_);
    if (!judge_.judge(from_) || judge_.gap > kActive) return;
    std::copy(from_, from_ + n, state.point.x);
    std::copy(from_, from_ + n, last_);
  }

 private:
  EqualityProblem& problem_ = state.problem;
  BlockExchange exchange_;
  PrimalDescent descent_;
  Conditions conditions_;
  Judge judge_;
  LevelSearch level_search_;
  double* from_ = nullptr;   // (n,) another point to search from
  double* last_ = nullptr;   // (n,) the last solution, zero without one
  double* bound_ = nullptr;  // (rows,) bounds while others stand in their place
  int total_ = 0;            // rows at most
  bool warm_ = false;

  // The answer is judged in orthogonal coordinates; a solution that is not optimal is lowered level by level, from x
  // and then from zero. ended: the search took x for the optimum.
  void certify(bool ended) {
    double* x = state.point.x;
    const int n = problem_.table.n;
    Deadline& deadline = conditions_.deadline;
    judged = 1;
    const bool passed = judge_.judge(x);
    if (deadline.passed()) {
      state.outcome = Outcome::time_limit;
      return;
    }
    if (passed && judge_.gap <= kActive) {
      if (!ended) take_working_set();
      state.outcome = Outcome::optimal;
      doubt();
      doubt_forces();
      return;
    }
    judged = 2;
    bool found = search_from(x);
    if (!found && !passed)  // lower than where it began, or the same
      for (int i = 0; i < n; ++i) x[i] = conditions_.x[i];
    if (!found && !passed && !deadline.passed()) {
      for (int i = 0; i < n; ++i) from_[i] = problem_.table.inside_box(i, 0.0);
      found = search_from(from_);
    }
    if (found)
      for (int i = 0; i < n; ++i) x[i] = conditions_.x[i];
    if (!found && passed) {
      state.outcome = Outcome::rank_uncertain;  // no further improvement possible
      return;
    }
    if (!found && deadline.passed()) {
      state.outcome = Outcome::time_limit;
      return;
    }
    take_working_set();
    state.outcome = found ? Outcome::optimal : Outcome::not_certified;
    if (!found) return;
    if (stalled() || conditions_.closest < kEither * kEither || conditions_.magnifies()) doubt();  // not of the tableau
    doubt_forces();
  }

  // Another point, clipped into the box, where that is lexicographically better.
  void take_if_better(const double* other) {
    const Table& table = problem_.table;
    Point& point = state.point;
    for (int i = 0; i < table.n; ++i) from_[i] = table.inside_box(i, other[i]);
    table.product(point.x, point.v);
    table.product(from_, bound_);
    const auto now = [&](int k) { return table.outside(k, point.v); };
    const auto before = [&](int k) { return table.outside(k, bound_); };
    if (lexicographic_order(table.own_blocks(), now, before) <= 0) return;
    for (int i = 0; i < table.n; ++i) point.x[i] = from_[i];
    point.current = false;
  }

  bool search_from(const double* x) {
    const bool found = level_search_.search(x);
    state.iterations += level_search_.solves;
    return found;
  }

  // Return true if the judged search ended with a part of a gradient left.
  bool stalled() const { return judge_.gap > kActive; }

  // An optimum that rests on an unclear rank, or a stalled search, is uncertain, unless it is the point of the working
  // set and the data's last digits do not move it.
  void doubt() {
    const bool unclear = smaller(problem_.tableau.closest, conditions_.closest) < kEither * kEither;
    if (!unclear && !conditions_.magnifies() && !stalled()) return;
    const bool still = !moves();
    settled = unclear && still;
    if (!still) state.outcome = Outcome::rank_uncertain;
  }

  // An optimum is uncertain if it is one only because of rows whose forces are smaller than its allowed gap: nearly
  // opposed rows have such forces by rounding, and holding them or not decides the remaining freedom.
  void doubt_forces() {
    if (state.outcome == Outcome::optimal && judge_.rests_on_less(kViolated)) state.outcome = Outcome::rank_uncertain;
  }

  // Return true if the working set has its point elsewhere than at x, or moves it by more than kActive, relative,
  // under an error of kNoRate in the multipliers, another rank tolerance, or growth without doubt.
  bool moves() {
    Table& table = problem_.table;
    const bool cut = problem_.tableau.cut_by_growth;
    const std::int8_t* W = problem_.set.W;
    const double* x = state.point.x;
    bool still = !conditions_.deadline.passed();
    for (int pattern = 0; pattern < 3 && still; ++pattern) {
      for (int r = 0; r < table.rows && pattern; ++r) {
        if (!W[r]) continue;
        double& bound = W[r] == kLower ? table.lower[r] : table.upper[r];
        bound_[r] = bound;
        const double off = kNoRate * (std::fabs(bound) + table.terms(r, x));
        bound += (static_cast<std::uint32_t>(r + 1) * 2654435761u >> (28 + pattern)) & 1u ? off : -off;
      }
      problem_.factorise();
      for (int r = 0; r < table.rows && pattern; ++r)
        if (W[r]) (W[r] == kLower ? table.lower[r] : table.upper[r]) = bound_[r];
      still = is_still();
    }
    double& tolerance = problem_.tableau.rank_tolerance;
    const double own = tolerance;
    for (const double factor : {1.0 / (kEither * kEither), kEither * kEither}) {
      if (!still) break;
      tolerance = factor * own;
      problem_.factorise();
      still = is_still();
    }
    tolerance = own;
    if (cut && !conditions_.deadline.passed()) {
      problem_.tableau.trusting = true;
      problem_.factorise();
      still = still && is_still();
      take_if_better(problem_.tableau.x);
      problem_.tableau.trusting = false;
    }
    problem_.factorise();
    table.product(problem_.tableau.x, problem_.values);
    return !still;
  }

  // Return true if the equality problem has its solution at x, within tolerance.
  bool is_still() const {
    const Table& table = problem_.table;
    const double* x = state.point.x;
    const double most = kActive * larger(1.0, table.largest(x));
    for (int i = 0; i < table.n; ++i)
      if (!(std::fabs(table.inside_box(i, problem_.tableau.x[i]) - x[i]) <= most)) return false;
    return true;
  }

  // The working set that the search level by level ended with, for the next problem.
  void take_working_set() {
    const Table& table = problem_.table;
    const Point& point = state.point;
    WorkingSet& set = problem_.set;
    table.product(point.x, point.v);
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      const double out = table.beyond(r, point.v[r]);
      set.W[r] = conditions_.held[table.n + r];
      if (!set.W[r]) set.W[r] = out > 0.0 ? kUpper : out < 0.0 ? kLower : kFree;
    }
    for (int i = 0; i < table.n; ++i)
      if (!table.fixed[i]) set.F[i] = conditions_.held[i];
    if (state.options->multipliers) problem_.factorise();
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
