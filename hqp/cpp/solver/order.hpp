// The order of points that a hierarchy means: the first level whose norms differ decides.
#pragma once

#include "dense.hpp"
#include "tolerances.hpp"

namespace hqp {
inline namespace HQP_ISA {

// Compare two points with norms a(k) and b(k) of level k: -1 where the first is better, 1 where the second is, 0 for
// neither.
template <class A, class B>
int lexicographic_order(int levels, const A& a, const B& b) {
  for (int k = 0; k < levels; ++k) {
    const double first = a(k), second = b(k);
    if (!(std::fabs(first - second) <= kViolated * (1.0 + smaller(first, second)))) return first < second ? -1 : 1;
  }
  return 0;
}

}  // namespace HQP_ISA
}  // namespace hqp
