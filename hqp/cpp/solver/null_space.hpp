// An orthonormal basis of the null space of rows, as a product of reflections Q = H_0 H_1 ... : the first `rank`
// entries of Q' a are determined by the rows, the others are its coordinates in the null space.
#pragma once

#include "arena.hpp"
#include "dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct NullSpace {
  int n = 0, ld = 0, rank = 0;

  void layout(Arena& arena, int n_) {
    n = n_;
    ld = padded(n);
    arena.place(v_, static_cast<std::size_t>(n) * ld);
    arena.place(tau_, n);
    arena.place(basis_, static_cast<std::size_t>(n) * ld);
    arena.place(tail_, n);
  }

  int freedom() const { return n - rank; }

  // y := Q' y, where the first `from` reflections were applied already.
  void project(double* y, int from = 0) const {
    for (int i = from; i < rank; ++i) reflect_one(i, y);
  }

  // Project a row without reflections applied, except for the first `rank` entries, which stay: if the space is small,
  // by a basis of it.
  void project_tail(double* y) {
    if (freedom() * kFew > rank) return project(y);
    if (known_rank_ != rank || known_ != added_) {
      for (int j = rank; j < n; ++j) {
        double* z = basis_ + static_cast<std::ptrdiff_t>(j) * ld;
        for (int i = 0; i < n; ++i) z[i] = i == j ? 1.0 : 0.0;
        lift(z);
      }
      known_rank_ = rank;
      known_ = added_;
    }
    dots_any(y, basis_ + static_cast<std::ptrdiff_t>(rank) * ld, ld, freedom(), n, tail_);
    for (int j = rank; j < n; ++j) y[j] = tail_[j - rank];
  }

  // y := Q y, but for the first `from` reflections.
  void lift(double* y, int from = 0) const {
    for (int i = rank - 1; i >= from; --i) reflect_one(i, y);
  }

  // One more row, given as Q' a: its reflection takes entries rank.. to a multiple of the first of them.
  void add(const double* y, double length) {
    double* v = v_ + static_cast<std::ptrdiff_t>(rank) * ld;
    for (int i = rank; i < n; ++i) v[i] = y[i];
    v[rank] += v[rank] >= 0.0 ? length : -length;
    tau_[rank] = 1.0 / (length * std::fabs(v[rank]));
    ++rank;
    ++added_;
  }

  // Reflection i from its first entry that is not zero on, and its factor: H = I - factor v v'.
  const double* reflection(int i) const { return v_ + static_cast<std::ptrdiff_t>(i) * ld + i; }
  double factor(int i) const { return tau_[i]; }

  // Length of the part of a row, given as Q' a, that lies in the null space.
  double length(const double* y) const { return std::sqrt(dot_any(y + rank, y + rank, n - rank)); }

 private:
  static constexpr int kFew = 4;  // reflections that cost as much as a direction of the basis
  double *v_ = nullptr, *tau_ = nullptr, *basis_ = nullptr, *tail_ = nullptr;
  int known_rank_ = -1;
  long added_ = 0, known_ = 0;  // reflections ever added, and when the basis was made

  void reflect_one(int i, double* y) const {
    const double* v = reflection(i);
    const double f = tau_[i] * dot_any(v, y + i, n - i);
    if (f != 0.0) add_any(y + i, v, -f, n - i);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
