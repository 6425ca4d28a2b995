// The terms of A qdd + b + g = the forces of motors and of contacts.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "composite.hpp"

namespace hqp {

class EquationOfMotion {
 public:
  // rotors: reflected inertia of each coordinate. A (nv, nv) column-major, whose upper triangle is written, zero
  // between branches; bias: b + g (nv,). Payloads are not included.
  EquationOfMotion(const Tree& tree, std::vector<BodyInertia> inertias, std::vector<double> rotors, const Vec3& gravity,
                   double* A, double* bias)
      : bodies_(tree, std::move(inertias)), rotors_(std::move(rotors)), gravity_(gravity), A_(A), bias_(bias) {
    const std::size_t n = tree.size();
    if (rotors_.size() != n) throw std::invalid_argument("a rotor for every coordinate is needed");
    std::fill(A_, A_ + n * n, 0.0);
  }

  // After the tree's motions. About the first body's place: rounding grows with the square of the distance to it.
  void run() {
    const Tree& tree = bodies_.tree();
    const auto& bodies = tree.bodies();
    bodies_.gather(bodies.size() > 1 ? load(bodies[1].position) : Vec3{}, true, false);
    bodies_.write_inertia(rotors_.data(), A_, heavier_);
    bodies_.write_forces(gravity_, bias_, heavier_);
  }
  // Masses of the bodies from now on over those given.
  void weigh(double heavier) { heavier_ = heavier; }

  // g (nv) alone, after run().
  void weight(double* g) const {
    const auto& bodies = bodies_.tree().bodies();
    for (int b = 1; b < static_cast<int>(bodies.size()); ++b) {
      const Form force = -heavier_ * bodies_.weight(b, gravity_);
      for (int c = bodies[b].first; c < bodies[b].first + bodies[b].count; ++c) g[c] = value(force, bodies_.twist(c));
    }
  }

  const Vec3& gravity() const { return gravity_; }
  double* inertia() { return A_; }
  double* bias() { return bias_; }

 private:
  Composite bodies_;
  std::vector<double> rotors_;
  Vec3 gravity_;
  double *A_, *bias_, heavier_ = 1.0;
};

}  // namespace hqp
