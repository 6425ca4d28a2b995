// Demands of rows on eliminated constraints, and the resulting bounds.
#pragma once

namespace hqp {

class Reactions {
 public:
  virtual ~Reactions() = default;
  virtual int rows() const = 0;
  // motion (nv) = A^-1 J^T (J A^-1 J^T)^+ requested (m): motion of least kinetic energy, of the latest elimination.
  virtual void towards(const double* requested, double* motion) = 0;
};

class Limiting {
 public:
  virtual ~Limiting() = default;
  // Move bounds around a speed to the part of v (nv) that the constraints leave; see tasks/limits.py.
  virtual void limit(const double* v, Reactions& reactions) = 0;
};

}  // namespace hqp
