// A point between two answers, and how far its command is from the last one: the equation of hqp/transition/blend.py.
#pragma once

#include <cmath>

#include "live_plan.hpp"

namespace binding {

// x = a + weight (b - a); the largest |x - last| of the entries from begin to end.
inline double blend(const Vector& a, const Vector& b, const Vector& last, double weight, std::size_t begin,
                    std::size_t end, const Written& x) {
  const std::size_t n = x.shape(0);
  if (a.shape(0) != n || b.shape(0) != n || last.shape(0) != n || end > n || begin > end)
    throw nb::value_error("blend: wrong shape");
  for (std::size_t i = 0; i < n; ++i) x.data()[i] = a.data()[i] + weight * (b.data()[i] - a.data()[i]);
  double largest = 0.0;
  for (std::size_t i = begin; i < end; ++i) {
    const double change = std::fabs(x.data()[i] - last.data()[i]);
    if (!(change <= largest)) largest = change;
  }
  return largest;
}

}  // namespace binding
