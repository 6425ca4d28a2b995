// Options of the solver from a plan, in Python or in a file.
#pragma once

#include "../solver/problem.hpp"
#include "stages.hpp"

namespace hqp {

template <class Plan>
Options options_of(const Plan& p) {
  Options options;
  options.rank_tolerance = p.number("rank_tolerance");
  options.multiplier_tolerance = p.number("multiplier_tolerance");
  options.feasibility_tolerance = p.number("feasibility_tolerance");
  options.time_limit = p.number("deadline");
  options.max_iterations = p.integer("max_iterations");
  options.exchanges = p.integer("max_failed_exchanges");
  options.softness = p.number("softness");
  return options;
}
template <class Plan>
Tolerances tolerances_of(const Plan& p) {
  return {p.number("met"),     p.number("flat"),     p.number("accurate"), p.number("resting"),
          p.number("rounded"), p.number("activity"), p.number("violation")};
}

}  // namespace hqp
