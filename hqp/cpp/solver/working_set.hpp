// A working set: which rows work, which variables are held, its solution, and what that violates.
#pragma once

#include "level_search.hpp"
#include "multipliers.hpp"

namespace hqp {
inline namespace HQP_ISA {

class WorkingSet {
 public:
  Table table;
  Tableau tableau;
  Multipliers multipliers;
  LevelSearch level_search;
  std::int8_t* W = nullptr;  // (rows,) working rows
  std::int8_t* F = nullptr;  // (n,) variables held at a bound
  double* x = nullptr;       // (n,) the point
  double* v = nullptr;       // (rows,) A x
  int factorisations = 0, iterations = 0;
  int judged = 0;  // 1: the answer was doubted and judged, 2: it was refused and searched for level by level
  Outcome outcome = Outcome::optimal;
  bool settled = false;  // an unclear rank does not matter: the data's last digits do not move x

  void layout(Arena& arena, int n, int levels, const int* m, int* blocks_m, bool metric) {
    table.layout(arena, n, levels, m, metric);
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
    tableau.layout(arena, n, count, blocks_m);
    multipliers.layout(arena, n, total, most);
    level_search.layout(arena, n, total, most, count);
    arena.place(W, total);
    arena.place(F, n);
    arena.place(x, n);
    arena.place(v, total);
    arena.place(start_W_, total);
    arena.place(start_F_, n);
    arena.place(start_x_, n);
    arena.place(start_slack_, count);
    arena.place(step_, n);
    arena.place(reach_, n);
    arena.place(change_, total);
    arena.place(target_, total);
    arena.place(trial_x_, n);
    arena.place(trial_v_, total);
    arena.place(side_, total);
    arena.place(side_x_, n);
    arena.place(seen_, kSeen);
  }

  void start() {
    table.start();
    tableau.table = &table;
    multipliers.table = &table;
    multipliers.tableau = &tableau;
    level_search.start(&table);
  }

  void forget(bool plain) {
    warm_ = false;
    always_refactorise_ = plain;
  }

  // A x; the tableau's own where x is its point to the bit.
  const double* values() {
    for (int i = 0; i < table.n; ++i)
      if (x[i] != tableau.x[i]) {
        table.product(x, v);
        return v;
      }
    return target_;
  }

 protected:
  static constexpr int kSeen = 512;
  static constexpr double kTurns = 2.0;  // another turn like the last one, and what is left to do after it
  static constexpr int kIdle = 16;       // so many steps of no length may follow one another
  static constexpr double kNear = 1e4;   // a pivot this near it, or one that magnifies rounding by kGrown, is judged
  static constexpr double kGrown = 1e6;
  static constexpr double kGood = 1e-10;     // an answer that was judged and has a larger gap is lowered level by level
  static constexpr double kDoubt = 100.0;    // a pivot this near the rank tolerance, as a ratio, is no clear decision
  static constexpr double kDigits = 1e-12;   // of the data, relative: those that are not known
  static constexpr double kUnmoved = 1e-10;  // x moves by no more, relative: its ranks are certain enough
  static constexpr int kFarStart = 4;        // a first point is far off if it violates more than n / kFarStart bounds
  static constexpr double kSame = 1e-9;      // slacks nearer than this, relative to 1 + slack, are no progress
  const Options* options_ = nullptr;
  std::int8_t *start_W_ = nullptr, *start_F_ = nullptr, *side_ = nullptr, *side_x_ = nullptr;
  double *start_x_ = nullptr, *start_slack_ = nullptr, *step_ = nullptr, *reach_ = nullptr, *change_ = nullptr,
         *target_ = nullptr;
  double *trial_x_ = nullptr, *trial_v_ = nullptr;
  std::uint64_t* seen_ = nullptr;
  int cap_ = 0, seen_count_ = 0;
  Changes changes_;    // since the tableau was made
  int progress_ = -1;  // first level that the last step changed
  bool warm_ = false;
  bool always_refactorise_ = false;  // this search factorises every working set
  bool product_is_current_ = false;  // v = A x
  double alpha_ = 0.0;               // length of the last step, 1 for a whole one
  bool stalled_ = false;             // a step had no length
  bool stopped_ = false;             // the search was given up at x, which need not be optimal
  bool overlooked_ = false;          // a bound is exceeded by what only rows that reach far beyond x make rounding

  // The last working set where it still makes sense, else equalities and nothing more.
  void working_set() {
    for (int r = 0; r < table.rows; ++r) {
      if (table.kind[r] == kEquality) W[r] = kEquality;
      else if (table.kind[r] == kFree || !warm_ || W[r] == kEquality) W[r] = kFree;
      else if ((W[r] == kUpper && table.upper[r] == kInfinity) || (W[r] == kLower && table.lower[r] == -kInfinity))
        W[r] = kFree;
    }
    for (int i = 0; i < table.n; ++i) {
      if (table.fixed[i]) F[i] = kUpper;
      else if (!warm_ || (F[i] > 0 && table.hi[i] == kInfinity) || (F[i] < 0 && table.lo[i] == -kInfinity))
        F[i] = kFree;
    }
  }

  // tableau.x and target_ = A tableau.x for the working set.
  void equality_point() {
    if (!update()) {
      tableau.factorise(W, F);
      ++factorisations;
    }
    changes_.forget();
    table.product(tableau.x, target_);
    ++iterations;
  }

  // Without a factorisation, where the changes are known: what left leaves in front of the level that asked for it;
  // what joined joins in front of the level that ended the tableau, or else of the one the last step went for.
  bool update() {
    if (always_refactorise_ || !changes_.known) return false;
    if (changes_.front >= 0) return tableau.rewind(changes_.front) && leave_all();
    if (changes_.joined == 0) return tableau.deepen(W);
    const int last = tableau.gram_level, before = tableau.newcomers;
    if (last >= 0 && tableau.rewind(last) && join_all()) return true;
    tableau.newcomers = before;
    if (changes_.joined > 1 || progress_ == last || !tableau.rewind(progress_)) return false;
    return join_all();
  }

  bool join_all() {
    for (int q = 0; q < changes_.joined; ++q) {
      const int what = changes_.join[q], i = what - table.rows;
      const bool upper = changes_.side[q] > 0;
      if (i < 0 ? !tableau.meet(what, upper ? table.upper[what] : table.lower[what])
                : !tableau.hold(i, upper ? table.hi[i] : table.lo[i]))
        return false;
    }
    tableau.resume(W);
    return true;
  }

  bool leave_all() {
    for (int q = 0; q < changes_.left; ++q)
      if (!tableau.let_go(changes_.leave[q])) return false;
    tableau.resume(W);
    return true;
  }

  // To the point of the box next to the tableau's.
  void go_to_point() {
    for (int i = 0; i < table.n; ++i) x[i] = inside_box(i, tableau.x[i]);
    tableau.reduction.follow(x, table.n);
  }

  void accept() {
    go_to_point();
    if (tableau.closest < kDoubt) outcome = Outcome::rank_uncertain;
  }

  bool out_of_time() {
    if (iterations >= cap_) outcome = Outcome::iteration_limit;
    else if (level_search.deadline.too_near(kTurns)) outcome = Outcome::time_limit;
    else return false;
    return true;
  }

  double slackness(int r, double bound, double size) const {
    return options_->feasibility_tolerance * (std::fabs(bound) + table.norm[r] * size);
  }

  // Whether row r is outside its bound by so much at the tableau's point. Its own terms decide: a long row that is
  // short along a long x, such as the acceleration of a light gripper by all torques, would else pass far outside.
  bool is_over(int r, double over, double bound, double size) const {
    if (!(over > 0.0) || over > slackness(r, bound, size)) return over > 0.0;
    const double own = std::fabs(bound) + table.terms(r, tableau.x), rounding = 1e-15 * table.norm[r] * size;
    return over > options_->feasibility_tolerance * own + rounding;
  }

  // Which rows and variables outside the working set are violated at the tableau's point; their number.
  int violations() {
    const double size = table.span(tableau.x), near = table.largest(tableau.x);
    overlooked_ = near < size && exceeded(near);
    int number = 0;
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      side_[r] = 0;
      if (W[r]) continue;
      const double value = target_[r];
      if (is_over(r, value - table.upper[r], table.upper[r], size)) side_[r] = kUpper;
      else if (is_over(r, table.lower[r] - value, table.lower[r], size)) side_[r] = kLower;
      number += side_[r] != 0;
    }
    const double tolerance = options_->feasibility_tolerance;
    for (int i = 0; i < table.n; ++i) {
      side_x_[i] = 0;
      if (F[i]) continue;
      const double value = tableau.x[i];
      if (value > table.hi[i] && value > table.hi[i] + tolerance * (std::fabs(table.hi[i]) + size)) side_x_[i] = kUpper;
      else if (value < table.lo[i] && value < table.lo[i] - tolerance * (std::fabs(table.lo[i]) + size))
        side_x_[i] = kLower;
      number += side_x_[i] != 0;
    }
    return number;
  }

  // Whether a row or variable outside the working set exceeds a bound where the size of x is taken to be `size`.
  bool exceeded(double size) const {
    for (int q = 0; q < table.inequalities; ++q) {
      const int r = table.unequal[q];
      const double out = table.beyond(r, target_[r]);
      if (!W[r] && std::fabs(out) > slackness(r, out > 0.0 ? table.upper[r] : table.lower[r], size)) return true;
    }
    for (int i = 0; i < table.n; ++i) {
      const double bound = inside_box(i, tableau.x[i]), out = std::fabs(tableau.x[i] - bound);
      if (!F[i] && out > options_->feasibility_tolerance * (std::fabs(bound) + size)) return true;
    }
    return false;
  }

  // Norm of what the rows of a level miss at values (rows,).
  double outside(int level, const double* values) const {
    double square = 0.0;
    for (int r = table.block[level].begin; r < table.block[level].end; ++r) {
      const double out = table.beyond(r, values[r]);
      square += out * out;
    }
    return std::sqrt(square);
  }

  double inside_box(int i, double t) const { return t < table.lo[i] ? table.lo[i] : t > table.hi[i] ? table.hi[i] : t; }

  void release(const WrongSign& wrong) {
    if (wrong.variable) {
      F[wrong.index] = kFree;
      changes_.note_leave(wrong.index);
    } else {
      W[wrong.index] = kFree;
      if (wrong.index < table.block[wrong.level].begin)
        changes_.forget();  // one of its own level is not in front of it
    }
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
