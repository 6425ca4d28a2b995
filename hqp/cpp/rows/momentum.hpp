// Centroidal momentum, linear and about the centre of mass.
#pragma once

#include "../dynamics/composite.hpp"
#include "rows.hpp"

namespace hqp {

class Momentum final : public Operation {
 public:
  // picked: selected rows among linear x, y, z, angular x, y, z. inertias: inertias of all bodies.
  Momentum(Target out, const Tree& tree, std::vector<int> picked, std::vector<BodyInertia> inertias)
      : out_(out), tree_(tree), picked_(std::move(picked)), bodies_(tree, std::move(inertias)) {}

  void run(const double*, const double*) override {
    bodies_.gather((1.0 / tree_.mass(0)) * tree_.moment(0), out_.drift, true);
    for (int c = 0; c < tree_.size(); ++c) {
      const Form momentum = bodies_[tree_.owner(c)] * bodies_.twist(c);
      for (std::size_t i = 0; i < picked_.size(); ++i)
        out_.row(static_cast<int>(i))[c] = out_.weight * entry(momentum, picked_[i]);
    }
    for (std::size_t i = 0; out_.drift && i < picked_.size(); ++i)
      out_.drift[i] = entry(bodies_.momentum_rate(0), picked_[i]);
  }

 private:
  static double entry(const Form& a, int i) { return i < 3 ? a.linear[i] : a.angular[i - 3]; }

  Target out_;
  const Tree& tree_;
  std::vector<int> picked_;
  Composite bodies_;
};

}  // namespace hqp
