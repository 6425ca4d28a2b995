// The kernel as the binding sees it: one workspace, built for the widest instruction set of the machine.
#pragma once

#include "../common/carry_over.hpp"
#include "problem.hpp"

namespace hqp {

class Kernel {
 public:
  virtual ~Kernel() = default;
  virtual void solve(const Problem& problem, const Options& options, Answer& answer) = 0;
  // Write multipliers of the latest answer into answer.multipliers; false if its working set is gone.
  virtual bool write_multipliers(const Problem& problem, Answer& answer) = 0;
  // x (n) moves to the soft choice (soft_choice.hpp), or with `hard` to a point within the rows.
  virtual void choose(const Problem& problem, const Options& options, double* x, bool hard) = 0;
  // Directions (count, n) of the soft choice, orthonormal; choose() must follow.
  virtual const double* unseen(const Problem& problem, const Options& options, int& count) = 0;
  // By how much each row of the constraints may be exceeded at the latest choice; null if by nothing.
  virtual const double* allowed() = 0;
  virtual void keep(CarryOver& warm) = 0;  // the warm start
  virtual void reset(bool plain) = 0;      // forget the warm start; plain: the next search factorises every working set
};

// n variables, m[k] rows in level k, a metric or not; throws std::bad_alloc.
Kernel* make_generic(int n, int levels, const int* m, bool metric);
Kernel* make_avx2(int n, int levels, const int* m, bool metric);

// Built for the widest instruction set that the machine has.
Kernel* make_kernel(int n, int levels, const int* m, bool metric);

}  // namespace hqp
