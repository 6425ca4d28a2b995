// Compiled once per instruction set; HQP_ISA names the namespace, HQP_MAKE the entry.
#include "stage_levels.hpp"

namespace hqp {

PricedStages* HQP_MAKE(int n, int levels, const int* m, const bool* priced, const Tolerances& tolerances) {
  return new StageLevels(n, levels, m, priced, tolerances);
}

}  // namespace hqp
