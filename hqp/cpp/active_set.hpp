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
    tableau.choose_bias();
    working_set();
    if (table.inequalities == 0 && !table.boxed) { equality_point(); accept(); return; }
    tableau.recording = false;
    if (!block_exchange()) primal();
    warm_ = true;
  }

 private:
  // Swap everything that is violated or wrong-signed at once; true if that ends at the optimum.
  bool block_exchange() {
    int credit = options_->credit, best = 1 << 30;
    for (bool first = true;; first = false) {
      equality_point();
      const int outside = violations();
      multipliers.judge(W, F, target_);
      const int trouble = outside + multipliers.count;
      if (trouble == 0) { accept(); return true; }
      if (first) save_first();
      if (trouble < best) best = trouble;
      else if (--credit < 0) return false;
      if (iterations > 1 && out_of_time()) { clip_first(); return true; }
      joined_ = 0;
      joins_only_ = multipliers.count == 0;
      for (int r = 0; r < table.rows && joins_only_; ++r) if (side_[r]) note_join(r, side_[r]);
      for (int i = 0; i < table.n && joins_only_; ++i) if (side_x_[i]) note_join(table.rows + i, side_x_[i]);
      for (int r = 0; r < table.rows; ++r) if (side_[r]) W[r] = side_[r];
      for (int i = 0; i < table.n; ++i) if (side_x_[i]) F[i] = side_x_[i];
      for (int q = 0; q < multipliers.count; ++q) release(multipliers.wrong[q]);
    }
  }

  void save_first() {
    for (int r = 0; r < table.rows; ++r) first_W_[r] = side_[r] ? side_[r] : W[r];
    for (int i = 0; i < table.n; ++i) {
      first_F_[i] = side_x_[i] ? side_x_[i] : F[i];
      const double t = tableau.x[i];
      first_x_[i] = t < table.lo[i] ? table.lo[i] : t > table.hi[i] ? table.hi[i] : t;
    }
  }

  void clip_first() { for (int i = 0; i < table.n; ++i) x[i] = first_x_[i]; }

  // Lexicographic descent from the clipped first point: x never leaves the box, no level rises for a lower one.
  void primal() {
    for (int r = 0; r < table.rows; ++r) W[r] = first_W_[r];
    for (int i = 0; i < table.n; ++i) F[i] = first_F_[i];
    clip_first();
    joins_only_ = false;
    tableau.recording = true;
    seen_count_ = 0;
    followed_ = false;
    int repeats = 0;
    bool disturbed = false;
    while (!out_of_time()) {
      if (iterations % 16 == 0 || !followed_) table.product(x, v);
      followed_ = false;
      sort_rows();
      equality_point();
      if (!advance()) continue;
      for (int i = 0; i < table.n; ++i) x[i] = inside_box(i, tableau.x[i]);
      if (violations()) continue;
      multipliers.judge(W, F, target_);
      if (multipliers.count == 0) {
        if (disturbed) { restore(); settle(); return; }
        accept();
        return;
      }
      if (repeated()) {
        seen_count_ = 0;
        if (++repeats == 3) { disturb(); disturbed = true; continue; }
        if (repeats > 20) { outcome = Outcome::not_certified; break; }
      }
      release_some(repeats > 0);
    }
    if (disturbed) restore();
  }

  // At the highest level that is held back: the strongest and those at least half as strong, or one by index.
  void release_some(bool careful) {
    int level = 1 << 30, lowest = -1;
    double most = 0.0;
    for (int q = 0; q < multipliers.count; ++q) level = multipliers.wrong[q].level < level ? multipliers.wrong[q].level : level;
    for (int q = 0; q < multipliers.count; ++q) {
      const Wrong& wrong = multipliers.wrong[q];
      if (wrong.level != level) continue;
      most = larger(most, wrong.size);
      if (lowest < 0 || order(wrong) < order(multipliers.wrong[lowest])) lowest = q;
    }
    if (careful) { release(multipliers.wrong[lowest]); return; }
    for (int q = 0; q < multipliers.count; ++q) {
      const Wrong& wrong = multipliers.wrong[q];
      if (wrong.level == level && wrong.size >= 0.5 * most) release(wrong);
    }
  }

  int order(const Wrong& wrong) const { return wrong.variable ? wrong.index : table.n + wrong.index; }

  // Whether this working set was left before (64-bit hash).
  bool repeated() {
    std::uint64_t hash = 1469598103934665603ull;
    for (int r = 0; r < table.rows; ++r) hash = (hash ^ static_cast<std::uint8_t>(W[r] + 1)) * 1099511628211ull;
    for (int i = 0; i < table.n; ++i) hash = (hash ^ static_cast<std::uint8_t>(F[i] + 1)) * 1099511628211ull;
    for (int q = 0; q < (seen_count_ < kSeen ? seen_count_ : kSeen); ++q) if (seen_[q] == hash) return true;
    seen_[seen_count_++ % kSeen] = hash;
    return false;
  }

  // Last resort against a degenerate vertex: widen every inequality by its own tiny amount, undone at the end.
  void disturb() {
    std::uint64_t state = 88172645463325252ull;
    joins_only_ = false;
    const double size = table.span(x);
    auto tiny = [&state]() {
      state ^= state << 13; state ^= state >> 7; state ^= state << 17;
      return 1e-9 * (0.5 + 0.5 * static_cast<double>(state >> 11) / 9007199254740992.0);
    };
    for (int r = 0; r < table.rows; ++r) {
      jitter_[r] = 0.0;
      if (table.kind[r] != kUpper) continue;
      jitter_[r] = tiny() * table.norm[r] * size;
      table.upper[r] += jitter_[r]; table.lower[r] -= jitter_[r];
    }
    double* box = jitter_ + table.rows;
    for (int i = 0; i < table.n; ++i) {
      box[2 * i] = table.lo[i]; box[2 * i + 1] = table.hi[i];
      if (table.fixed[i]) continue;
      const double t = tiny() * size;
      table.lo[i] -= t; table.hi[i] += t;
    }
    for (int i = 0; i < table.n; ++i) if (F[i] && !table.fixed[i]) x[i] = F[i] > 0 ? table.hi[i] : table.lo[i];
  }

  void restore() {
    joins_only_ = false;
    for (int r = 0; r < table.rows; ++r)
      if (jitter_[r] != 0.0) { table.upper[r] -= jitter_[r]; table.lower[r] += jitter_[r]; }
    const double* box = jitter_ + table.rows;
    for (int i = 0; i < table.n; ++i) { table.lo[i] = box[2 * i]; table.hi[i] = box[2 * i + 1]; x[i] = inside_box(i, x[i]); }
  }

  // The working set of the disturbed problem, judged on the undisturbed one.
  void settle() {
    equality_point();
    accept();
    const double size = table.span(tableau.x);
    for (int i = 0; i < table.n; ++i)
      if (std::fabs(tableau.x[i] - x[i]) > 1e-7 * (size + std::fabs(x[i]))) outcome = Outcome::not_certified;
    for (int r = 0; r < table.rows; ++r) {
      if (table.kind[r] != kUpper || W[r]) continue;
      const double limit = 1e-7 * table.norm[r] * size;
      if (target_[r] > table.upper[r] + limit || target_[r] < table.lower[r] - limit) outcome = Outcome::not_certified;
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
