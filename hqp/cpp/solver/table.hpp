// The caller's problem as one table of rows: the box taken out of level 0, completion levels put at the end.
#pragma once

#include "arena.hpp"
#include "dense.hpp"
#include "metric_root.hpp"
#include "problem.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

enum Mark : std::int8_t { kLower = -1, kFree = 0, kUpper = 1, kEquality = 2 };

// A level inside the kernel: rows [begin, end) of the table.
struct Block {
  const double* A;            // dense (m, n), or null
  const std::int64_t* index;  // selection
  const double* scale;
  double norm;      // largest norm of a row that is not left out
  double rounding;  // no direction of the level is shorter: rounding of zero in this problem
  bool graded;      // its rows differ in length: rounding of the longest hides the forces of the others
  int begin, end;
  int unequal_begin, unequal_end;  // range of its inequalities in `unequal`
  bool equalities;                 // it has nothing else
};

struct Table {
  static constexpr double kGraded = 1e-2;  // a row so much shorter than the longest makes a level graded
  int n = 0, blocks = 0, rows = 0, inequalities = 0;
  int first = 0;  // 1 if level 0 became the box
  double reach =
      0.0;  // largest distance requested by a row of usual length, |bound| / norm: the scale of rounding in x
  bool uneven = false;     // rows of one level differ in length by more than 1e5
  bool shortened = false;  // a row is so short that rounding of the longest one turns it by more than 1e-10
  bool has_metric = false;
  int constraint_blocks = 0;  // the first of them, which are constraints, or bounds on single variables
  bool boxed = false;         // some variable has a finite bound or is fixed
  Block* block = nullptr;
  double* lower = nullptr;  // (rows,) of the table, copies
  double* upper = nullptr;
  double* norm = nullptr;
  std::int8_t* kind = nullptr;  // kEquality, kFree = left out, kUpper = inequality
  int* unequal = nullptr;       // (inequalities,) their rows, in order
  double* lo = nullptr;         // (n,) the box
  double* hi = nullptr;
  std::int8_t* fixed = nullptr;  // (n,) lo == hi
  double* metric_rows = nullptr;
  double* metric_rhs = nullptr;
  double* zeros = nullptr;
  std::int64_t* every = nullptr;
  double* ones = nullptr;
  std::int64_t* single_index = nullptr;  // (caller's rows,) dense levels with one entry a row, as selections
  double* single_scale = nullptr;
  double* scratch = nullptr;
  double tolerance = kMet;  // tolerance of feasibility, relative to a row's terms

  void layout(Arena& arena, int n_, int levels, const int* m, bool metric) {
    n = n_;
    int total = 0;
    for (int k = 0; k < levels; ++k) total += m[k];
    const int all = total + n + (metric ? n : 0);
    arena.place(block, static_cast<std::size_t>(levels) + 2);
    arena.place(lower, all);
    arena.place(upper, all);
    arena.place(norm, all);
    arena.place(kind, all);
    arena.place(unequal, all);
    arena.place(lo, n);
    arena.place(hi, n);
    arena.place(fixed, n);
    arena.place(metric_rows, metric ? static_cast<std::size_t>(n) * n : 0);
    arena.place(metric_rhs, n);
    arena.place(zeros, n);
    arena.place(every, n);
    arena.place(ones, n);
    arena.place(single_index, total + 1);
    arena.place(single_scale, total + 1);
    arena.place(scratch, metric ? n : 0);
  }

  void start() {
    for (int i = 0; i < n; ++i) {
      every[i] = i;
      ones[i] = 1.0;
    }
  }

  // Read the problem; false if a number is not usable.
  bool read(const Problem& problem) {
    rows = 0;
    blocks = 0;
    inequalities = 0;
    first = 0;
    reach = 0.0;
    uneven = shortened = false;
    no_box();
    for (int k = 0, row = 0; k < problem.count; row += problem.levels[k++].m) {
      const Level level = simplest(problem.levels[k], row);
      if (k == 0 && !level.A && take_box(level)) first = 1;
      else if (!add(level)) return false;
    }
    measure();
    constraint_blocks = problem.constraints > first ? problem.constraints - first : 0;
    if (problem.constraints == 0 && first == 0 && blocks > 0 && !block[0].A) constraint_blocks = 1;
    has_metric = problem.metric != nullptr;
    return complete(problem);
  }

  // The size of x for tolerances: its largest entry, at least the rows' rounding.
  double span(const double* x) const { return larger(kRests * reach, largest(x)); }

  double largest(const double* x) const {
    double s = 0.0;
    for (int i = 0; i < n; ++i) s = larger(s, std::fabs(x[i]));
    return s;
  }

  // Blocks of the caller's levels; the blocks after them choose among the optima.
  int own_blocks() const { return blocks - 1 - has_metric; }

