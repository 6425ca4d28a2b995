// Interface of the kernel: views of a problem, options, and the answer. No code, no ISA.
#pragma once

#include <cstdint>

namespace hqp {

// One level of the caller's problem; A is null for a selection.
struct Level {
  const double* A = nullptr;            // (m, n) row-major
  const std::int64_t* index = nullptr;  // (m,)
  const double* scale = nullptr;        // (m,)
  const double* lower = nullptr;        // (m,)
  const double* upper = nullptr;        // (m,)
  int m = 0;
};

constexpr int kLargest = 10000;  // number of variables, and of rows of a level

struct Problem {
  const Level* levels = nullptr;
  int count = 0;
  int constraints = 0;
  const double* metric = nullptr;  // (n, n) or null
  const double* origin = nullptr;  // (n,) or null
  const double* motion = nullptr;  // (motion_rows, n) that levels with a price pay for
  int motion_rows = 0;
};

struct Options {
  double rank_tolerance = 0.0, multiplier_tolerance = 0.0, feasibility_tolerance = 0.0;  // hqp/tolerances.py
  double time_limit = 0.0;                                                               // seconds, none if zero
  int max_iterations = 0;                                                                // automatic if zero
  int exchanges = 3;
  bool multipliers = false;
  double softness = 0.0;  // see soft_choice.hpp, 0: rows are kept to their bounds
};

enum class Outcome : int {
  optimal = 0,
  rank_uncertain = 1,
  constraints_violated = 2,
  not_certified = 3,
  iteration_limit = 4,
  time_limit = 5,
  invalid = 6,
};

// Destination of the solution; the arrays are the caller's.
struct Answer {
  double* x = nullptr;            // (n,)
  double* hard = nullptr;         // (n,) x before the soft choice, which stages begin at; null if not requested
  double* slack = nullptr;        // (sum m,)
  std::int8_t* active = nullptr;  // (sum m,)
  double* multipliers = nullptr;  // level k after level k - 1, (m_0 + ... + m_k) each; null if not requested
  Outcome outcome = Outcome::optimal;
  bool unsure = false;  // ranks were uncertain, though constraints are violated or the data's last digits do not move x
  int iterations = 0;
  int factorisations = 0;
  int judged = 0;  // 1: the answer was judged, 2: it was refused and found level by level
};

}  // namespace hqp
