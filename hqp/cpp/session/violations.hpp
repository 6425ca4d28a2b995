// Rows of subject_to that are off.
#pragma once

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "tick.hpp"

namespace hqp {

// Whether slacks w (m) of an element's rows are beyond what rounding accounts for at these bounds: how far, and the
// rows, the worst first, where each has a name.
inline bool violated(const double* w, const double* lower, const double* upper, std::size_t m, double tolerance,
                     const std::vector<std::string>& names, Note& why) {
  bool any = false;
  for (std::size_t i = 0; i < m; ++i) {
    Note::Row row{nullptr, std::fabs(w[i])};
    if (row.amount > why.amount) why.amount = row.amount;
    if (!(row.amount > tolerance * (1.0 + std::fmin(std::fabs(lower[i]), std::fabs(upper[i]))))) continue;
    any = true;
    if (names.size() != m) continue;
    row.name = names[i].c_str();
    ++why.row_count;
    for (Note::Row& known : why.rows)
      if (!known.name || row.amount > known.amount) std::swap(known, row);
  }
  return any;
}

}  // namespace hqp