  bool bounded(int i) const { return lo[i] > -kInfinity || hi[i] < kInfinity; }

  // Excess of a value of row r above its upper or, negative, below its lower bound.
  double beyond(int r, double value) const {
    return value > upper[r] ? value - upper[r] : value < lower[r] ? value - lower[r] : 0.0;
  }

  double inside_box(int i, double t) const { return t < lo[i] ? lo[i] : t > hi[i] ? hi[i] : t; }

  // Slack norm of a level at values (rows,).
  double outside(int level, const double* values) const {
    double square = 0.0;
    for (int r = block[level].begin; r < block[level].end; ++r) {
      const double out = beyond(r, values[r]);
      square += out * out;
    }
    return std::sqrt(square);
  }

  double slackness(int r, double bound, double size) const { return tolerance * (std::fabs(bound) + norm[r] * size); }

  // Return true if row r is outside its bound by `over` at x. Its own terms decide: a long row that is short along a
  // long x, such as the acceleration of a light gripper by all torques, would else pass far outside.
  bool is_over(int r, double over, double bound, double size, const double* x) const {
    if (!(over > 0.0) || over > slackness(r, bound, size)) return over > 0.0;
    const double own = std::fabs(bound) + terms(r, x), rounding = kLastDigits * norm[r] * size;
    return over > tolerance * own + rounding;
  }

  const Block& block_of(int r) const {
    const Block* b = block;
    while (b->end <= r) ++b;
    return *b;
  }

  // Row r of A x.
  double value(int r, const double* x) const {
    const Block& b = block_of(r);
    const int i = r - b.begin;
    return b.A ? dot_any(b.A + static_cast<std::ptrdiff_t>(i) * n, x, n) : b.scale[i] * x[b.index[i]];
  }

  // Sum of the magnitudes of the terms of row r of A x.
  double terms(int r, const double* x) const {
    const Block& b = block_of(r);
    const int i = r - b.begin;
    return b.A ? absolute_dot(b.A + static_cast<std::ptrdiff_t>(i) * n, x, n) : std::fabs(b.scale[i] * x[b.index[i]]);
  }

  // v = A x over the rows of the table.
  void product(const double* x, double* v) const {
    for (int k = 0; k < blocks; ++k) {
      const Block& b = block[k];
      const int m = b.end - b.begin;
      if (b.A) dots_any(x, b.A, n, m, n, v + b.begin);
      else if (b.index == every && b.scale == ones)
        for (int i = 0; i < n; ++i) v[b.begin + i] = x[i];
      else
        for (int i = 0; i < m; ++i) v[b.begin + i] = b.scale[i] * x[b.index[i]];
    }
  }

  // x_i, moved by single roundings until scale * x_i keeps its bounds.
  static double inside(double bound, double scale, double lower, double upper) {
    double x = bound / scale;
    for (int turn = 0; turn < 8 && scale * x < lower; ++turn) x = std::nextafter(x, scale > 0 ? kInfinity : -kInfinity);
    for (int turn = 0; turn < 8 && scale * x > upper; ++turn) x = std::nextafter(x, scale > 0 ? -kInfinity : kInfinity);
    return x;
  }

 private:
  bool picks(std::int64_t index, double scale) const {
    return index >= 0 && index < n && scale != 0.0 && std::fabs(scale) < kInfinity;
  }

  // Row lengths known: determine the rounding of zero, and the reach of the rows; nearly zero rows have unlimited
  // reach.
  void measure() {
    double most = 0.0;
    for (int k = 0; k < blocks; ++k) most = larger(most, block[k].norm);
    for (int k = 0; k < blocks; ++k) {
      Block& b = block[k];
      b.rounding = kRounding * most;
      b.graded = false;
      const double usual = larger(kRests * b.norm, b.rounding);
      for (int r = b.begin; r < b.end; ++r) {
        b.graded = b.graded || (kind[r] != kFree && norm[r] < kGraded * b.norm && norm[r] > b.rounding);
        uneven = uneven || (kind[r] != kFree && norm[r] < kClearOf * b.norm && norm[r] > b.rounding);
        shortened = shortened || (kind[r] != kFree && kDirection * norm[r] < b.rounding && norm[r] > b.rounding);
        if (kind[r] == kFree || norm[r] <= usual) continue;
        const double nearest = smaller(std::fabs(lower[r]), std::fabs(upper[r]));
        if (nearest > reach * norm[r]) reach = nearest / norm[r];
      }
    }
  }

