// Torque level as the binding sees it: the constraint forces eliminated, and the rows of all levels on the torque.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "../common/reactions.hpp"

namespace hqp {

// U (n, nv), qd_act = U qd: the coordinate of each motor, and all entries of U, those of tendons too.
struct Motors {
  struct Entry {
    int motor, joint;
    double factor;
  };
  std::vector<int> own;
  std::vector<Entry> entries;
};

// qdd = X tau + c of a robot whose constraint forces are eliminated; hqp/torque/dynamics.py has the equations.
class Elimination : public Reactions {
 public:
  // A (nv, nv): its upper triangle, column-major; bias (nv), J (m, nv), gamma (m).  Written: map (nv, n + 1) = [X, c],
  // phi (n, n), to the bit U X of motors of one joint, Q (nv, m) and T (m, m) with H^-T J^T = Q T, top
  // (m, n + 1); for dependent constraints T is the identity and the forces are those of least norm.  The rank of the
  // constraints, -1 where A is not positive definite.  Constraints that are out have zeros in Q and in top, and a row
  // of the identity in T: they have no force.
  virtual int eliminate(const double* A, const double* bias, const double* J, const double* gamma, double tolerance,
                        double* map, double* phi, double* Q, double* T, double* top) = 0;
};

// Rows on qdd, lower <= J qdd <= upper, as rows on tau: lower - J c <= J X tau <= upper - J c.
struct AccelerationRows {
  int m;
  double* A;  // (m, n), written as the bounds are
  const double *demand_lower, *demand_upper;
  double *lower, *upper;
};

class TorqueRows {
 public:
  virtual ~TorqueRows() = default;
  // J (m, nv); or rows that pick coordinates, with a weight each or none.
  virtual void product(const double* J, const AccelerationRows& rows) = 0;
  virtual void pick(std::vector<int> index, std::vector<double> weight, const AccelerationRows& rows) = 0;
  // S (qdd + rest v) is motion: F (nv, n) = S X, f (nv) = -S (c + rest v), S = diag(scale).
  virtual void motion(std::vector<double> scale, double rest, double* F, double* f) = 0;
  // v (nv); c (nv) in the place of that of the map, or null.
  virtual void run(const double* v, const double* c) = 0;
};

// Rows on the forces of m constraints, lambda = T^-1 top (tau, 1), as rows on tau: lower <= -C lambda <= upper.
// Distribution of a wrench between two contacts, see tasks/load_share.py: C (6, m) is written each time, s is live.
struct Shared {
  double* C;
  int first[2];               // rows of the constraints where the contacts' begin
  const double* rotation[2];  // contacts' axes, live, column-major
  const double* sole[2];      // axes of the frames of the middles
  std::array<double, 2> middle[2];
  double factor[2], arm;  // by which C is multiplied
  const double* share;
};

// Axes of the force at a contact: z the ground's normal (3), x the x axis of its frame projected on the ground, or with
// `across` y its y axis.  rotation, axes (3, 3): column-major; live.
struct GroundAxes {
  const double *rotation, *normal;
  double* axes;
  bool across;
};

class ForceRows {
 public:
  virtual ~ForceRows() = default;
  virtual void ground(const GroundAxes& contact) = 0;
  virtual void share(const Shared& contacts) = 0;
  // Three of the constraints' rows from `first` on are turned into a contact's axes, by the live transpose of its
  // rotation, row-major.
  virtual void turn(int first, const double* rotation) = 0;
  virtual void add(const double* C, const AccelerationRows& rows) = 0;  // C (rows, m), its sign that of lambda
  // T (m, m), top (m, n + 1) of an elimination; shift (n): part of tau that the model of the forces does not know, or
  // null.
  virtual void run(const double* T, const double* top, const double* shift) = 0;
};

// out: flags of the constraints, live, 1 for an absent one.
Elimination* make_elimination_generic(std::vector<int> parents, Motors motors, int rows, const std::int8_t* out);
Elimination* make_elimination_avx2(std::vector<int> parents, Motors motors, int rows, const std::int8_t* out);
TorqueRows* make_torque_rows_generic(const double* map, int nv, int n);
TorqueRows* make_torque_rows_avx2(const double* map, int nv, int n);
ForceRows* make_force_rows_generic(int m, int n);
ForceRows* make_force_rows_avx2(int m, int n);

}  // namespace hqp
