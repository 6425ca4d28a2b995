// From rows on the acceleration to a solve on the torque: the elimination, with live A (nv, nv), bias (nv), J (m, nv)
// and gamma (m), then the rows of all levels.
#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>

#include "../common/solve_call.hpp"
#include "elimination.hpp"

namespace hqp {

struct ChainArrays {
  std::size_t nv, n;
  const double *A, *bias, *J, *gamma;
  double tolerance;
  double *factor, *map, *phi, *Q, *T, *top;  // factor (nv, nv): a copy of A
};

class Chain final : public SolveCall {
 public:
  // forces: null where none are bounded.
  Chain(Elimination& elimination, TorqueRows& rows, ForceRows* forces, const ChainArrays& arrays)
      : elimination_(elimination), rows_(rows), forces_(forces), a_(arrays) {}

  // next: of the solver, null where Python asks it.
  void before(SolveCall* next) { next_ = next; }
  // Of the bounds on the acceleration.
  void limits(Limiting* limits) { limits_ = limits; }

  Solved run(const double* v) override {
    const auto begin = std::chrono::steady_clock::now();
    std::copy(a_.A, a_.A + a_.nv * a_.nv, a_.factor);
    if (elimination_.eliminate(a_.factor, a_.bias, a_.J, a_.gamma, a_.tolerance, a_.map, a_.phi, a_.Q, a_.T, a_.top) <
        0)
      return {kInvalid};
    double square = 0.0;
    for (std::size_t i = 0; i < a_.nv; ++i) {
      const double c = a_.map[i * (a_.n + 1) + a_.n];
      square += c * c;
    }
    if (!(square < INFINITY)) return {kInvalid};
    if (limits_) limits_->limit(v, elimination_);
    rows_.run(v, nullptr);
    if (forces_) forces_->run(a_.T, a_.top, nullptr);
    const double before = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    Solved found = next_ ? next_->run(v) : Solved{kAskPython};
    found.before = before;
    return found;
  }
  void limit(double seconds) override {
    if (next_) next_->limit(seconds);
  }

 private:
  Elimination& elimination_;
  TorqueRows& rows_;
  ForceRows* forces_;
  ChainArrays a_;
  SolveCall* next_ = nullptr;
  Limiting* limits_ = nullptr;
};

}  // namespace hqp
