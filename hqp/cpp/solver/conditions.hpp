// The conditions of optimality at a point, level by level, in orthogonal coordinates: the conditions of
// hqp/problem/certify.py.
#pragma once

#include <algorithm>

#include "nonnegative.hpp"
#include "null_directions.hpp"
#include "null_space.hpp"
#include "row_factor.hpp"
#include "row_sorted_least_squares.hpp"
#include "table.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

// At level k the gradient A_k' w_k, in the null space of the rows fixed so far, must be a combination of the
// active rows of the levels above with multipliers of the right sign. Rows are numbered: the box first, by variable,
// then the table's. All rows count with unit length.
struct Conditions {
  enum State : std::int8_t {
    kAhead = 0,
    kFixed = 1,
    kOpen = 2
  };  // not reached or without a direction, fixed, an inequality

  const Table* table = nullptr;
  int n = 0, all = 0;            // variables; they and the table's rows
  double* x = nullptr;           // (n,) the point
  double* v = nullptr;           // (all,) values of the rows at x
  double* terms = nullptr;       // (all,) sums of the magnitudes of their terms
  double* w = nullptr;           // (rows of a level,) slacks of the present level
  std::int8_t* state = nullptr;  // (all,)
  std::int8_t* side = nullptr;   // (all,) at which an open row is active, 0 if it is not
  std::int8_t* held = nullptr;   // (all,) at which a row held a level back, 0 if at none
  int* open = nullptr;           // (open_count,) rows that are open, or were
  int* id = nullptr;             // (active,) active rows of the present level, the columns
  int open_count = 0, active = 0;
  NullSpace null_space;             // null space of the rows fixed so far
  NonnegativeLeastSquares columns;  // the multipliers of the present level
  RowSortedLeastSquares reduced;    // the present level on a face
  int* order = nullptr;             // (rows of a level,) its rows, the longest first
  NullDirections unseen;            // once they are known rows are judged without them
  Deadline deadline;                // after it nothing that is found is usable
  double activity = kViolated;      // tolerance of activity, relative to a row's terms
  double threshold = kDirection;    // a direction counts above this
  double shortest = 1.0;            // shortest significant direction: its inverse magnifies rounding
  double closest = kInfinity;       // nearest a direction came to kDirection, as a ratio >= 1
  double faintest = kInfinity;      // least force that counts as holding a level back, relative
  double strongest = 0.0;           // largest sum of a level's multipliers, of rows of unit length: magnifies it, too

  void layout(Arena& arena, int n_, int rows, int most, int blocks) {
    unseen.layout(arena, n_, rows, blocks);
    n = n_;
    all = n + rows;
    ld_ = padded(n);
    null_space.layout(arena, n);
    columns.layout(arena, n, all);
    factor_.layout(arena, n, all);
    reduced.layout(arena, n, most);
    arena.place(order, most);
    arena.place(x, n);
    arena.place(v, all);
    arena.place(terms, all);
    arena.place(state, all);
    arena.place(side, all);
    arena.place(held, all);
    arena.place(applied_, all);
    arena.place(rows_, static_cast<std::size_t>(all) * ld_);
    arena.place(open, all);
    arena.place(list_, all);
    arena.place(id, all);
    arena.place(w, most);
    arena.place(g_, n);
    arena.place(y_, n);
    arena.place(t_, n);
    arena.place(actives_, all);
    arena.place(own_, most);
    arena.place(counts_, most);
  }

  void wire(const Table* of) {
    table = of;
    columns.deadline = &deadline;
  }

  // Nothing but the box is fixed at x. tolerance: tolerance of activity, relative to a row's terms.
  void begin(double tolerance) {
    activity = tolerance;
    null_space.rank = 0;
    open_count = 0;
    shortest = 1.0;
    faintest = kInfinity;
    strongest = 0.0;
    for (int q = 0; q < all; ++q) {
      state[q] = kAhead;
      side[q] = held[q] = 0;
      applied_[q] = -1;
    }
    measure();
    take_box();
  }

  // Largest gap of an optimum: rounding of the rows turns the null space by as much as it is of the shortest direction,
  // and counts as often as the multipliers have it.
  double allowed() const { return kViolated + smaller(kTurned, kRounding * (1.0 / shortest + forces_)); }

  // Return true if directions or multipliers may let the data's last digits move the point that was judged.
  bool magnifies() const { return shortest < kUncertain || strongest * kUncertain > 1.0; }

