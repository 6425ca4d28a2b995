// The solver of a plan.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "../priced/level_solve.hpp"
#include "../priced/planned.hpp"
#include "node.hpp"

namespace hqp {

// Of n variables, bound to the arrays of a plan.
inline std::unique_ptr<LevelSolve> solver_of(const Node& p, int n) {
  const std::vector<Node> levels = p.parts("levels");
  const std::size_t count = levels.size(), width = static_cast<std::size_t>(n);
  if (n < 1 || n > 10000 || p.integer("n") != n)
    throw PlanError("the solver of the plan has n = " + std::to_string(p.integer("n")) + ", its motion " +
                    std::to_string(n) + "; allowed: both the same, 1 to 10000");
  std::vector<Level> found;
  std::vector<int> rows;
  for (const Node& one : levels) {
    const std::size_t m = one.part("lower").size();
    Level level;
    level.m = static_cast<int>(m);
    level.A = one.maybe("A", m * width);
    if (!level.A) level.index = one.places64("index", m, width), level.scale = one.doubles("scale", m);
    level.lower = one.doubles("lower", m), level.upper = one.doubles("upper", m);
    found.push_back(level), rows.push_back(level.m);
  }
  std::vector<char> priced;
  Tolerances tolerances{};
  const bool staged = p.has("stages");
  if (staged) {
    const Node stages = p.part("stages");
    for (const Node& flag : stages.parts("priced")) priced.push_back(flag.flag());
    if (priced.size() != count)
      throw PlanError("the plan has " + std::to_string(count) + " levels and prices of " +
                      std::to_string(priced.size()) + ": export it anew");
    tolerances = tolerances_of(stages);
  }
  auto made = std::make_unique<LevelSolve>(n, rows, p.has("metric"), options_of(p), std::move(priced), tolerances);
  BoundKernel& exact = made->exact();
  exact.levels = std::move(found);
  exact.problem.levels = exact.levels.data();
  exact.problem.count = static_cast<int>(count);
  exact.problem.constraints = p.place("constraints", count + 1);
  exact.problem.metric = p.maybe("metric", width * width);
  exact.problem.origin = p.maybe("origin", width);
  if (!staged) return made;
  const Node stages = p.part("stages");
  Law law;
  law.prices = stages.doubles("prices", count);
  law.turning = stages.maybe("turning", count);
  law.eta = stages.number("eta");
  if (stages.has("F")) {
    law.r = stages.integer("F_rows");
    if (law.r < 0)
      throw PlanError("F_rows is " + std::to_string(law.r) + ", allowed 0 and above: export the plan anew");
    law.F = stages.doubles("F", law.r ? static_cast<std::size_t>(law.r) * width : width);
  }
  law.f = stages.maybe("f", law.r ? static_cast<std::size_t>(law.r) : width);
  made->bind(law);
  made->make_heads();
  return made;
}

}  // namespace hqp
