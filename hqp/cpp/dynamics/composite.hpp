// Subtree quantities of each body: composite inertias, and the rates of their momenta.
//
// Composite rigid bodies and recursive Newton-Euler (Featherstone, Rigid Body Dynamics Algorithms, 2008, tables 6.2 and
// 5.1) with every quantity about one point of space, in the world's axes: nothing is turned from body to body.
#pragma once

#include <stdexcept>
#include <utility>
#include <vector>

#include "inertia.hpp"
#include "tree.hpp"

namespace hqp {

class Composite {
 public:
  // inertias: inertias of all bodies.
  Composite(const Tree& tree, std::vector<BodyInertia> inertias)
      : tree_(tree),
        inertias_(std::move(inertias)),
        carried_(inertias_.size()),
        forces_(inertias_.size()),
        twists_(tree.size()) {
    if (inertias_.size() != tree_.bodies().size()) throw std::invalid_argument("an inertia for every body is needed");
  }

  // About `origin`. moving: with the rates of momenta; payloads: with the point masses on the bodies.
  void gather(const Vec3& origin, bool moving, bool payloads) {
    const auto& bodies = tree_.bodies();
    origin_ = origin;
    carried_[0] = {};
    forces_[0] = {};
    for (int i = 1; i < static_cast<int>(bodies.size()); ++i) {
      const Body& body = bodies[i];
      const Mat3 R = load_rotation(body.rotation);
      const Vec3 p = load(body.position) + R * body.centre;
      const Symmetric own = turned(R, inertias_[i]);
      carried_[i] = Inertia::of(body.mass, p - origin, own);
      if (moving) forces_[i] = rate(i, body.mass, p, own);
    }
    if (payloads)
      for (const Carried& load : tree_.carried()) {
        carried_[load.body].add(Inertia::of(load.value[0], load.at() - origin, {}));
        if (moving) forces_[load.body] = forces_[load.body] + rate(load.body, load.value[0], load.at(), {});
      }
    for (int i = static_cast<int>(bodies.size()); i-- > 1;) {
      carried_[bodies[i].parent].add(carried_[i]);
      if (moving) forces_[bodies[i].parent] = forces_[bodies[i].parent] + forces_[i];
    }
    for (int c = 0; c < tree_.size(); ++c) twists_[c] = {twist_at(c, origin), load(tree_.twist(c) + 3)};
  }

  const Tree& tree() const { return tree_; }
  const BodyInertia& own(int body) const { return inertias_[body]; }
  const Vec3& origin() const { return origin_; }
  const Motion& twist(int column) const { return twists_[column]; }     // twist of a tangent coordinate
  const Inertia& operator[](int body) const { return carried_[body]; }  // inertia of the body's subtree
  const Form& momentum_rate(int body) const { return forces_[body]; }   // theirs, by the drifts of the tree
  Form weight(int body, const Vec3& g) const {
    const Inertia& all = carried_[body];
    return {all.mass * g, cross(all.moment, g)};
  }

  // Generalised forces (nv) of the rates of momenta less those of gravity: b + g, or A a + b + g without rotors.
  // heavier: masses of the bodies over those given.
  void write_forces(const Vec3& gravity, double* out, double heavier = 1.0) const {
    const auto& bodies = tree_.bodies();
    for (int b = 1; b < static_cast<int>(bodies.size()); ++b) {
      const Form force = heavier * (forces_[b] + -1.0 * weight(b, gravity));
      for (int c = bodies[b].first; c < bodies[b].first + bodies[b].count; ++c) out[c] = value(force, twists_[c]);
    }
  }

  // The joint-space inertia A (nv, nv), its upper triangle, column-major: entries of coordinates that carry one
  // another. rotors: reflected inertia of each coordinate; heavier: masses of the bodies over those given.
  void write_inertia(const double* rotors, double* A, double heavier = 1.0) const {
    const auto& bodies = tree_.bodies();
    for (int d = 0; d < tree_.size(); ++d) {
      const int body = tree_.owner(d);
      const Form F = heavier * (carried_[body] * twists_[d]);
      double* column = A + static_cast<std::ptrdiff_t>(d) * tree_.size();
      for (int b = body; b > 0; b = bodies[b].parent) {
        const Body& carrier = bodies[b];
        for (int c = carrier.first; c < carrier.first + carrier.count && c <= d; ++c) column[c] = value(F, twists_[c]);
      }
      column[d] += rotors[d];
    }
  }

 private:
  Form rate(int body, double mass, const Vec3& p, const Symmetric& own) const {
    const Vec3 force = mass * tree_.point_drift(body, p), &w = tree_.motion(body).angular;
    return {force, cross(p - origin_, force) + own * tree_.drift(body).angular + cross(w, own * w)};
  }
  Vec3 twist_at(int column, const Vec3& p) const {
    return load(tree_.twist(column)) + cross(load(tree_.twist(column) + 3), p);
  }

  const Tree& tree_;
  std::vector<BodyInertia> inertias_;
  Vec3 origin_{};
  std::vector<Inertia> carried_;
  std::vector<Form> forces_;
  std::vector<Motion> twists_;
};

}  // namespace hqp