  // Return the relative remainder of the level's gradient after subtracting the best multipliers of the active rows.
  double gap_of(int k) {
    const Block& b = table->block[k];
    active = columns.count = own_count_ = 0;
    forces_ = 0.0;
    if (b.norm <= b.rounding || gradient(k) == 0.0) return 0.0;
    if (b.graded) {
      find_own_active(k);
      if (!graded_gradient(k)) return 0.0;
    } else {
      for (int i = 0; i < n; ++i) y_[i] = -g_[i] / scale_;
      null_space.project(y_);
    }
    for (int a = 0; a < candidates(); ++a)
      if (is_active(candidate(a))) add_column(candidate(a));
    columns.count = active;
    const double force = columns.solve(y_ + null_space.rank, null_space.freedom());
    for (int a = 0; a < active; ++a) {
      forces_ += columns.mu[a];
      if (const double length = null_space.length(row(id[a])); columns.mu[a] * length > kViolated) note(length);
    }
    strongest = larger(strongest, forces_);
    return b.graded ? force : larger(force, fall(k));
  }

  // Below level k: rows that held it back are fixed, and its own are taken in.
  void descend(int k, double lock, double own) {
    const Table& t = *table;
    const Block& b = t.block[k];
    listed_ = 0;
    const double least =
        larger(lock, kEither * kEither *
                         own);  // lock of a force in the null space; a force within the gap's effect is not significant
    for (int a = 0; a < active; ++a) {
      const int q = id[a];
      const double force = columns.mu[a] * null_space.length(projected(q));
      if (!(force > least)) continue;
      faintest = smaller(faintest, force);
      state[q] = kFixed;
      held[q] = side[q];
      list_[listed_++] = q;
    }
    for (int r = b.begin; r < b.end; ++r)
      if (is_row(b, r) && state[n + r] != kFixed) take(n + r, t.kind[r] == kEquality);
    fix();
  }

  // The least motion, of 1 + |x|, that brings the rows beyond their bounds back and keeps fixed rows, after a verdict.
  // Each row is met to its error: rounding of its value and its bound, which grows along nearly dependent rows.
  // free (count, n): directions that no level sees, which cost little.
  double to_bounds(const double* free, int count) {
    null_space.rank = 0;
    double *part = g_, *errors = y_;
    const auto error = [&](int q) { return 2.0 * kOnRow * (norm(q) + terms[q]); };
    const auto bring = [&](int q, double off) {
      if (!null_space.freedom()) return;
      unit_row(q, t_);
      for (int k = 0; k < count; ++k) {
        const double* z = free + static_cast<std::ptrdiff_t>(k) * n;
        add_any(t_, z, (1.0 / kRests - 1.0) * dot_any(z, t_, n), n);
      }
      const int rank = null_space.rank;
      const double whole = std::sqrt(dot_any(t_, t_, n));
      null_space.project(t_);
      const double length = null_space.length(t_);
      if (!(length > larger(kOnRow, kRounding * whole))) return;
      double most = error(q) / norm(q);
      for (int j = 0; j < rank; ++j) most += std::fabs(t_[j]) * errors[j];
      errors[rank] = most / length;
      const double by = off + dot_any(t_, part, rank), beyond = larger(std::fabs(by) - most, 0.0) / length;
      part[rank] = (by >= 0.0) == (t_[rank] >= 0.0) ? beyond : -beyond;
      null_space.add(t_, length);
    };
    for (const bool off : {true, false})
      for (int q = 0; q < all; ++q) {
        if (state[q] == kAhead || (!off && !null_space.rank)) continue;
        const double out = upper(q) == lower(q) || !side[q] ? 0.0
                           : side[q] > 0                    ? larger(v[q] - upper(q), 0.0)
                                                            : smaller(v[q] - lower(q), 0.0);
        const bool missing = std::fabs(out) > error(q);
        if (missing == off && (missing || state[q] == kFixed)) bring(q, off ? out / norm(q) : 0.0);
      }
    std::copy(part, part + null_space.rank, y_);
    std::fill(y_ + null_space.rank, y_ + n, 0.0);
    null_space.lift(y_);
    return seen(free, count);
  }

  // The motion, of 1 + |x|, from a point to x, without free directions (count, n).
  double motion_from(const double* point, const double* free, int count) {
    for (int i = 0; i < n; ++i) y_[i] = x[i] - point[i];
    return seen(free, count);
  }

