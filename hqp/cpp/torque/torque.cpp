// Compiled once per instruction set; HQP_ISA names the namespace, HQP_MAKE, HQP_MAKE_ROWS and
// HQP_MAKE_FORCES the entries.
#include <utility>

#include "force_rows.hpp"
#include "level_rows.hpp"
#include "sparse_elimination.hpp"

namespace hqp {

Elimination* HQP_MAKE(std::vector<int> parents, Motors motors, int rows, const std::int8_t* out) {
  return new SparseElimination(std::move(parents), std::move(motors), rows, out);
}

TorqueRows* HQP_MAKE_ROWS(const double* map, int nv, int n) { return new LevelRows(map, nv, n); }

ForceRows* HQP_MAKE_FORCES(int m, int n) { return new RowsOfForces(m, n); }

}  // namespace hqp
