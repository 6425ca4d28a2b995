// Compiled once per instruction set; HQP_ISA names the namespace, HQP_MAKE the entry.
#include "lexicographic.hpp"

namespace hqp {

Kernel* HQP_MAKE(int n, int levels, const int* m, bool metric) { return new Lexicographic(n, levels, m, metric); }

}  // namespace hqp