  // w_k and A_k' w_k at x; the length of w_k.
  double gradient(int k) {
    const Table& t = *table;
    const Block& b = t.block[k];
    double square = 0.0, most = 0.0, sum = 0.0;
    for (int i = 0; i < n; ++i) g_[i] = 0.0;
    for (int r = b.begin; r < b.end; ++r) {
      const int i = r - b.begin;
      double& miss = w[i] = t.kind[r] == kFree ? 0.0 : t.beyond(r, v[n + r]);
      if (std::fabs(miss) <= kRounding * terms[n + r]) miss = 0.0;  // rounding of its terms
      counts_[i] = t.kind[r] == kEquality || miss != 0.0;
      sum = larger(sum, terms[n + r]);
      if (miss == 0.0) continue;
      square += miss * miss;
      most = larger(most, std::fabs(miss));
      if (b.A) add_any(g_, b.A + static_cast<std::ptrdiff_t>(i) * n, miss, n);
      else g_[b.index[i]] += miss * b.scale[i];
    }
    unseen.clean(k, g_);
    scale_ = b.norm * (b.norm + most + sum);
    return std::sqrt(square);
  }

  // Find the active rows among the open rows at x.
  void find_active() {
    for (int a = 0; a < open_count; ++a) {
      const int q = open[a];
      if (state[q] != kOpen) continue;
      const double tolerance = slop(q);
      side[q] = v[q] >= upper(q) - tolerance ? kUpper : v[q] <= lower(q) + tolerance ? kLower : kFree;
    }
  }

  // Value and size of the terms of every row.
  void measure() {
    for (int i = 0; i < n; ++i) {
      v[i] = x[i];
      terms[i] = std::fabs(x[i]);
    }
    const Table& t = *table;
    t.product(x, v + n);
    for (int k = 0; k < t.blocks; ++k) {
      const Block& b = t.block[k];
      for (int r = b.begin; r < b.end; ++r) {
        const int i = r - b.begin;
        terms[n + r] = b.A ? absolute_dot(b.A + static_cast<std::ptrdiff_t>(i) * n, x, n) : std::fabs(v[n + r]);
      }
    }
  }

  // The rows of level k that count, as least squares in the null space of fixed and kept rows; on
  // request, with their coefficients along the kept rows as further columns. Returns how many they are. The kept rows
  // stay in `null_space` until its rank is set back.
  int set_face(int k, const int* kept, int count, bool with_kept = false) {
    const Table& t = *table;
    const Block& b = t.block[k];
    const int base = null_space.rank;
    int m = 0;
    for (int r = b.begin; r < b.end; ++r) {
      if (!is_row(b, r) || is_active(n + r) || !counts_[r - b.begin]) continue;
      projected(n + r);
      order[m++] = r;
    }
    for (int i = 0; i < count; ++i) projected(kept[i]);
    for (int i = 0; i < count && null_space.freedom(); ++i) {
      const double length = turned(kept[i], base);
      if (length > kDirection) null_space.add(t_, length);
    }
    sort_by_length(m);
    const int f = null_space.freedom();
    for (int i = 0; i < m; ++i) {
      const int r = order[i];
      turned(n + r, base);
      reduced.set(i, t_ + null_space.rank, f, t.norm[r], -w[r - b.begin], t_ + base,
                  with_kept ? null_space.rank - base : 0);
    }
    return m;
  }

  // Slack of row r of level k plus the magnitudes of its terms.
  double extent(int k, int r) const { return std::fabs(w[r - table->block[k].begin]) + terms[n + r]; }

  // Rows that may hold the present level back: open rows, formerly open rows, and its own at a bound if it is graded.
  int candidates() const { return open_count + own_count_; }
  int candidate(int a) const { return a < open_count ? open[a] : own_[a - open_count]; }

  // Row q of unit length as Q' a, brought up to date.
  const double* projected(int q) {
    double* y = rows_ + static_cast<std::ptrdiff_t>(q) * ld_;
    if (applied_[q] < 0) {
      unit_row(q, y);
      null_space.project_tail(y);
    } else {
      null_space.project(y, applied_[q]);
    }
    applied_[q] = null_space.rank;
    return y;
  }

  // Row q as `projected` left it.
  const double* row(int q) const { return rows_ + static_cast<std::ptrdiff_t>(q) * ld_; }

  double lower(int q) const { return q < n ? table->lo[q] : table->lower[q - n]; }
  double upper(int q) const { return q < n ? table->hi[q] : table->upper[q - n]; }
  double norm(int q) const { return q < n ? 1.0 : table->norm[q - n]; }
  double slop(int q) const { return activity * (norm(q) + terms[q]); }

 private:
  // The length of y_, of 1 + |x|, without free directions (count, n).
  double seen(const double* free, int count) {
    for (int k = 0; k < count; ++k) {
      const double* z = free + static_cast<std::ptrdiff_t>(k) * n;
      add_any(y_, z, -dot_any(z, y_, n), n);
    }
    return std::sqrt(dot_any(y_, y_, n) / (1.0 + dot_any(x, x, n)));
  }