  bool add(const Level& level) {
    Block& b = block[blocks++];
    b.A = level.A;
    b.index = level.index;
    b.scale = level.scale;
    b.begin = rows;
    b.end = rows + level.m;
    b.norm = b.rounding = 0.0;
    b.unequal_begin = inequalities;
    b.equalities = true;
    for (int i = 0; i < level.m; ++i) {
      const int r = rows + i;
      const double l = level.lower[i], u = level.upper[i];
      if (!(l <= u) || l == kInfinity || u == -kInfinity) return false;
      lower[r] = l;
      upper[r] = u;
      const double* a = level.A ? level.A + static_cast<std::ptrdiff_t>(i) * n : nullptr;
      if (!a && !picks(level.index[i], level.scale[i])) return false;
      const double square = a ? dot_any(a, a, n) : level.scale[i] * level.scale[i];
      if (!(square < kInfinity)) return false;
      norm[r] = std::sqrt(square);
      const bool says_nothing = square == 0.0 || (l == -kInfinity && u == kInfinity);
      kind[r] = says_nothing ? kFree : l == u ? kEquality : kUpper;
      b.equalities = b.equalities && kind[r] == kEquality;
      if (kind[r] == kUpper) unequal[inequalities++] = r;
      if (kind[r] == kFree) continue;
      if (norm[r] > b.norm) b.norm = norm[r];
    }
    rows += level.m;
    b.unequal_end = inequalities;
    return true;
  }

  // The last levels: (x - origin)' metric (x - origin) as rows of a root of the metric, then the least norm.
  bool complete(const Problem& problem) {
    Level last;
    last.index = every;
    last.scale = ones;
    last.m = n;
    last.lower = last.upper = zeros;
    if (problem.metric) {
      Level level;
      level.A = metric_rows;
      level.m = metric_root(problem.metric, n, metric_rows, scratch);
      if (level.m < 0) return false;
      for (int i = 0; i < level.m; ++i)
        metric_rhs[i] =
            problem.origin ? dot_any(metric_rows + static_cast<std::ptrdiff_t>(i) * n, problem.origin, n) : 0.0;
      level.lower = level.upper = metric_rhs;
      if (!add(level)) return false;
    } else if (problem.origin) {
      last.lower = last.upper = problem.origin;
    }
    return add(last);
  }

  // Level 0 as bounds on variables, if every row picks one and the bounds agree.
  bool take_box(const Level& level) {
    for (int i = 0; i < level.m; ++i) {
      const double l = level.lower[i], u = level.upper[i], s = level.scale[i];
      if (!(l <= u) || l == kInfinity || u == -kInfinity || !picks(level.index[i], s)) {
        no_box();
        return false;
      }
      const int j = static_cast<int>(level.index[i]);
      double a = l, b = u;
      if (s != 1.0) {
        a = s > 0 ? (l > -kInfinity ? inside(l, s, l, u) : l) : (u < kInfinity ? inside(u, s, l, u) : -kInfinity);
        b = s > 0 ? (u < kInfinity ? inside(u, s, l, u) : u) : (l > -kInfinity ? inside(l, s, l, u) : kInfinity);
        if (a > b) a = b;
      }
      lo[j] = larger(lo[j], a);
      hi[j] = smaller(hi[j], b);
      boxed = boxed || a > -kInfinity || b < kInfinity;
    }
    bool agree = true;
    for (int i = 0; i < n; ++i) {
      agree = agree && lo[i] <= hi[i];
      fixed[i] = lo[i] == hi[i];
    }
    if (!agree) no_box();
    return agree;
  }

  void no_box() {
    boxed = false;
    for (int i = 0; i < n; ++i) {
      lo[i] = -kInfinity;
      hi[i] = kInfinity;
      fixed[i] = 0;
    }
  }

  // A dense level whose every row has one entry is a selection; rows start at `row` of the caller's rows.
  Level simplest(const Level& given, int row) {
    if (!given.A || given.m == 0) return given;
    int j = -1;
    for (int i = 0; i < given.m; ++i) {
      const double* a = given.A + static_cast<std::ptrdiff_t>(i) * n;
      if (entries(a) != 1) return given;
      j = j + 1 < n && a[j + 1] != 0.0 ? j + 1 : 0;  // most often the next one
      while (a[j] == 0.0) ++j;
      single_index[row + i] = j;
      single_scale[row + i] = a[j];
    }
    Level level = given;
    level.A = nullptr;
    level.index = single_index + row;
    level.scale = single_scale + row;
    return level;
  }

  // Number of entries that are nonzero or NaN.
  int entries(const double* a) const {
    const Vec4 zero = splat(0.0), one = splat(1.0);
    Vec4 count = zero;
    int j = 0;
    for (; j + kLane <= n; j += kLane) count += unaligned(a + j) != zero ? one : zero;
    double total = sum(count);
    for (; j < n; ++j) total += a[j] != 0.0;
    return static_cast<int>(total);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
