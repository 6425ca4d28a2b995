// Generalised forces of a motion, from a robot's joints and bodies alone.
#pragma once

#include <cstddef>
#include <vector>

#include "../dynamics/composite.hpp"
#include "../dynamics/kinematics.hpp"
#include "../rows/planned.hpp"

namespace hqp {

class InverseDynamics {
 public:
  // p: nv, joints, bodies with their inertias, rotors, twists and gravity of a plan.
  template <class Plan>
  explicit InverseDynamics(const Plan& p)
      : nv_(p.place("nv", std::size_t(kMost))),
        kinematics_(joints(p.part("joints"), nv_), {}, twists(p, nv_)),
        tree_(bodies(p.part("bodies"), nv_), twists(p, nv_)),
        bodies_(tree_, p.inertias("inertias")),
        rotors_(p.numbers("rotors", std::size_t(nv_))),
        gravity_(p.vec3("gravity")) {
    need(tree_.size() == nv_, "a robot's bodies have its coordinates");
    tree_.need_motions();
  }
  InverseDynamics(const InverseDynamics&) = delete;

  // A a + b + g (nv) into forces, about the first body's place as in EquationOfMotion.
  void run(const double* q, const double* v, const double* a, double* forces) {
    kinematics_.update(q);
    tree_.update(v, a);
    const auto& bodies = tree_.bodies();
    bodies_.gather(bodies.size() > 1 ? load(bodies[1].position) : Vec3{}, true, false);
    bodies_.write_forces(gravity_, forces);
    for (std::size_t c = 0; c < rotors_.size(); ++c) forces[c] += rotors_[c] * a[c];
  }
  const Kinematics& kinematics() const { return kinematics_; }
  int nv() const { return nv_; }

 private:
  template <class Plan>
  static double* twists(const Plan& p, int nv) {
    return p.doubles("twists", 6 * static_cast<std::size_t>(nv));
  }

  int nv_;
  Kinematics kinematics_;
  Tree tree_;
  Composite bodies_;
  std::vector<double> rotors_;
  Vec3 gravity_;
};

}  // namespace hqp
