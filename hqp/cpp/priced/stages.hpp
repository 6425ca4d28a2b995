// Priced levels as the binding sees them: which levels the exact answer settles, and a stage for each of the others.
#pragma once

#include <cmath>
#include <cstdint>

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

// What a priced level hands down, written in place: (m + 1, n), the guard's row last. Of a level of single coordinates
// after the last price: its bounds (m), drawn towards rest; A is null.
struct Handed {
  double* A = nullptr;
  double* lower = nullptr;
  double* upper = nullptr;
};

// What an account is made of: stages as solve wrote them; slacks w of all rows; owner: the element of each row.
// lambda: multipliers of exact levels, level k after level k - 1, (m_0 + ... + m_k) each, or null; guards: every priced
// level has one row more there.
struct AccountRows {
  const double* stages = nullptr;
  const double* w = nullptr;
  const std::int32_t* owner = nullptr;
  int elements = 0;
  const double* lambda = nullptr;
  bool guards = false;
  const double* x = nullptr;
  double near = 0.0;
};

// Of a level's terms: ||w|| below `met` and a row's slack below `zero` are zero.  flat: directions without motion get
// this fraction of the largest column of F.
struct Tolerances {
  double met, zero, flat;
};

class PricedStages {
 public:
  virtual ~PricedStages() = default;
  virtual PricedLevel* levels() = 0;  // to be filled once
  virtual Handed* handed() = 0;
  // prices, shares: one a level.  guard: its floor, or null for no guard.  F: (r, n), or its diagonal where r = 0, or
  // null for the identity; f: (r), or null.  pace: of single coordinates below an unmet level.
  virtual void bind(const double* prices, const double* shares, const double* F, const double* f, int r,
                    const double* guard, double pace) = 0;
  // x: the exact answer of all levels, or of those above level `head` where it is not 0.  The first level that it does
  // not settle, -1 for none; from that level on the stages are solved, stages (levels, n) hold their points (NaN
  // elsewhere), and last the last of them.  -2 where level `head` is met: the exact answer of all levels is needed.
  // seconds: after which a stage ends where it is, none for 0.
  virtual int solve(const double* x, int head, double seconds, double* stages, double* last) = 0;
  // Slacks and marks of all rows at x, as in Solution; whether a row of the first `constraints` levels is violated.
  virtual bool describe(const double* x, int constraints, double activity, double violation, double* slack,
                        std::int8_t* marks) = 0;
  virtual int iterations() const = 0;
  virtual bool ended() const = 0;      // whether every stage reached its optimum
  virtual bool uncertain() const = 0;  // whether one met uncertain directions
  virtual void reset() = 0;            // forget the warm start
  // What holds every level back at the answer of the latest solve (account.hpp).
  virtual void account(const AccountRows& rows, double* numbers, double* shares, double* worth) = 0;
};

PricedStages* make_stages_generic(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances);
PricedStages* make_stages_avx2(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances);

}  // namespace hqp
