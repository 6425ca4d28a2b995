// The verdict on a point, independent of the tableau.
#pragma once

#include <initializer_list>

#include "conditions.hpp"

namespace hqp {
inline namespace HQP_ISA {

class Judge {
 public:
  double gap = 0.0;  // the largest so far

  explicit Judge(Conditions& conditions) : at_(conditions) {}

  // Return true if the point is optimal under either reading of small multipliers, by which rows count as fixed for the
  // levels below, and of directions near kDirection; false after the deadline.
  bool judge(const double* point) {
    for (int i = 0; i < at_.n; ++i) at_.x[i] = point[i];
    at_.closest = kInfinity;
    if (at_.table->shortened) at_.unseen.find(*at_.table);
    bool passed = false;
    for (const double reading : {1.0, 1.0 / kEither, kEither}) {
      at_.threshold = reading * kDirection;
      passed = pass(kOnRow) || (!at_.deadline.passed() && pass(kClearOf));
      reading_ = at_.threshold;
      if (passed || at_.closest > kEither) break;
    }
    at_.threshold = kDirection;
    return passed;
  }

  // Return true if the accepted point would fail without rows of smaller force than this.
  bool rests_on_less(double force) {
    if (!(at_.faintest < force)) return false;
    const double found = gap;
    at_.threshold = reading_;
    const bool passed = pass(force);
    at_.threshold = kDirection;
    gap = found;
    return !passed && !at_.deadline.passed();
  }

 private:
  Conditions& at_;
  double reading_ = kDirection;  // threshold of the latest verdict

  bool pass(double lock) {
    gap = 0.0;
    at_.begin(kViolated);
    for (int k = 0; k < at_.table->blocks && at_.null_space.freedom(); ++k) {
      const double own = at_.gap_of(k);
      gap = larger(gap, own);
      if (!(own <= at_.allowed())) return false;
      at_.descend(k, lock, own);
    }
    return !at_.deadline.passed();
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
