// The working set: warm start, block exchange while it pays, then a monotone primal active set.
#pragma once

#include <ctime>

#include "multipliers.hpp"

namespace hqp {
inline namespace HQP_ISA {

static inline double now() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

class ActiveSet {
 public:
  Table table;
  Tableau tableau;
  Multipliers multipliers;
  std::int8_t* W = nullptr;   // (rows,) working rows
  std::int8_t* F = nullptr;   // (n,) variables held at a bound
  double* x = nullptr;        // (n,) the point
  double* v = nullptr;        // (rows,) A x
  int factorisations = 0, iterations = 0;
  Outcome outcome = Outcome::optimal;

  void layout(Arena& arena, int n, int levels, const int* m, int* blocks_m, bool metric) {
    table.layout(arena, n, levels, m, metric);
    int total = 0, most = n, count = 0;
    for (int k = 0; k < levels; ++k) { total += m[k]; most = m[k] > most ? m[k] : most; blocks_m[count++] = m[k]; }
    if (metric) { blocks_m[count++] = n; total += n; }
    blocks_m[count++] = n; total += n;
    // the box may leave level 0 out, which shifts the blocks: room for either numbering
    for (int k = 0; k + 1 < count; ++k) blocks_m[k] = blocks_m[k + 1] > blocks_m[k] ? blocks_m[k + 1] : blocks_m[k];
    tableau.layout(arena, n, count, blocks_m);
    multipliers.layout(arena, n, total, most);
    arena.place(W, total); arena.place(F, n); arena.place(x, n); arena.place(v, total);
    arena.place(first_W_, total); arena.place(first_F_, n); arena.place(first_x_, n);
    arena.place(step_, n); arena.place(change_, total); arena.place(target_, total);
    arena.place(side_, total); arena.place(side_x_, n); arena.place(seen_, kSeen); arena.place(jitter_, total + 2 * n);
  }

  void start() {
    table.start();
    tableau.table = &table;
    multipliers.table = &table;
    multipliers.tableau = &tableau;
  }

  void forget() { warm_ = false; }

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

  // A x; the tableau's own where x is its point to the bit.
  const double* values() {
    for (int i = 0; i < table.n; ++i)
      if (x[i] != tableau.x[i]) { table.product(x, v); return v; }
    return target_;
  }

 private:
  static constexpr int kSeen = 512;
  const Options* options_ = nullptr;
  std::int8_t *first_W_ = nullptr, *first_F_ = nullptr, *side_ = nullptr, *side_x_ = nullptr;
  double *first_x_ = nullptr, *step_ = nullptr, *change_ = nullptr, *target_ = nullptr, *jitter_ = nullptr;
  std::uint64_t* seen_ = nullptr;
  int cap_ = 0, seen_count_ = 0;
  double deadline_ = 0.0;
  int joins_[Tableau::kExtras] = {};
  std::int8_t join_sides_[Tableau::kExtras] = {};
  int joined_ = 0, progress_ = -1;
  bool joins_only_ = false;   // the working set is the tableau's and the joins, nothing else
  bool warm_ = false;
  bool followed_ = false;     // v was kept up with x

  // The last working set where it still makes sense, else equalities and nothing more.
  void working_set() {
    for (int r = 0; r < table.rows; ++r) {
      if (table.kind[r] == kEquality) W[r] = kEquality;
      else if (table.kind[r] == kFree || !warm_ || W[r] == kEquality) W[r] = kFree;
      else if ((W[r] == kUpper && table.upper[r] == kInfinity) || (W[r] == kLower && table.lower[r] == -kInfinity)) W[r] = kFree;
    }
    for (int i = 0; i < table.n; ++i) {
      if (table.fixed[i]) F[i] = kUpper;
      else if (!warm_ || (F[i] > 0 && table.hi[i] == kInfinity) || (F[i] < 0 && table.lo[i] == -kInfinity)) F[i] = kFree;
    }
  }

  // tableau.x and target_ = A tableau.x for the working set.
  void equality_point() {
    if (!extend()) { tableau.factorise(W, F); ++factorisations; }
    joined_ = 0; joins_only_ = false;
    table.product(tableau.x, target_);
    ++iterations;
  }

  void note_join(int what, std::int8_t side) {
    if (joined_ == Tableau::kExtras) { joins_only_ = false; return; }
    joins_[joined_] = what; join_sides_[joined_++] = side;
  }

  // Where the working set only grew since the tableau was made, let the newcomers join it: in front of the level
  // that ended it, or else of the one the last step went for.
  bool extend() {
    if (!joins_only_ || joined_ == 0) return false;
    const int last = tableau.gram_level;
    if (last >= 0 && tableau.rewind(last) && join_all()) return true;
    if (joined_ > 1 || progress_ == last || !tableau.rewind(progress_)) return false;
    return join_all();
  }

  bool join_all() {
    for (int q = 0; q < joined_; ++q) {
      const int what = joins_[q], i = what - table.rows;
      const bool upper = join_sides_[q] > 0;
      if (i < 0 ? !tableau.meet(what, upper ? table.upper[what] : table.lower[what])
                : !tableau.hold(i, upper ? table.hi[i] : table.lo[i]))
        return false;
    }
    tableau.resume(W);
    return true;
  }

  void accept() {
    for (int i = 0; i < table.n; ++i) {
      const double t = tableau.x[i];
      x[i] = t < table.lo[i] ? table.lo[i] : t > table.hi[i] ? table.hi[i] : t;
    }
    if (tableau.closest < 100.0) outcome = Outcome::rank_uncertain;
    if (tableau.shifted) outcome = Outcome::not_certified;
  }

  bool out_of_time() {
    if (iterations >= cap_) outcome = Outcome::iteration_limit;
    else if (deadline_ > 0.0 && now() > deadline_) outcome = Outcome::time_limit;
    else return false;
    return true;
  }

  double slackness(int r, double bound, double size) const {
    return options_->feasibility_tolerance * (std::fabs(bound) + table.norm[r] * size);
  }

  // Which rows and variables outside the working set are violated at the tableau's point; their number.
  int violations() {
    const double size = table.span(tableau.x);
    int number = 0;
    for (int r = 0; r < table.rows; ++r) {
      side_[r] = 0;
      if (table.kind[r] != kUpper || W[r]) continue;
      const double value = target_[r];
      if (value > table.upper[r] && value > table.upper[r] + slackness(r, table.upper[r], size)) side_[r] = kUpper;
      else if (value < table.lower[r] && value < table.lower[r] - slackness(r, table.lower[r], size)) side_[r] = kLower;
      number += side_[r] != 0;
    }
    const double tolerance = options_->feasibility_tolerance;
    for (int i = 0; i < table.n; ++i) {
      side_x_[i] = 0;
      if (F[i]) continue;
      const double value = tableau.x[i];
      if (value > table.hi[i] && value > table.hi[i] + tolerance * (std::fabs(table.hi[i]) + size)) side_x_[i] = kUpper;
      else if (value < table.lo[i] && value < table.lo[i] - tolerance * (std::fabs(table.lo[i]) + size)) side_x_[i] = kLower;
      number += side_x_[i] != 0;
    }
    return number;
  }

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

  void release(const Wrong& wrong) {
    joins_only_ = false;
    if (wrong.variable) F[wrong.index] = kFree;
    else W[wrong.index] = kFree;
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

  double inside_box(int i, double t) const { return t < table.lo[i] ? table.lo[i] : t > table.hi[i] ? table.hi[i] : t; }

  // Rows violated at x work at their side, rows well inside do not, rows at a bound stay as they are.
  void sort_rows() {
    const double size = table.span(x);
    for (int r = 0; r < table.rows; ++r) {
      if (table.kind[r] != kUpper) continue;
      const double above = slackness(r, table.upper[r], size), below = slackness(r, table.lower[r], size);
      const std::int8_t old = W[r];
      if (v[r] > table.upper[r] + above) W[r] = kUpper;
      else if (v[r] < table.lower[r] - below) W[r] = kLower;
      else if (W[r] == kUpper && v[r] < table.upper[r] - above) W[r] = kFree;
      else if (W[r] == kLower && v[r] > table.lower[r] + below) W[r] = kFree;
      joins_only_ = joins_only_ && W[r] == old;
    }
  }

  // First level that the step changes: the levels above it must not be disturbed, those below do not count.
  int progress(double length, double size) const {
    for (int k = 0; k < table.blocks; ++k) {
      const Block& b = table.block[k];
      double square = 0.0;
      for (int r = b.begin; r < b.end; ++r) if (W[r]) square += change_[r] * change_[r];
      if (std::sqrt(square) > 1e-9 * b.norm * (length + 1e-3 * size)) return k;
    }
    return table.blocks;
  }

  // Go towards the tableau's point until something blocks; true if nothing did.
  bool advance() {
    const int n = table.n;
    double length = 0.0;
    for (int i = 0; i < n; ++i) { step_[i] = tableau.x[i] - x[i]; length += step_[i] * step_[i]; }
    for (int r = 0; r < table.rows; ++r) change_[r] = target_[r] - v[r];
    const double size = table.span(tableau.x), tolerance = options_->feasibility_tolerance;
    const int level = progress_ = progress(std::sqrt(length), table.span(x));
    double alpha = 1.0;
    int row = -1, variable = -1;
    std::int8_t side = 0;
    for (int i = 0; i < n; ++i) {
      if (F[i] || step_[i] == 0.0) continue;
      const double bound = step_[i] > 0 ? table.hi[i] : table.lo[i];
      const double over = step_[i] > 0 ? tableau.x[i] - bound : bound - tableau.x[i];
      if (!(over > tolerance * (std::fabs(bound) + size))) continue;
      const double a = larger(0.0, (bound - x[i]) / step_[i]);
      if (a < alpha) { alpha = a; variable = i; side = step_[i] > 0 ? kUpper : kLower; }
    }
    const int rows = level < table.blocks ? table.block[level].begin : table.rows;
    for (int r = 0; r < rows; ++r) {
      if (table.kind[r] != kUpper || W[r] || change_[r] == 0.0) continue;
      const double bound = change_[r] > 0 ? table.upper[r] : table.lower[r];
      const double over = change_[r] > 0 ? target_[r] - bound : bound - target_[r];
      if (!(over > slackness(r, bound, size))) continue;
      const double a = larger(0.0, (bound - v[r]) / change_[r]);
      if (a < alpha) { alpha = a; row = r; variable = -1; side = change_[r] > 0 ? kUpper : kLower; }
    }
    if (level < table.blocks) bend(level, size, alpha, row, variable, side);
    if (alpha >= 1.0 && row < 0 && variable < 0) return true;
    for (int i = 0; i < n; ++i) if (!F[i]) x[i] = inside_box(i, x[i] + alpha * step_[i]);
    for (int r = 0; r < table.rows; ++r) v[r] += alpha * change_[r];
    followed_ = true;
    joins_only_ = variable >= 0 || row >= 0;
    if (variable >= 0) {
      F[variable] = side;
      x[variable] = side > 0 ? table.hi[variable] : table.lo[variable];
      note_join(table.rows + variable, side);
    }
    if (row >= 0) { W[row] = side; note_join(row, side); }
    return false;
  }

  // Rows of the level itself that the step would violate make its norm bend: stop where it is lowest. Where that
  // is at once, by rounding, the first of them joins the working set instead.
  void bend(int level, double size, double& alpha, int& row, int& variable, std::int8_t& side) const {
    double first = kInfinity;
    int nearest = -1;
    for (int r = table.block[level].begin; r < table.block[level].end; ++r) {
      if (table.kind[r] != kUpper || W[r] || change_[r] == 0.0) continue;
      const double bound = change_[r] > 0 ? table.upper[r] : table.lower[r];
      if (!((change_[r] > 0 ? target_[r] - bound : bound - target_[r]) > slackness(r, bound, size))) continue;
      const double a = larger(0.0, (bound - v[r]) / change_[r]);
      if (a < first) { first = a; nearest = r; }
    }
    if (nearest < 0) return;
    const double bottom = lowest(level, alpha);
    if (bottom > 1e-12 && bottom < alpha) { alpha = bottom; row = variable = -1; }
    else if (bottom <= 1e-12 && first <= alpha) {
      alpha = first; row = nearest; variable = -1; side = change_[nearest] > 0 ? kUpper : kLower;
    }
  }

  double slope(int begin, int end, double alpha) const {
    double s = 0.0;
    for (int r = begin; r < end; ++r) {
      const double value = v[r] + alpha * change_[r];
      const double out = value > table.upper[r] ? value - table.upper[r] : value < table.lower[r] ? value - table.lower[r] : 0.0;
      s += change_[r] * out;
    }
    return s;
  }

  // Where a level, a convex piecewise quadratic along the step, is lowest on [0, alpha].
  double lowest(int level, double alpha) const {
    const int begin = table.block[level].begin, end = table.block[level].end;
    const double start = slope(begin, end, 0.0);
    double low = 0.0, high = alpha, at_high = slope(begin, end, alpha), at_low = start;
    if (at_high <= 1e-12 * std::fabs(start)) return alpha;
    for (int r = begin; r < end; ++r) {              // shrink the bracket over the kinks inside it
      if (table.kind[r] != kUpper || change_[r] == 0.0) continue;
      for (int q = 0; q < 2; ++q) {
        const double kink = ((q ? table.upper[r] : table.lower[r]) - v[r]) / change_[r];
        if (!(kink > low && kink < high)) continue;
        const double s = slope(begin, end, kink);
        if (s >= 0.0) { high = kink; at_high = s; } else { low = kink; at_low = s; }
      }
    }
    const double a = at_high > at_low ? low - (high - low) * at_low / (at_high - at_low) : high;
    return a < alpha * (1.0 - 1e-12) ? larger(a, 0.0) : alpha;
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