  static constexpr double kClearDirection = 1e-7;  // share of a row: a longer direction is one to every solver
  RowFactor factor_;
  int ld_ = 0, listed_ = 0, own_count_ = 0;
  double *rows_ = nullptr, *g_ = nullptr, *y_ = nullptr, *t_ = nullptr;
  double scale_ = 0.0, forces_ = 0.0;  // size of the present gradient; sum of its multipliers
  int *applied_ = nullptr, *list_ = nullptr, *actives_ = nullptr, *own_ = nullptr;
  std::int8_t* counts_ = nullptr;  // (rows of a level,) equalities and rows that miss

  // A level's own inequalities at a bound, where that is nearer than a step that counts: their slack is arbitrary
  // within the step, so they have a multiplier like the open rows above.
  void find_own_active(int k) {
    const Table& t = *table;
    const Block& b = t.block[k];
    const double size = larger(1.0, t.largest(x));
    for (int r = b.begin; r < b.end; ++r) {
      const int q = n + r;
      side[q] = kFree;
      state[q] = kAhead;
      if (t.kind[r] != kUpper || !is_row(b, r)) continue;
      const double to_upper = std::fabs(v[q] - t.upper[r]), to_lower = std::fabs(v[q] - t.lower[r]);
      if (smaller(to_upper, to_lower) <= kNoRate * size * t.norm[r]) side[q] = to_upper <= to_lower ? kUpper : kLower;
      if (!side[q]) continue;
      state[q] = kOpen;
      own_[own_count_++] = q;
    }
  }

  // Return true if a row of a level has a direction: it is not left out, nor zero but for rounding.
  bool is_row(const Block& b, int r) const {
    return table->kind[r] != kFree && table->norm[r] > larger(kOnRow * b.norm, b.rounding);
  }

  bool is_active(int q) const { return state[q] == kOpen && side[q]; }

  void add_column(int q) {
    const double* y = projected(q);
    if (!(null_space.length(y) > kDirection)) return;
    columns.column[active] = y + null_space.rank;
    columns.sign[active] = side[q];
    id[active++] = q;
  }

  // y_ of a level whose rows differ in length; false where it is zero. Rounding of a long row's slack would hide the
  // forces of the short ones: it is taken apart by least squares on the face of the active rows, and left out.
  bool graded_gradient(int k) {
    const int base = null_space.rank;
    int count = 0;
    for (int a = 0; a < candidates(); ++a)
      if (is_active(candidate(a))) actives_[count++] = candidate(a);
    const int m = set_face(k, actives_, count, true), f = null_space.freedom(), more = null_space.rank - base;
    reduced.solve(m, f, larger(kSeen, kNoStep / shortest), more);
    scale_ = reduced.gradient(m, f, more, larger(1.0, table->largest(x)), kRounding, kNoRate, kRounding / kViolated,
                              y_ + null_space.rank, y_ + base);
    null_space.lift(y_, base);
    null_space.rank = base;
    if (scale_ == 0.0) return false;
    for (int i = base; i < n; ++i) y_[i] /= scale_;
    return true;
  }

  // Return the possible decrease of level k along clear directions with the active rows kept, relative to its terms,
  // beyond the tolerance of a row of its length: a gradient along short rows means little. Rows that the step leaves
  // count as well.
  double fall(int k) {
    const Table& t = *table;
    const Block& b = t.block[k];
    const double rounding = (kViolated + smaller(kTurned, kRounding / shortest)) * b.norm * t.largest(x);
    int count = 0;
    for (int a = 0; a < candidates(); ++a)
      if (is_active(candidate(a))) actives_[count++] = candidate(a);
    for (listed_ = 0;;) {
      const int base = null_space.rank, m = set_face(k, actives_, count), f = null_space.freedom();
      const double lost = kRounding / shortest;
      const double reach = f ? reduced.solve(m, f, lost, 0, b.norm * larger(kClearDirection, lost)) : 0.0;
      const bool more = reach > rounding && count_left(b, f);
      null_space.rank = base;
      if (more) continue;
      double most = 0.0;
      for (int i = 0; i < m; ++i) most = larger(most, extent(k, order[i]));
      for (; listed_; --listed_) counts_[list_[listed_ - 1]] = 0, w[list_[listed_ - 1]] = 0.0;
      return reach > rounding ? (reach - rounding) / most : 0.0;
    }
  }

