// Optimality level by level, in orthogonal coordinates, independent of the tableau: the conditions of hqp/certify.py.
#pragma once

#include <initializer_list>

#include "nonnegative.hpp"
#include "null_directions.hpp"
#include "null_space.hpp"
#include "row_factor.hpp"
#include "table.hpp"

namespace hqp {
inline namespace HQP_ISA {

// Verdict on a point. At level k the gradient A_k' w_k, in the null space of the rows fixed so far, must be a
// combination of the active rows of the levels above with multipliers of the right sign. Rows are numbered: the box
// first, by variable, then the table's. All rows count with unit length.
class Judge {
 public:
  static constexpr double kRank = 1e-10;   // a row of unit length adds a fixed direction above this
  static constexpr double kWell = 1e-5;    // a verdict with shorter directions than this is ill-conditioned
  static constexpr double kEither = 10.0;  // a direction this near kRank, as a ratio, may count or not
  static constexpr double kClear = 1e-6;   // one that leaves less than this is nearly dependent
  static constexpr double kSlop = 1e-8;    // activity, relative to the row's terms, and largest gap of an optimum
  static constexpr double kData = 4e-15;   // rounding of rows of unit length
  static constexpr double kTurned = 5e-7;  // what it may make of a gap at most
  static constexpr double kLock = 1e-5;    // a row counts as fixed for the levels below above this relative multiplier,
  static constexpr double kLeastLock = 1e-13;  // or above this one: either reading may be the right one

  double* x = nullptr;         // (n,) the point
  double gap = 0.0;            // the largest so far
  double closest = kInfinity;  // nearest a direction came to kRank in the last verdict, as a ratio >= 1
  Deadline deadline;           // ends a verdict unsaid: the point does not pass

  NullDirections unseen;  // once they are known rows are judged without them

  void layout(Arena& arena, int n, int rows, int most, int blocks) {
    unseen.layout(arena, n, rows, blocks);
    n_ = n;
    all_ = n + rows;
    ld_ = padded(n);
    null_.layout(arena, n);
    columns_.layout(arena, n, all_);
    factor_.layout(arena, n, all_);
    arena.place(x, n);
    arena.place(v_, all_);
    arena.place(terms_, all_);
    arena.place(state_, all_);
    arena.place(side_, all_);
    arena.place(held_, all_);
    arena.place(applied_, all_);
    arena.place(row_, static_cast<std::size_t>(all_) * ld_);
    arena.place(open_, all_);
    arena.place(list_, all_);
    arena.place(id_, all_);
    arena.place(w_, most);
    arena.place(g_, n);
    arena.place(y_, n);
  }

  void start(const Table* table) {
    table_ = table;
    columns_.deadline = &deadline;
  }

  // Whether the point is optimal under either reading of small multipliers, and of directions near kRank.
  bool judge(const double* at) {
    for (int i = 0; i < n_; ++i) x[i] = at[i];
    closest = kInfinity;
    if (table_->shortened) unseen.find(*table_);
    bool passed = false;
    for (const double reading : {1.0, 1.0 / kEither, kEither}) {
      rank_ = reading * kRank;
      passed = pass_twice(kLeastLock) || (!deadline.passed() && pass_twice(kLock));
      if (passed || closest > kEither) break;
    }
    rank_ = kRank;
    return passed;
  }

  // The side at which a row held a level back, 0 if at none.
  std::int8_t held(int q) const { return held_[q]; }

 protected:
  enum State : std::int8_t {
    kAhead = 0,
    kFixed = 1,
    kOpen = 2
  };  // not reached or without a direction, fixed, an inequality
  const Table* table_ = nullptr;
  NullSpace null_;
  NonnegativeLeastSquares columns_;
  RowFactor factor_;
  int n_ = 0, all_ = 0, ld_ = 0, open_count_ = 0, active_ = 0, listed_ = 0;
  double *v_ = nullptr, *terms_ = nullptr, *row_ = nullptr, *w_ = nullptr, *g_ = nullptr, *y_ = nullptr;
  std::int8_t *state_ = nullptr, *side_ = nullptr, *held_ = nullptr;
  int *applied_ = nullptr, *open_ = nullptr, *list_ = nullptr, *id_ = nullptr;
  double scale_ = 0.0, slop_ = kSlop, rank_ = kRank;
  bool twisted_ = false;   // the verdict is made in coordinates turned by a reflection
  double shortest_ = 1.0;  // of what rows added to the null space's complement: its inverse magnifies rounding

  void begin() {
    null_.rank = 0;
    open_count_ = 0;
    gap = 0.0;
    shortest_ = 1.0;
    for (int q = 0; q < all_; ++q) {
      state_[q] = kAhead;
      side_[q] = held_[q] = 0;
      applied_[q] = -1;
    }
    measure();
    take_box();
  }

  // Largest gap of an optimum: rounding of the rows turns the null space by as much as it is of the shortest direction,
  // and counts as often as the multipliers have it.
  double allowed() const {
    double forces = 0.0;
    for (int a = 0; a < active_; ++a) forces += columns_.mu[a];
    return kSlop + smaller(kTurned, kData * (1.0 / shortest_ + forces));
  }

  // Where ill-conditioned the same verdict again, in coordinates in which rounding falls otherwise.
  bool pass_twice(double lock) {
    if (!pass(lock)) return false;
    if (shortest_ > kWell) return true;
    unseen.find(*table_);
    twisted_ = true;
    const bool again = pass(lock);
    twisted_ = false;
    return again;
  }

  bool pass(double lock) {
    slop_ = kSlop;
    begin();
    for (int k = 0; k < table_->blocks && null_.freedom(); ++k) {
      const double own = gap_of(k);
      gap = larger(gap, own);
      if (!(own <= allowed())) return false;
      descend(k, lock, own);
    }
    return !deadline.passed();
  }

  double lower(int q) const { return q < n_ ? table_->lo[q] : table_->lower[q - n_]; }
  double upper(int q) const { return q < n_ ? table_->hi[q] : table_->upper[q - n_]; }
  double norm(int q) const { return q < n_ ? 1.0 : table_->norm[q - n_]; }
  double slop(int q) const { return slop_ * (norm(q) + terms_[q]); }

  // Value and size of the terms of every row.
  void measure() {
    for (int i = 0; i < n_; ++i) {
      v_[i] = x[i];
      terms_[i] = std::fabs(x[i]);
    }
    const Table& t = *table_;
    t.product(x, v_ + n_);
    for (int k = 0; k < t.blocks; ++k) {
      const Block& b = t.block[k];
      for (int r = b.begin; r < b.end; ++r) {
        const int i = r - b.begin;
        terms_[n_ + r] = b.A ? absolute_dot(b.A + static_cast<std::ptrdiff_t>(i) * n_, x, n_) : std::fabs(v_[n_ + r]);
      }
    }
  }

  // Row q of unit length as Q' a, brought up to date.
  const double* projected(int q) {
    double* y = row_ + static_cast<std::ptrdiff_t>(q) * ld_;
    if (applied_[q] < 0) {
      unit_row(q, y);
      twist(y);
      null_.project_tail(y);
    } else {
      null_.project(y, applied_[q]);
    }
    applied_[q] = null_.rank;
    return y;
  }

  // Reflect along (1, ..., 1).
  void twist(double* y) const {
    if (!twisted_) return;
    double sum = 0.0;
    for (int i = 0; i < n_; ++i) sum += (1.0 + 0.3 * (i % 3)) * y[i];
    double square = 0.0;
    for (int i = 0; i < n_; ++i) square += (1.0 + 0.3 * (i % 3)) * (1.0 + 0.3 * (i % 3));
    for (int i = 0; i < n_; ++i) y[i] -= 2.0 * sum / square * (1.0 + 0.3 * (i % 3));
  }

  void unit_row(int q, double* y) const {
    if (q >= n_) {
      const Block& b = table_->block_of(q - n_);
      const int i = q - n_ - b.begin;
      if (b.A) {
        const double* a = b.A + static_cast<std::ptrdiff_t>(i) * n_;
        const double f = 1.0 / norm(q);
        for (int j = 0; j < n_; ++j) y[j] = f * a[j];
        return unseen.clean_row(static_cast<int>(&b - table_->block), y);
      }
      for (int j = 0; j < n_; ++j) y[j] = 0.0;
      y[b.index[i]] = b.scale[i] > 0.0 ? 1.0 : -1.0;
      return;
    }
    for (int j = 0; j < n_; ++j) y[j] = 0.0;
    y[q] = 1.0;
  }

  void take_box() {
    listed_ = 0;
    if (table_->boxed)
      for (int i = 0; i < n_; ++i)
        if (table_->bounded(i)) take(i, table_->fixed[i]);
    fix();
  }

  // Take in a row of a level that was just judged.
  void take(int q, bool equality) {
    const double tolerance = slop(q), u = upper(q), l = lower(q);
    const bool at_upper = v_[q] >= u - tolerance, at_lower = v_[q] <= l + tolerance;
    const bool beyond = v_[q] > u + tolerance || v_[q] < l - tolerance;
    if (equality || beyond || (at_upper && at_lower)) {
      state_[q] = kFixed;
      held_[q] = v_[q] > u ? kUpper : v_[q] < l ? kLower : kFree;
      list_[listed_++] = q;
    } else {
      state_[q] = kOpen;
      side_[q] = at_upper ? kUpper : at_lower ? kLower : kFree;
      open_[open_count_++] = q;
    }
  }

  // Which open rows are active at x.
  void find_active() {
    for (int a = 0; a < open_count_; ++a) {
      const int q = open_[a];
      if (state_[q] != kOpen) continue;
      const double tolerance = slop(q);
      side_[q] = v_[q] >= upper(q) - tolerance ? kUpper : v_[q] <= lower(q) + tolerance ? kLower : kFree;
    }
  }

  // Shrink the null space by the rows in `list_`. Where one is nearly dependent their singular values decide.
  void fix() {
    const int base = null_.rank, rows = listed_;
    listed_ = 0;
    if (!rows) return;
    factor_.start(rows, null_.freedom());
    const double left = factorise(rows, null_.freedom());
    const int rank = factor_.rank;
    const bool grey = rank && factor_.length(rank - 1) < kClear;
    if (grey) factor_.find_small(kClear, deadline);
    else if (left > 0.0) decide(left);
    const int clear = grey ? factor_.first : rank;
    int kept = clear;
    for (int j = 0; j < clear; ++j) decide(factor_.length(j));
    for (int j = clear; j < rank; ++j)
      if (decide(factor_.singular_value(j))) ++kept;
      else factor_.drop(j, null_, base);
    if (kept == rank) return;
    null_.rank = base;
    factorise(rows, kept);
  }

  double factorise(int rows, int most) {
    const int base = null_.rank;
    factor_.renew(rows);
    for (int a = 0; a < rows; ++a) factor_.set(a, projected(list_[a]) + base);
    return factor_.reduce(null_, most);
  }

  // Whether a length is one of a direction, which is fixed then.
  bool decide(double length) {
    closest = smaller(closest, length > kRank ? length / kRank : kRank / larger(length, 1e-300));
    if (length > rank_) shortest_ = smaller(shortest_, length);
    return length > rank_;
  }

  // w_k and A_k' w_k at x; the length of w_k.
  double gradient(int k) {
    const Table& t = *table_;
    const Block& b = t.block[k];
    double square = 0.0, most = 0.0, terms = 0.0;
    for (int i = 0; i < n_; ++i) g_[i] = 0.0;
    for (int r = b.begin; r < b.end; ++r) {
      const int i = r - b.begin;
      double& w = w_[i] = t.kind[r] == kFree ? 0.0 : t.beyond(r, v_[n_ + r]);
      if (std::fabs(w) <= kData * terms_[n_ + r]) w = 0.0;  // rounding of its terms
      terms = larger(terms, terms_[n_ + r]);
      if (w == 0.0) continue;
      square += w * w;
      most = larger(most, std::fabs(w));
      if (b.A) add_any(g_, b.A + static_cast<std::ptrdiff_t>(i) * n_, w, n_);
      else g_[b.index[i]] += w * b.scale[i];
    }
    unseen.clean(k, g_);
    scale_ = b.norm * (b.norm + most + terms);
    return std::sqrt(square);
  }

  // What is left of the level's gradient once the best multipliers of the active rows are taken away, relative.
  double gap_of(int k) {
    const Block& b = table_->block[k];
    active_ = columns_.count = 0;
    if (b.norm <= b.rounding || gradient(k) == 0.0) return 0.0;
    for (int i = 0; i < n_; ++i) y_[i] = -g_[i] / scale_;
    twist(y_);
    null_.project(y_);
    for (int a = 0; a < open_count_; ++a) {
      const int q = open_[a];
      if (state_[q] != kOpen || !side_[q]) continue;
      const double* y = projected(q);
      if (!(null_.length(y) > kRank)) continue;
      columns_.column[active_] = y + null_.rank;
      columns_.sign[active_] = side_[q];
      id_[active_++] = q;
    }
    columns_.count = active_;
    return columns_.solve(y_ + null_.rank, null_.freedom());
  }

  // Below level k: rows that held it back are fixed, and its own are taken in.
  void descend(int k, double lock, double own) {
    const Table& t = *table_;
    const Block& b = t.block[k];
    listed_ = 0;
    const double least =
        larger(lock, 100.0 * own);  // of a force in the null space; what the gap could have made says nothing
    for (int a = 0; a < active_; ++a) {
      const int q = id_[a];
      if (!(columns_.mu[a] * null_.length(projected(q)) > least)) continue;
      state_[q] = kFixed;
      held_[q] = side_[q];
      list_[listed_++] = q;
    }
    const double floor = larger(1e-13 * b.norm, b.rounding);
    for (int r = b.begin; r < b.end; ++r)
      if (t.kind[r] != kFree && t.norm[r] > floor) take(n_ + r, t.kind[r] == kEquality);
    fix();
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
