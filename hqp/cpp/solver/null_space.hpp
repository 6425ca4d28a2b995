// An orthonormal basis of the null space of rows, as a product of reflections Q = H_0 H_1 ... : the first `rank`
// entries of Q' a are what the rows determine of a, the others its coordinates in the null space.
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
  }

  int freedom() const { return n - rank; }

  // y := Q' y, where the first `from` reflections were applied already.
  void project(double* y, int from = 0) const {
    for (int i = from; i < rank; ++i) reflect_one(i, y);
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
  }

  // Reflection i from its first entry that is not zero on, and its factor: H = I - factor v v'.
  const double* reflection(int i) const { return v_ + static_cast<std::ptrdiff_t>(i) * ld + i; }
  double factor(int i) const { return tau_[i]; }

  // Length of the part of a row, given as Q' a, that lies in the null space.
  double length(const double* y) const { return std::sqrt(dot_any(y + rank, y + rank, n - rank)); }

 private:
  double *v_ = nullptr, *tau_ = nullptr;

  void reflect_one(int i, double* y) const {
    const double* v = reflection(i);
    const double f = tau_[i] * dot_any(v, y + i, n - i);
    if (f != 0.0) add_any(y + i, v, -f, n - i);
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
