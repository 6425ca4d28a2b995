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
    factorisations = iterations = 0;
    outcome = Outcome::optimal;
    cap_ = options.max_iterations > 0 ? options.max_iterations : 100 + 10 * (table.rows + table.n);
    deadline_ = options.time_limit > 0 ? now() + options.time_limit : 0.0;
    changes_.forget();
    tableau.choose_bias();
    multipliers.listen();
    uncertain_ = false;
    doubted_ = kInfinity;
    working_set();
    tableau.recording = false;
    if (table.inequalities == 0 && !table.boxed) {
      equality_point();
      accept();
    } else if (!block_exchange()) primal();
    warm_ = true;
    plain_ = false;
  }

 private:
  // Swap everything that is violated or wrong-signed at once; true if that ends at the optimum.
  bool block_exchange() {
    int credit = options_->credit, best = 1 << 30;
    forget_start();
    for (;;) {
      equality_point();
      const int outside = violations();
      multipliers.judge(W, F, target_);
      const int trouble = outside + multipliers.count;
      if (trouble == 0) {
        if (!reduced()) {
          accept();
          return true;
        }
        unreduce();
        forget_start();
        continue;
      }
      const bool reduces = iterations == 1 && kCrowd * outside > table.n && reduce();
      if (reduces) credit = 0;
      keep_start();
      if (trouble < best) best = trouble;
      else if (--credit < 0 || trouble > 2 * best) return false;
      if (iterations > 1 && out_of_time()) {
        go_to_start();
        if (reduced()) unreduce();
        return true;
      }
      changes_.start();
      for (int r = 0; r < table.rows; ++r)
        if (side_[r]) {
          W[r] = side_[r];
          changes_.note_join(r, side_[r]);
        }
      for (int i = 0; i < table.n; ++i)
        if (side_x_[i]) {
          F[i] = side_x_[i];
          changes_.note_join(table.rows + i, side_x_[i]);
        }
      if (reduces || multipliers.count) changes_.forget();
      for (int q = 0; q < multipliers.count; ++q) release(multipliers.wrong[q]);
    }
  }

  // Far from the optimum: go on in fewer variables, with the same working sets; false where that saves too little.
  bool reduce() {
    if (plain_ || !tableau.reduce(table)) return false;
    tableau.reduction.mark(W, kFree);
    return true;
  }

  bool reduced() const { return tableau.reduction.count > 0; }

  // Back to all variables, where the answer is judged.
  void unreduce() {
    tableau.reduction.mark(W, kEquality);
    tableau.reduction.undo(table);
    changes_.forget();
    followed_ = false;
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
    for (int r = 0; r < table.rows; ++r) start_W_[r] = side_[r] ? side_[r] : W[r];
    for (int i = 0; i < table.n; ++i) {
      start_F_[i] = side_x_[i] ? side_x_[i] : F[i];
      start_x_[i] = x[i];
    }
  }

  void go_to_start() {
    for (int i = 0; i < table.n; ++i) x[i] = start_x_[i];
  }

  // Lexicographic descent from the best point so far: x never leaves the box, no level rises for a lower one.
  void primal() {
    for (int r = 0; r < table.rows; ++r) W[r] = start_W_[r];
    for (int i = 0; i < table.n; ++i) F[i] = start_F_[i];
    go_to_start();
    changes_.forget();
    tableau.recording = true;
    seen_count_ = 0;
    followed_ = false;
    int let_go = 0, rank = 0;  // how many of multipliers.wrong were released for the step at hand, and from which rank
    repeats_ = 0;
    disturbed_ = false;
    while (!out_of_time()) {
      if (iterations % 16 == 0 || !followed_) table.product(x, v);
      followed_ = false;
      sort_rows();
      equality_point();
      bool unmoved = let_go && rank_of(multipliers.wrong[0].level) <= rank;
      if (unmoved && tableau.loosened) {  // no update may say so
        equality_point();
        unmoved = rank_of(multipliers.wrong[0].level) <= rank;
      }
      const bool whole = advance();
      if (unmoved && progress_ > multipliers.wrong[0].level) silence(let_go);
      let_go = 0;
      if (!whole) continue;
      go_to_point();
      if (violations()) continue;
      multipliers.judge(W, F, target_, true);
      if (multipliers.count == 0) {
        if (reduced()) {
          unreduce();
          continue;
        }
        if (tableau.loosened) {
          changes_.forget();
          continue;
        }  // judged on a tableau of its own
        if (!disturbed_) {
          accept();
          return;
        }
        restore();
        followed_ = false;
        continue;
      }
      const bool again = repeated();
      if (again && reduced()) {
        unreduce();
        continue;
      }
      if (again && get_unstuck()) continue;
      if (repeats_ > kRepeats) {
        outcome = Outcome::not_certified;
        break;
      }
      let_go = release_some(repeats_ > 0);
      rank = rank_of(multipliers.wrong[0].level);
    }
    if (reduced()) unreduce();
    if (disturbed_) restore();
  }

  // At the highest level that is held back: the strongest and those at least half as strong, or one by index; they
  // come first in `wrong` then, and their number is returned.
  int release_some(bool careful) {
    Wrong* wrong = multipliers.wrong;
    int level = 1 << 30, lowest = -1, count = 0;
    double most = 0.0;
    for (int q = 0; q < multipliers.count; ++q) level = wrong[q].level < level ? wrong[q].level : level;
    for (int q = 0; q < multipliers.count; ++q) {
      if (wrong[q].level != level) continue;
      most = larger(most, wrong[q].size);
      if (lowest < 0 || order(wrong[q]) < order(wrong[lowest])) lowest = q;
    }
    for (int q = 0; q < multipliers.count; ++q)
      if (careful ? q == lowest : wrong[q].level == level && wrong[q].size >= 0.5 * most) wrong[count++] = wrong[q];
    changes_.start(level);
    for (int q = 0; q < count; ++q) release(wrong[q]);
    return count;
  }

  // The working sets repeat: first single changes, then a rank that comes and goes is let go, then every bound is
  // widened; true in that case.
  bool get_unstuck() {
    seen_count_ = 0;
    const bool doubted = doubted_ < kDoubt && tableau.rank_tolerance < kLoosest;
    doubted_ = kInfinity;
    if (repeats_ > 0 && doubted) {
      multipliers.deaf = tableau.rank_tolerance *= 10.0;
      uncertain_ = true;
      return false;
    }
    if (++repeats_ != 3) return false;
    disturb();
    return true;
  }

  int rank_of(int level) const { return tableau.stage[level].rank; }

  // The level for whose sake these were let go neither moved nor gained rank: it has no say in them.
  void silence(int count) {
    for (int q = 0; q < count; ++q) multipliers.silence(multipliers.wrong[q]);
    uncertain_ = true;
  }

  int order(const Wrong& wrong) const { return wrong.variable ? wrong.index : table.n + wrong.index; }

  // Whether this working set was left before (64-bit hash).
  bool repeated() {
    std::uint64_t hash = 1469598103934665603ull;
    for (int r = 0; r < table.rows; ++r) hash = (hash ^ static_cast<std::uint8_t>(W[r] + 1)) * 1099511628211ull;
    for (int i = 0; i < table.n; ++i) hash = (hash ^ static_cast<std::uint8_t>(F[i] + 1)) * 1099511628211ull;
    for (int q = 0; q < (seen_count_ < kSeen ? seen_count_ : kSeen); ++q)
      if (seen_[q] == hash) return true;
    seen_[seen_count_++ % kSeen] = hash;
    return false;
  }

  // Last resort against a degenerate vertex: widen every inequality by its own tiny amount, undone at the end.
  void disturb() {
    disturbed_ = true;
    std::uint64_t state = 88172645463325252ull;
    changes_.forget();
    const double size = table.span(x);
    auto tiny = [&state]() {
      state ^= state << 13;
      state ^= state >> 7;
      state ^= state << 17;
      return 1e-9 * (0.5 + 0.5 * static_cast<double>(state >> 11) / 9007199254740992.0);
    };
    for (int r = 0; r < table.rows; ++r) {
      jitter_[r] = 0.0;
      if (table.kind[r] != kUpper) continue;
      jitter_[r] = tiny() * table.norm[r] * size;
      table.upper[r] += jitter_[r];
      table.lower[r] -= jitter_[r];
    }
    double* box = jitter_ + table.rows;
    for (int i = 0; i < table.n; ++i) {
      box[2 * i] = table.lo[i];
      box[2 * i + 1] = table.hi[i];
      if (table.fixed[i]) continue;
      const double t = tiny() * size;
      table.lo[i] -= t;
      table.hi[i] += t;
    }
    for (int i = 0; i < table.n; ++i)
      if (F[i] && !table.fixed[i]) x[i] = F[i] > 0 ? table.hi[i] : table.lo[i];
  }

  void restore() {
    disturbed_ = false;
    changes_.forget();
    for (int r = 0; r < table.rows; ++r)
      if (jitter_[r] != 0.0) {
        table.upper[r] -= jitter_[r];
        table.lower[r] += jitter_[r];
      }
    const double* box = jitter_ + table.rows;
    for (int i = 0; i < table.n; ++i) {
      table.lo[i] = box[2 * i];
      table.hi[i] = box[2 * i + 1];
      x[i] = inside_box(i, x[i]);
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
