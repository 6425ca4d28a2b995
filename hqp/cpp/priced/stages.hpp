// Levels with a price for the binding: the exact answer settles some of them; each other one, and every level below an
// unmet one, has a stage.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "../common/carry_over.hpp"

namespace hqp {

// One level of the hierarchy, read in place; A is (m, n), or null for rows that each pick one variable.
struct PricedLevel {
  int m = 0;
  const double* A = nullptr;
  const std::int64_t* index = nullptr;
  const double* scale = nullptr;
  const double* lower = nullptr;
  const double* upper = nullptr;

  bool left_out(int i) const { return lower[i] == -INFINITY && upper[i] == INFINITY; }
};

// Distance of a value from its range; 0 within.
inline double slack(double value, double lower, double upper) {
  return value > upper ? value - upper : value < lower ? value - lower : 0.0;
}

// Data of the completion; null without one.
struct Completion {
  const double *metric = nullptr, *origin = nullptr;  // (n, n), (n,)
};

// Data of an account: stages as solve wrote them; slacks w of all rows; owner: the element of each row.
// lambda (multipliers,): multipliers of the first levels, level k after level k - 1, (m_0 + ... + m_k) each; they serve
// levels without a stage.
struct AccountRows {
  const double* stages = nullptr;
  const double* w = nullptr;
  const std::int32_t* owner = nullptr;
  int elements = 0;
  const double* lambda = nullptr;
  std::size_t multipliers = 0;
  const double* x = nullptr;
  double near = 0.0;
};

// See hqp/tolerances.py: ||w|| below `met` of a level's terms is zero; directions without motion get `flat` of the
// largest column of F; an error of more than `accurate` at a stage's end is doubtful; an entry counts for at least
// `resting` of the largest, or of one; rounding leaves `rounded` of a dependent row's length; relative to 1 + |bound| a
// row is at its bound within `activity`, and violated beyond `violation`.
struct Tolerances {
  double met, flat, accurate, resting, rounded, activity, violation;
};

// The law of a hierarchy (hqp.problem.Hierarchy): prices, turning (levels,); F (r, n), or its diagonal if r = 0, or
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
  virtual PricedLevel* levels() = 0;  // the caller fills them once
  virtual void bind(const Law& law, const Completion& completion) = 0;
  // x: the exact answer of all levels, or of those above level `prefix` if that is not 0, or null: begin on the last
  // active set of that level.  Return the first unsettled level, -1 without one; stages (levels, n) then hold the
  // points of the stages from that one on (NaN elsewhere), and last the answer.  Return -2 if level `prefix` is met,
  // so that the exact answer of all levels is needed, if that active set fails, or if rows are not finite.  seconds:
  // time after which a stage returns its current point, 0 for no limit.
  virtual int solve(const double* x, int prefix, double seconds, double* stages, double* last) = 0;
  // Move x (n), the answer of the latest solve, if that ended, along directions that its last level leaves, to the
  // least length by the metric; unseen (count, n), orthonormal, are not among them.
  virtual void complete(const double* unseen, int count, double* x) = 0;
  // Write slacks and marks of all rows at x, see Solution; true if one of the first `constraints` levels is violated.
  // allowed: the permitted excess of each of their rows, or null.
  virtual bool describe(const double* x, int constraints, const double* allowed, double* slack, std::int8_t* marks) = 0;
  virtual int iterations() const = 0;
  virtual bool ended() const = 0;                  // every stage reached its optimum
  virtual bool uncertain() const = 0;              // a stage met uncertain directions
  virtual bool unpriced_met(const double* x) = 0;  // levels without a price above the last priced one are met
  virtual bool undecided() const = 0;              // the answer moves with a reading, unseen by certificates
  virtual bool doubtful() const = 0;               // a stage may have ended off its optimum by more than rounding
  virtual void reset() = 0;                        // forget the warm start
  virtual void only_once() = 0;                    // skip preparations for the next problem
  // Collect the warm start and reusable results.
  virtual void keep(CarryOver& warm) = 0;
  // Write the account of the latest answer (account.hpp).
  virtual void account(const AccountRows& rows, double* numbers, double* shares, double* worth) = 0;
};

PricedStages* make_stages_generic(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances);
PricedStages* make_stages_avx2(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances);

}  // namespace hqp
