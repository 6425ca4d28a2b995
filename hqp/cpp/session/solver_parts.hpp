// The solver of a plan: a kernel, and the stages of priced levels over it.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "../common/isa.hpp"
#include "../priced/staged_solve.hpp"
#include "../solver/bound_kernel.hpp"
#include "node.hpp"

namespace hqp {

// A kernel of n variables bound to the arrays of a plan.
inline std::unique_ptr<BoundKernel> kernel_of(const Node& p, int n) {
  const std::vector<Node> levels = p.parts("levels");
  if (n < 1 || n > 10000 || p.integer("n") != n) throw PlanError("a kernel of the plan has a wrong size");
  std::vector<int> rows;
  for (const Node& level : levels) {
    const std::size_t m = level.part("lower").size();
    level.doubles("lower", m), level.maybe("A", m * static_cast<std::size_t>(n));
    rows.push_back(static_cast<int>(m));
  }
  Options options;
  options.rank_tolerance = p.number("rank_tolerance");
  options.multiplier_tolerance = p.number("multiplier_tolerance");
  options.feasibility_tolerance = p.number("feasibility_tolerance");
  options.time_limit = p.number("deadline");
  options.max_iterations = p.integer("max_iterations");
  options.exchanges = p.integer("max_failed_exchanges");
  auto made = std::make_unique<BoundKernel>(n, rows, p.has("metric"), options);
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const std::size_t m = static_cast<std::size_t>(rows[k]);
    Level& level = made->levels[k];
    level.m = rows[k];
    level.A = levels[k].maybe("A", m * static_cast<std::size_t>(n));
    if (!level.A)
      level.index = levels[k].places64("index", m, static_cast<std::size_t>(n)),
      level.scale = levels[k].doubles("scale", m);
    level.lower = levels[k].doubles("lower", m);
    level.upper = levels[k].doubles("upper", m);
  }
  made->problem.levels = made->levels.data();
  made->problem.count = static_cast<int>(levels.size());
  made->problem.constraints = p.place("constraints", levels.size() + 1);
  made->problem.metric = p.maybe("metric", static_cast<std::size_t>(n) * n);
  made->problem.origin = p.maybe("origin", n);
  return made;
}

// The solve of all levels, and of those above each that may be the first unmet one, and below it.
class PlannedSolve {
 public:
  PlannedSolve(const Node& p, int n) : exact_(kernel_of(p, n)) {
    if (p.has("stages")) bind(p.part("stages"), exact_->levels);
  }

  SolveCall& call() { return staged_ ? static_cast<SolveCall&>(*staged_) : *exact_; }
  BoundKernel& exact() { return *exact_; }
  StagedSolve* staged() { return staged_.get(); }
  const Law* law() const { return staged_ ? &law_ : nullptr; }
  const double* end() const { return end_; }
  // Slacks and marks of all rows at the end of the latest stages; whether a constraint is violated.
  bool describe(double* slack, std::int8_t* marks) {
    return staged_->stages().describe(end_, exact_->problem.constraints, slack, marks);
  }
  bool limited() const { return limited_; }
  // Time for the next solves [s], none for 0.
  void limit(double seconds) {
    limited_ = seconds > 0.0;
    exact_->limit(seconds);
    for (const auto& head : heads_) head->limit(seconds);
    if (staged_) staged_->limit(seconds);
  }
  // All that goes over from one solve to the next.
  void keep(CarryOver& warm) {
    exact_->keep(warm);
    for (const auto& one : heads_) one->keep(warm);
    if (staged_) staged_->keep(warm);
  }
  // The next solves are without the rows of these elements.
  void turn(const WarmSets::Out& out) { sets_.turn(*this, out); }
  void make_room(std::size_t elements) { sets_.make_room(*this, elements); }  // for all sets of these
  void reset() {
    exact_->reset(false);
    for (const auto& one : heads_) one->reset(false);
    if (staged_) staged_->reset();
    sets_.forget();
  }

 private:
  void bind(const Node& p, const std::vector<Level>& levels) {
    const int n = exact_->size();
    const std::size_t count = levels.size();
    std::unique_ptr<bool[]> priced(new bool[count]);
    const std::vector<Node> flags = p.parts("priced");
    if (flags.size() != count) throw PlanError("the plan tells of other levels than it has");
    for (std::size_t k = 0; k < count; ++k) priced[k] = flags[k].flag();
    const Tolerances tolerances{p.number("met"),     p.number("flat"),     p.number("accurate"), p.number("resting"),
                                p.number("rounded"), p.number("activity"), p.number("violation")};
    const std::vector<int>& rows = exact_->rows();
    staged_ = std::make_unique<StagedSolve>(
        n, rows,
        std::unique_ptr<PricedStages>(
            HQP_FOR_MACHINE(make_stages, n, static_cast<int>(count), rows.data(), priced.get(), tolerances)));
    for (std::size_t k = 0; k < count; ++k) {
      PricedLevel& to = staged_->stages().levels()[k];
      to.A = levels[k].A, to.index = levels[k].index, to.scale = levels[k].scale;
      to.lower = levels[k].lower, to.upper = levels[k].upper;
    }
    law_.prices = p.doubles("prices", count);
    law_.turning = p.maybe("turning", count);
    law_.eta = p.number("eta");
    if (p.has("F")) {
      law_.r = p.integer("F_rows");
      if (law_.r < 0) throw PlanError("the motion of the plan has a wrong size");
      law_.F = p.doubles("F", law_.r ? static_cast<std::size_t>(law_.r) * n : n);
    }
    law_.f = p.maybe("f", law_.r ? law_.r : n);
    const Completion completion{exact_->problem.metric, exact_->problem.origin};
    staged_->bind(law_, completion);
    for (const Node& head : p.parts("heads")) {
      heads_.push_back(kernel_of(head, n));
      staged_->above(head.place("level", count), heads_.back().get(), heads_.back()->numbers().data());
    }
    end_ = p.doubles("end", n);
    staged_->after(exact_.get(), exact_->numbers().data(), p.doubles("points", count * n), p.doubles("end", n));
    staged_->answers(exact_->problem.constraints);
  }

  std::unique_ptr<BoundKernel> exact_;
  std::vector<std::unique_ptr<BoundKernel>> heads_;
  std::unique_ptr<StagedSolve> staged_;
  WarmSets sets_;
  Law law_;
  const double* end_ = nullptr;
  bool limited_ = false;
};

}  // namespace hqp