  // Count the rows of a level that the step of `reduced` leaves, with their distance to the bound as slack; return true
  // if there are any.
  bool count_left(const Block& b, int freedom) {
    const Table& t = *table;
    const int before = listed_;
    for (int i = 0; i < n; ++i) t_[i] = i < n - freedom ? 0.0 : reduced.z[i - n + freedom];
    null_space.lift(t_);
    for (int r = b.begin; r < b.end; ++r) {
      const int i = r - b.begin;
      if (counts_[i] || !is_row(b, r)) continue;
      const double change =
          b.A ? dot_any(b.A + static_cast<std::ptrdiff_t>(i) * n, t_, n) : b.scale[i] * t_[b.index[i]];
      const double out = t.beyond(r, v[n + r] + change);
      if (out == 0.0) continue;
      w[i] = v[n + r] - (out > 0.0 ? t.upper[r] : t.lower[r]);
      counts_[i] = 1;
      list_[listed_++] = i;
    }
    return listed_ > before;
  }

  // Row q as `projected` left it, in t_, with the reflections from `base` on; returns the length of their remainder.
  double turned(int q, int base) {
    const double* from = row(q);
    for (int j = 0; j < n; ++j) t_[j] = from[j];
    null_space.project(t_, base);
    return null_space.length(t_);
  }

  void sort_by_length(int m) {  // insertion: most levels have rows of similar length in order
    for (int i = 1; i < m; ++i) {
      const int r = order[i];
      int j = i;
      for (; j > 0 && table->norm[order[j - 1]] < table->norm[r]; --j) order[j] = order[j - 1];
      order[j] = r;
    }
  }

  void unit_row(int q, double* y) const {
    if (q >= n) {
      const Block& b = table->block_of(q - n);
      const int i = q - n - b.begin;
      if (b.A) {
        const double* a = b.A + static_cast<std::ptrdiff_t>(i) * n;
        const double f = 1.0 / norm(q);
        for (int j = 0; j < n; ++j) y[j] = f * a[j];
        return unseen.clean_row(static_cast<int>(&b - table->block), y);
      }
      for (int j = 0; j < n; ++j) y[j] = 0.0;
      y[b.index[i]] = b.scale[i] > 0.0 ? 1.0 : -1.0;
      return;
    }
    for (int j = 0; j < n; ++j) y[j] = 0.0;
    y[q] = 1.0;
  }

  void take_box() {
    listed_ = 0;
    if (table->boxed)
      for (int i = 0; i < n; ++i)
        if (table->bounded(i)) take(i, table->fixed[i]);
    fix();
  }

  // Take in a row of a level that was just judged.
  void take(int q, bool equality) {
    const double tolerance = slop(q), u = upper(q), l = lower(q);
    const bool at_upper = v[q] >= u - tolerance, at_lower = v[q] <= l + tolerance;
    const bool beyond = v[q] > u + tolerance || v[q] < l - tolerance;
    if (equality || beyond || (at_upper && at_lower)) {
      state[q] = kFixed;
      held[q] = v[q] > u ? kUpper : v[q] < l ? kLower : kFree;
      list_[listed_++] = q;
    } else {
      state[q] = kOpen;
      side[q] = at_upper ? kUpper : at_lower ? kLower : kFree;
      open[open_count++] = q;
    }
  }

  // Shrink the null space by the rows in `list_`. If one is nearly dependent, singular values decide.
  void fix() {
    const int base = null_space.rank, rows = listed_;
    listed_ = 0;
    if (!rows) return;
    factor_.start(rows, null_space.freedom());
    const double left = factorise(rows, null_space.freedom());
    const int rank = factor_.rank;
    const bool grey = rank && factor_.length(rank - 1) < kUncertain;
    if (grey) factor_.find_singular_values(deadline);
    else if (left > 0.0) decide(left);
    int kept = 0;
    for (int j = 0; j < rank; ++j)
      if (decide(grey ? factor_.singular_value(j) : factor_.length(j))) ++kept;
      else factor_.drop(j, null_space, base);
    if (kept == rank) return;
    null_space.rank = base;
    factorise(rows, kept);
  }

  double factorise(int rows, int most) {
    const int base = null_space.rank;
    factor_.renew(rows);
    for (int a = 0; a < rows; ++a) factor_.set(a, projected(list_[a]) + base);
    return factor_.reduce(null_space, most);
  }

  void note(double length) {
    closest = smaller(closest, length > kDirection ? length / kDirection : kDirection / larger(length, kTiny));
  }

  // Return true if a length is that of a direction, which is fixed then.
  bool decide(double length) {
    note(length);
    if (length > threshold) shortest = smaller(shortest, length);
    return length > threshold;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
