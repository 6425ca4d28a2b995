// What rows ask of constraints whose forces have been eliminated, and the bounds that follow.
#pragma once

namespace hqp {

class Reactions {
 public:
  virtual ~Reactions() = default;
  virtual int rows() const = 0;
  // motion (nv) = A^-1 J^T (J A^-1 J^T)^+ asked (m): of least kinetic energy, of the latest elimination.
  virtual void towards(const double* asked, double* motion) = 0;
};

class Limiting {
 public:
  virtual ~Limiting() = default;
  // Bounds that stand around a speed stand around what the constraints leave of v (nv); see tasks/limits.py.
  virtual void limit(const double* v, Reactions& reactions) = 0;
};

}  // namespace hqp
