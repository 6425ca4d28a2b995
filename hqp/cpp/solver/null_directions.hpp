// Directions that no level below the constraints sees, but for rounding: rounding along these directions decides
// nothing.
#pragma once

#include "null_space.hpp"
#include "table.hpp"

namespace hqp {
inline namespace HQP_ISA {

// Internal forces move nothing: every row of a task is orthogonal to them, but for rounding of the problem's longest
// row. In a row of length 1e-9, or in the remainder of nearly dependent rows, that tilts the null space of the rows by
// 1e-7, and levels below would buy a motion of 1e-4 with 1000 N m of it (hqp/problem/null_directions.py).
class NullDirections {
 public:
  void layout(Arena& arena, int n, int rows, int blocks) {
    n_ = n;
    ld_ = padded(n);
    space_.layout(arena, n);
    arena.place(row_, static_cast<std::size_t>(rows) * ld_);
    arena.place(Z_, static_cast<std::size_t>(n) * ld_);
    arena.place(unseeing_, blocks);
  }

  // Another problem, or the same with other numbers: nothing is known of it.
  void forget() { known_ = false, count_ = 0; }

  // The basis Z, by Householder with pivoting of all rows below the constraints, and which blocks do not see it.
  void find(const Table& t) {
    if (known_) return;
    known_ = true;
    const int last = t.blocks - 1 - (t.has_metric ? 1 : 0);
    const double rounding = t.block[0].rounding;
    int m = 0;
    for (int k = t.constraint_blocks; k < last; ++k)
      for (int r = t.block[k].begin; r < t.block[k].end; ++r)
        if (t.kind[r] != kFree) copy(t.block[k], r, row(m++));
    space_.rank = 0;
    while (space_.freedom()) {
      int p = -1;
      double most = rounding;
      for (int i = 0; i < m; ++i) {
        const double length = space_.length(row(i));
        if (length > most) most = length, p = i;
      }
      if (p < 0) break;
      space_.add(row(p), most);
      copy_rows(row(p), row(--m), ld_, 1, ld_);
      for (int i = 0; i < m; ++i) space_.project(row(i), space_.rank - 1);
    }
    count_ = space_.freedom();
    for (int j = 0; j < count_; ++j) {
      for (int i = 0; i < n_; ++i) Z(j)[i] = i == space_.rank + j ? 1.0 : 0.0;
      space_.lift(Z(j));
    }
    for (int k = 0; k < t.blocks; ++k) {
      const Block& b = t.block[k];
      const double unseen = t.has_metric && k == last ? kLost * b.norm : rounding;
      unseeing_[k] = count_ > 0 && b.A != nullptr;
      for (int r = b.begin; r < b.end && unseeing_[k]; ++r)
        unseeing_[k] = along(b.A + static_cast<std::ptrdiff_t>(r - b.begin) * n_) <= unseen;
    }
  }

  // Remove entries of a row of block k that only rounding can have caused; entries as small as the row's own rounding
  // stay.
  void clean_row(int k, double* unit) const {
    if (count_ && unseeing_[k] && along(unit) > kLastDigits) clean(k, unit);
  }

  // Clean a sum of rows equally.
  void clean(int k, double* y) const {
    if (!count_ || !unseeing_[k]) return;
    for (int j = 0; j < count_; ++j) add_any(y, Z(j), -dot_any(y, Z(j), n_), n_);
  }

 private:
  NullSpace space_;
  int n_ = 0, ld_ = 0, count_ = 0;
  bool known_ = false;
  double *row_ = nullptr, *Z_ = nullptr;
  bool* unseeing_ = nullptr;

  double* row(int i) const { return row_ + static_cast<std::ptrdiff_t>(i) * ld_; }
  double* Z(int j) const { return Z_ + static_cast<std::ptrdiff_t>(j) * ld_; }

  void copy(const Block& b, int r, double* to) const {
    const int i = r - b.begin;
    for (int j = 0; j < n_; ++j) to[j] = b.A ? b.A[static_cast<std::ptrdiff_t>(i) * n_ + j] : 0.0;
    if (!b.A) to[b.index[i]] = b.scale[i];
  }

  double along(const double* a) const {
    double square = 0.0;
    for (int j = 0; j < count_; ++j) {
      const double c = dot_any(a, Z(j), n_);
      square += c * c;
    }
    return std::sqrt(square);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
