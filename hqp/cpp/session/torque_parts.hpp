// What stands between rows on the acceleration and the solver at torque level.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <set>
#include <vector>

#include "../common/isa.hpp"
#include "../torque/chain.hpp"
#include "../torque/holding.hpp"
#include "node.hpp"

namespace hqp {

class TorqueParts {
 public:
  TorqueParts(const Node& p, int nv, SolveCall& solver, Limiting& limits) {
    const std::size_t v = static_cast<std::size_t>(nv), m = p.part("gamma").size();
    const std::vector<int> actuated = p.places("actuated", v), parents = p.ints("parents");
    const std::size_t n = actuated.size();
    bool tree = parents.size() == v && std::set<int>(actuated.begin(), actuated.end()).size() == n;
    for (std::size_t i = 0; tree && i < v; ++i) tree = parents[i] >= -1 && parents[i] < static_cast<int>(i);
    if (!tree) throw PlanError("the elimination of the plan has a wrong size");
    out_.assign(m, 0), J_.assign(m * v, 0.0);
    elimination_.reset(HQP_FOR_MACHINE(make_elimination, parents, actuated, static_cast<int>(m), out_.data()));
    const double* map = p.doubles("map", v * (n + 1));
    rows_.reset(HQP_FOR_MACHINE(make_torque_rows, map, nv, static_cast<int>(n)));
    for (const Node& one : p.parts("products")) {
      const Asked asked = rows(one, n);
      rows_->product(one.doubles("J", static_cast<std::size_t>(asked.m) * v), asked);
    }
    for (const Node& one : p.parts("picks")) {
      const Asked asked = rows(one, n);
      const std::vector<int> index = one.places("index", v);
      std::vector<double> weight = one.numbers("weight");
      if (index.size() != std::size_t(asked.m) || (!weight.empty() && weight.size() != index.size()))
        throw PlanError("the elimination of the plan has a wrong size");
      rows_->pick(index, std::move(weight), asked);
    }
    if (p.has("motion")) {
      const Node motion = p.part("motion");
      rows_->motion(motion.numbers("scale", v), motion.number("rest"), motion.doubles("F", v * n),
                    motion.doubles("f", v));
    }
    double *T = p.doubles("T", m * m), *top = p.doubles("top", m * (n + 1));
    if (p.has("forces")) {
      const Node forces = p.part("forces");
      forces_.reset(HQP_FOR_MACHINE(make_force_rows, static_cast<int>(m), static_cast<int>(n)));
      for (const Node& one : forces.parts("frames"))
        forces_->turn(one.place("first", m < 3 ? 0 : m - 2), one.doubles("rotation", 9));
      for (const Node& one : forces.parts("shared")) share(one, m);
      for (const Node& one : forces.parts("rows")) {
        const Asked asked = rows(one, n);
        forces_->add(one.doubles("C", static_cast<std::size_t>(asked.m) * m), asked);
      }
    }
    arrays_ = {v,
               n,
               p.doubles("A", v * v),
               p.doubles("bias", v),
               p.doubles("J", m * v),
               p.doubles("gamma", m),
               p.number("tolerance"),
               p.doubles("factor", v * v),
               p.doubles("map", v * (n + 1)),
               p.doubles("phi", n * n),
               p.doubles("Q", v * m),
               T,
               top};
    chain_ = std::make_unique<Chain>(*elimination_, *rows_, forces_.get(), arrays_);
    chain_->before(&solver);
    chain_->limits(&limits);
    std::vector<int> others;
    for (int i = 0; i < nv; ++i)
      if (std::find(actuated.begin(), actuated.end(), i) == actuated.end()) others.push_back(i);
    if (m >= others.size()) holding_ = std::make_unique<Holding>(actuated, others, static_cast<int>(m));
  }

  Solved run(const double* v) { return chain_->run(v); }

  int rows() const { return static_cast<int>(out_.size()); }  // of constraints
  // Constraints from one row to another are there or not.
  void out(int row, int end, bool gone) { std::fill(out_.begin() + row, out_.begin() + end, gone); }
  // The torque (n) that holds g (nv) on the constraints that are there; false where there is none.
  bool hold(const double* g, double* tau) {
    const ChainArrays& a = arrays_;
    std::copy(a.J, a.J + J_.size(), J_.begin());
    for (std::size_t k = 0; k < out_.size(); ++k)
      if (out_[k]) std::fill(J_.begin() + std::ptrdiff_t(k * a.nv), J_.begin() + std::ptrdiff_t((k + 1) * a.nv), 0.0);
    return holding_ && holding_->torque(J_.data(), g, tau);
  }

  // The torque (n) that holds the robot up, and the inverse inertia (n) that each motor feels, from A and J of a
  // state at rest and its g; false where there is none.
  bool at_rest(const double* g, double* tau, double* felt) {
    const ChainArrays& a = arrays_;
    std::copy(a.A, a.A + a.nv * a.nv, a.factor);
    if (!hold(g, tau)) return false;
    if (elimination_->eliminate(a.factor, a.bias, a.J, a.gamma, a.tolerance, a.map, a.phi, a.Q, a.T, a.top) < 0)
      return false;
    for (std::size_t i = 0; i < a.n; ++i) felt[i] = a.phi[i * (a.n + 1)];
    return true;
  }

 private:
  static Asked rows(const Node& p, std::size_t n) {
    const std::size_t m = p.part("lower").size();
    return {static_cast<int>(m),         p.doubles("A", m * n), p.doubles("asked_lower", m),
            p.doubles("asked_upper", m), p.doubles("lower", m), p.doubles("upper", m)};
  }
  void share(const Node& p, std::size_t m) {
    const std::vector<int> first = p.places("first", m < 6 ? 0 : m - 5);
    const std::vector<double> middles = p.numbers("middles"), factors = p.numbers("factors");
    if (first.size() != 2 || middles.size() != 4 || factors.size() != 2) throw PlanError("a shared load is none");
    forces_->share({p.doubles("C", 6 * m),
                    {first[0], first[1]},
                    {p.doubles("one", 9), p.doubles("other", 9)},
                    {{middles[0], middles[1]}, {middles[2], middles[3]}},
                    {factors[0], factors[1]},
                    p.number("arm"),
                    p.doubles("share", 1)});
  }

  std::vector<std::int8_t> out_;  // of the constraints, 1 where one is not there
  std::vector<double> J_;         // of those that are
  std::unique_ptr<Elimination> elimination_;
  std::unique_ptr<TorqueRows> rows_;
  std::unique_ptr<ForceRows> forces_;
  std::unique_ptr<Chain> chain_;
  std::unique_ptr<Holding> holding_;
  ChainArrays arrays_{};
};

}  // namespace hqp
