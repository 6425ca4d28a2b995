// Levels with a price as the binding sees them: which of them the exact answer settles, and a stage for each of the
// others and for every level below one that is not met.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "../common/carry_over.hpp"

namespace hqp {

// One level of the hierarchy, read where it lies; A is (m, n), or null for rows that each pick one variable.
struct PricedLevel {
  int m = 0;
  const double* A = nullptr;
  const std::int64_t* index = nullptr;
  const double* scale = nullptr;
  const double* lower = nullptr;
  const double* upper = nullptr;

  bool left_out(int i) const { return lower[i] == -INFINITY && upper[i] == INFINITY; }
};

// How far a value is off its range; 0 within.
inline double slack(double value, double lower, double upper) {
  return value > upper ? value - upper : value < lower ? value - lower : 0.0;
}

// What chooses among optima; null for none.
struct Completion {
  const double *metric = nullptr, *origin = nullptr;  // (n, n), (n,)
};

// What an account is made of: stages as solve wrote them; slacks w of all rows; owner: the element of each row.
// lambda (told): multipliers of the first levels, level k after level k - 1, (m_0 + ... + m_k) each, for those that
// were no stage.
struct AccountRows {
  const double* stages = nullptr;
  const double* w = nullptr;
  const std::int32_t* owner = nullptr;
  int elements = 0;
  const double* lambda = nullptr;
  std::size_t told = 0;
  const double* x = nullptr;
  double near = 0.0;
};

// Of hqp/tolerances.py: of a level's terms, ||w|| below `met` is zero; directions without motion get `flat` of the
// largest column of F; an end of a stage that is off by more than `accurate` is in doubt; an entry counts for at least
// `resting` of the largest, or of one; `rounded` of a row's length is what rounding leaves of one that depends on
// others; relative to 1 + |bound| a row is at its bound within `activity`, and violated beyond `violation`.
struct Tolerances {
  double met, flat, accurate, resting, rounded, activity, violation;
};

// The law of a hierarchy (hqp.problem.Hierarchy): prices, turning (levels,); F (r, n), or its diagonal where r = 0, or
// null for the identity; f (r,), or null.
struct Law {
  const double *prices = nullptr, *turning = nullptr;
  double eta = 0.0;
  const double *F = nullptr, *f = nullptr;
  int r = 0;
};

class PricedStages {
 public:
  virtual ~PricedStages() = default;
  virtual PricedLevel* levels() = 0;  // to be filled once
  virtual void bind(const Law& law, const Completion& completion) = 0;
  // x: the exact answer of all levels, or of those above level `head` where it is not 0, or null: the face of the last
  // tick for that level, which needs no start.  The first level that it does not settle, -1 for none; otherwise stages
  // (levels, n) hold the points of priced levels from that one on (NaN elsewhere), and last the answer.  -2 where level
  // `head` is met, so that the exact answer of all levels is needed, where that face is of no use, or rows are no
  // numbers. seconds: after which a stage ends where it is, none for 0.
  virtual int solve(const double* x, int head, double seconds, double* stages, double* last) = 0;
  // Slacks and marks of all rows at x, as in Solution; whether a row of the first `constraints` levels is violated.
  virtual bool describe(const double* x, int constraints, double* slack, std::int8_t* marks) = 0;
  virtual int iterations() const = 0;
  virtual bool ended() const = 0;                  // whether every stage reached its optimum
  virtual bool uncertain() const = 0;              // whether one met uncertain directions
  virtual bool unpriced_met(const double* x) = 0;  // whether the levels without a price above the last with one are
  virtual bool undecided() const = 0;              // whether the answer depends on uncertain directions below them
  virtual bool doubtful() const = 0;               // or a stage may have ended off its optimum by more than rounding
  virtual void reset() = 0;                        // forget the warm start
  virtual void only_once() = 0;                    // no problem is like the last one: do not prepare for it
  // The warm start, and what spares a second look at what was found before.
  virtual void keep(CarryOver& warm) = 0;
  // What holds every level back at the answer of the latest solve (account.hpp).
  virtual void account(const AccountRows& rows, double* numbers, double* shares, double* worth) = 0;
};

PricedStages* make_stages_generic(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances);
PricedStages* make_stages_avx2(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances);

}  // namespace hqp
