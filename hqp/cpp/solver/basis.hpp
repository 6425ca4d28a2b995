// An orthonormal basis Z (count, n) of directions, which loses those that rows see.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "dense.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Basis {
 public:
  int count = 0;

  explicit Basis(int n)
      : n_(n),
        Z_(static_cast<std::size_t>(n) * static_cast<std::size_t>(n)),
        b_(static_cast<std::size_t>(n)),
        sum_(b_) {}

  double* at(int j) { return &Z_[static_cast<std::size_t>(j) * static_cast<std::size_t>(n_)]; }
  const double* data() const { return Z_.data(); }

  // b (count) = Z a; its length.
  double see(const double* a, double* b) const {
    dots_any(a, Z_.data(), n_, count, n_, b);
    return std::sqrt(dot_any(b, b, count));
  }
  // x += sign Z' z.
  void add(double* x, double sign, const double* z) const { add_rows(x, Z_.data(), n_, count, sign, z, 1, n_); }

  // Take out the direction along a row a (n) if its part in Z is longer than `least`; return the length of that part.
  double hold(const double* a, double least) {
    const double seen = see(a, b_.data());
    if (!(seen > least)) return seen;
    b_[0] += b_[0] < 0.0 ? -seen : seen;  // a reflection turns the first direction into this one
    std::fill(sum_.begin(), sum_.end(), 0.0);
    add(sum_.data(), 2.0 / dot_any(b_.data(), b_.data(), count), b_.data());
    for (int q = 1; q < count; ++q) add_any(at(q), sum_.data(), -b_[static_cast<std::size_t>(q)], n_);
    if (--count) std::copy(at(count), at(count) + n_, at(0));
    return seen;
  }

 private:
  int n_;
  std::vector<double> Z_, b_, sum_;
};

}  // namespace HQP_ISA
}  // namespace hqp
