// Compiled once per instruction set; HQP_ISA names the namespace, HQP_MAKE and HQP_MAKE_ROWS the entries.
#include <utility>

#include "level_rows.hpp"
#include "sparse_elimination.hpp"

namespace hqp {

Elimination* HQP_MAKE(std::vector<int> parents, std::vector<int> actuated, int rows) {
  return new SparseElimination(std::move(parents), std::move(actuated), rows);
}

TorqueRows* HQP_MAKE_ROWS(const double* map, int nv, int n) { return new LevelRows(map, nv, n); }

}  // namespace hqp
