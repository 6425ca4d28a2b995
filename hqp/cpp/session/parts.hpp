// Parts of a line: kinematics, rows, the elimination at torque level, and a solver.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "../priced/level_solve.hpp"
#include "../priced/planned.hpp"
#include "../rows/planned.hpp"
#include "../torque/parts.hpp"
#include "errors.hpp"

namespace hqp {

// A session from a file makes its own; a session in Python shares the parts of its program, for answers and
// explanations.
struct Parts {
  std::shared_ptr<Kinematics> kinematics;  // null if Python has them
  std::shared_ptr<Assembly> assembly;
  std::shared_ptr<TorqueParts> torque;  // null at other levels
  std::shared_ptr<LevelSolve> solver;   // null for a solver in Python
};

// The levels of a hierarchy of n variables.
template <class Node>
std::vector<Level> levels_of(const Node& p, std::size_t n) {
  std::vector<Level> found;
  for (const Node& one : p.parts("levels")) {
    const std::size_t m = one.part("lower").size();
    Level level;
    level.m = static_cast<int>(m);
    level.A = one.maybe("A", m * n);
    if (!level.A) level.index = one.places64("index", m, n), level.scale = one.doubles("scale", m);
    level.lower = one.doubles("lower", m), level.upper = one.doubles("upper", m);
    found.push_back(level);
  }
  return found;
}

// The prices of the levels on the motion of n variables, none if no level has one.
template <class Node>
Law law_of(const Node& p, std::size_t levels, std::size_t n) {
  Law law;
  if (!p.has("stages")) return law;
  const Node stages = p.part("stages");
  law.prices = stages.doubles("prices", levels);
  law.turning = stages.maybe("turning", levels);
  law.eta = stages.number("eta");
  if (stages.has("F")) {
    law.r = stages.integer("F_rows");
    if (law.r < 0)
      throw PlanError("F_rows is " + std::to_string(law.r) + ", allowed 0 and above: export the plan anew");
    law.F = stages.doubles("F", law.r ? static_cast<std::size_t>(law.r) * n : n);
  }
  law.f = stages.maybe("f", law.r ? static_cast<std::size_t>(law.r) : n);
  return law;
}

// Make the solver for n variables, bound to the arrays of a plan.
template <class Node>
std::unique_ptr<LevelSolve> solver_of(const Node& p, int n) {
  if (n < 1 || n > 10000 || p.integer("n") != n)
    throw PlanError("the solver of the plan has n = " + std::to_string(p.integer("n")) + ", its motion " +
                    std::to_string(n) + "; allowed: both the same, 1 to 10000");
  const std::size_t width = static_cast<std::size_t>(n);
  std::vector<Level> found = levels_of(p, width);
  const std::size_t count = found.size();
  std::vector<int> rows;
  for (const Level& level : found) rows.push_back(level.m);
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
  made->bind(law_of(p, count, width));
  made->make_prefixes();
  return made;
}

template <class Node>
Parts made_of(const Node& root) {
  const Node motion = root.part("motion");
  const int nv = root.part("robot").integer("nv");
  double* const twists = motion.doubles("twists", 6 * static_cast<std::size_t>(nv));
  Parts made;
  made.kinematics = std::make_shared<Kinematics>(joints(motion.part("joints"), nv),
                                                 frames(motion.part("frames"), motion.parts("joints").size()), twists);
  made.assembly =
      std::make_shared<Assembly>(bodies(motion.part("bodies"), nv), twists, root.part("robot").integer("nq"),
                                 root.part("guards").number("dt"), motion.integer("order"));
  Assembly& rows = *made.assembly;
  if (motion.has("dynamics")) add_dynamics(rows, motion.part("dynamics"));
  for (const Node& one : motion.parts("loads")) add_load(rows, one);
  for (const Node& one : motion.parts("operations")) rows.add(one.part("plan"), target(one, nv));
  rows.laws(laws(motion.part("laws"), rows.order(), nv));
  int n = nv;  // the torques of the motors, or the motion of all coordinates
  if (motion.has("torque")) {
    made.torque = std::make_shared<TorqueParts>(motion.part("torque"));
    n = static_cast<int>(made.torque->motors());
  }
  made.solver = solver_of(root.part("solver"), n);
  return made;
}

}  // namespace hqp
