// Rows by falling length, each orthogonal to those before it, and the singular values of nearly dependent ones.
#pragma once

#include "deadline.hpp"
#include "null_space.hpp"
#include "rotation.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

// A P = R' Q': Householder with pivoting takes rows, as columns here, into a triangular factor R (rank, width), and its
// reflections into a NullSpace. One-sided Jacobi rotations make the rows of R orthogonal: their lengths are the
// singular values then, and direction j is the sum that row j has become.
class RowFactor {
 public:
  int rank = 0;

  void layout(Arena& arena, int n, int rows) {
    ld_ = padded(n);
    wide_ = padded(rows);
    arena.place(T_, static_cast<std::size_t>(n) * wide_);
    arena.place(u_, static_cast<std::size_t>(n) * ld_);
    arena.place(length_, n);
    arena.place(size_, wide_);
    arena.place(weight_, wide_);
    arena.place(y_, n);
    arena.place(dropped_, n);
  }

  // Begin with this many rows, given by their coordinates in a null space of `freedom` dimensions.
  void start(int rows, int freedom) {
    width_ = lanes(rows);
    freedom_ = freedom;
    drops_ = 0;
    renew(rows);
  }

  // Begin again with equal rows.
  void renew(int rows) {
    for (int a = 0; a < width_; ++a) weight_[a] = a < rows ? 1.0 : 0.0;
    for (int i = 0; i < freedom_; ++i)
      for (int a = rows; a < width_; ++a) row(i)[a] = 0.0;
  }

  void set(int a, const double* y) {
    for (int i = 0; i < freedom_; ++i) y_[i] = y[i];
    for (int d = 0; d < drops_; ++d) add_any(y_, dropped_[d], -dot_any(y_, dropped_[d], freedom_), freedom_);
    for (int i = 0; i < freedom_; ++i) row(i)[a] = y_[i];
  }

  // Fix at most this many directions of `null`, until the remainder of every row is rounding. Returns the length that
  // is left.
  double reduce(NullSpace& null, int most) {
    const int base = null.rank;
    double reference = 0.0, left = 0.0;
    for (rank = 0; rank < most; ++rank) {
      int p = rank ? largest(size_, width_) : 0;
      if (rank == 0 || size_[p] < kLost * reference) {
        measure();
        p = largest(size_, width_);
        reference = size_[p];
      }
      double square = 0.0;
      for (int i = rank; i < freedom_; ++i) {
        const double t = y_[base + i] = row(i)[p];
        square += t * t;
      }
      left = std::sqrt(square);
      if (!(left > kOnRow)) return left;
      const double pivot = y_[base + rank] >= 0.0 ? -left : left;
      null.add(y_, left);
      reflect(row(rank), wide_, null.reflection(base + rank), freedom_ - rank, null.factor(base + rank), width_, size_,
              weight_);
      row(rank)[p] = pivot;
      for (int i = rank + 1; i < freedom_; ++i) row(i)[p] = 0.0;
      size_[p] = weight_[p] = 0.0;
      length_[rank] = left;
    }
    return 0.0;
  }

  // Length of the row that took direction j when it was taken.
  double length(int j) const { return length_[j]; }
  double singular_value(int j) { return std::sqrt(dot(row(j), row(j), width_)); }

  void find_singular_values(Deadline& deadline) {
    for (int i = 0; i < rank; ++i)
      for (int j = 0; j < rank; ++j) direction(i)[j] = i == j ? 1.0 : 0.0;
    bool turned = true;
    for (int sweep = 0; sweep < kEnough && turned; ++sweep) {
      turned = false;
      for (int i = 0; i < rank && !deadline.passed(); ++i)
        for (int j = i + 1; j < rank; ++j) turned = rotate(i, j) || turned;
    }
  }

  // Take direction j back: rows that are set again lose their part of it. Directions from `base` on are fixed by
  // `null`.
  void drop(int j, const NullSpace& null, int base) {
    double* y = direction(j);
    std::memmove(y + base, y, sizeof(double) * static_cast<std::size_t>(rank));
    for (int i = 0; i < null.n; ++i)
      if (i < base || i >= base + rank) y[i] = 0.0;
    null.lift(y, base);
    dropped_[drops_++] = y + base;
  }

 private:
  int ld_ = 0, wide_ = 0, width_ = 0, freedom_ = 0, drops_ = 0;
  double** dropped_ = nullptr;
  double *T_ = nullptr, *u_ = nullptr, *length_ = nullptr, *size_ = nullptr, *weight_ = nullptr, *y_ = nullptr;

  double* row(int i) { return T_ + static_cast<std::ptrdiff_t>(i) * wide_; }
  double* direction(int j) { return u_ + static_cast<std::ptrdiff_t>(j) * ld_; }

  void measure() {
    for (int a = 0; a < width_; a += kLane) {
      Vec4 total = splat(0.0);
      for (int i = rank; i < freedom_; ++i) total += at(row(i) + a) * at(row(i) + a);
      at(size_ + a) = total * at(weight_ + a);
    }
  }

  bool rotate(int i, int j) {
    double *a = row(i), *b = row(j);
    const double aa = dot(a, a, width_), bb = dot(b, b, width_), ab = dot(a, b, width_);
    // rows of nothing but rounding are orthogonal to none
    if (!(std::fabs(ab) > kNoStep * std::sqrt(aa) * std::sqrt(bb)) || smaller(aa, bb) < kOnRow * kOnRow) return false;
    const Rotation rotation(aa, bb, ab);
    rotation.turn(a, b, width_);
    rotation.turn(direction(i), direction(j), rank);
    return true;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
