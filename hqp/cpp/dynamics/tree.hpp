// The kinematic tree: velocities and drifts of its bodies, centres of mass of its subtrees.
#pragma once

#include <utility>
#include <vector>

#include "spatial.hpp"

namespace hqp {

struct Body {  // a link and the joint that carries it; the first of a tree is the world, which carries the others
  int parent;
  int first, count;  // tangent coordinates of the joint
  double mass;
  Vec3 centre;                        // centre of mass, in the body's axes
  const double *position, *rotation;  // live placement, the rotation column-major
};

struct Carried {  // a point mass on a body; the placement of its frame and value are live
  int body;
  const double *position, *rotation;
  const double* value;  // mass, and where in the frame's axes

  Vec3 at() const { return load(position) + load_rotation(rotation) * load(value + 1); }
};

class Tree {
 public:
  Tree(std::vector<Body> bodies, const double* twists)
      : bodies_(std::move(bodies)),
        twists_(twists),
        motions_(bodies_.size()),
        drifts_(bodies_.size()),
        centres_(bodies_.size()),
        own_(bodies_.size()),
        masses_(bodies_.size()),
        moments_(bodies_.size()) {
    for (std::size_t i = bodies_.size(); i-- > 0;) {
      own_[i] = bodies_[i].mass;
      masses_[i] += own_[i];
      if (i > 0) masses_[bodies_[i].parent] += masses_[i];
    }
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const Body& body = bodies_[i];
      if (static_cast<int>(owners_.size()) < body.first + body.count) owners_.resize(body.first + body.count);
      for (int c = body.first; c < body.first + body.count; ++c) owners_[c] = static_cast<int>(i);
    }
  }

  void need_motions() { moving_ = true; }
  void need_centres() { weighing_ = true; }
  void carry(Carried load) { carried_.push_back(load); }

  // Parents come before their children. A joint's own twists turn with its body: dJ_i/dt = V_i x J_i.
  // a: acceleration (nv) that drifts include, null for none.
  void update(const double* v, const double* a = nullptr) {
    const std::size_t n = bodies_.size();
    for (std::size_t i = 1; moving_ && i < n; ++i) {
      const Body& body = bodies_[i];
      Motion own{};
      for (int c = body.first; c < body.first + body.count; ++c)
        own = own + Motion{v[c] * load(twist(c)), v[c] * load(twist(c) + 3)};
      motions_[i] = motions_[body.parent] + own;
      drifts_[i] = drifts_[body.parent] + cross(motions_[i], own);
      for (int c = body.first; a && c < body.first + body.count; ++c)
        drifts_[i] = drifts_[i] + Motion{a[c] * load(twist(c)), a[c] * load(twist(c) + 3)};
    }
    for (std::size_t i = 1; weighing_ && i < n; ++i) {
      const Body& body = bodies_[i];
      centres_[i] = load(body.position) + load_rotation(body.rotation) * body.centre;
      moments_[i] = body.mass * centres_[i];
    }
    if (weighing_) moments_[0] = {};
    if (weighing_ && !carried_.empty()) take_up();
    for (std::size_t i = n; weighing_ && i-- > 1;)
      moments_[bodies_[i].parent] = moments_[bodies_[i].parent] + moments_[i];
  }

  int size() const { return static_cast<int>(owners_.size()); }           // tangent coordinates
  int owner(int column) const { return owners_[column]; }                 // the body it moves
  const double* twist(int column) const { return twists_ + 6 * column; }  // (6,) of one tangent coordinate
  const std::vector<Body>& bodies() const { return bodies_; }
  const std::vector<Carried>& carried() const { return carried_; }

  const Motion& motion(int body) const { return motions_[body]; }
  // Rate of the motion, at zero acceleration unless given.
  const Motion& drift(int body) const { return drifts_[body]; }
  Vec3 point_drift(int body, const Vec3& p) const {
    return drifts_[body].at(p) + cross(motions_[body].angular, motions_[body].at(p));
  }

  double own_mass(int body) const { return own_[body]; }         // mass of the body with its payloads
  double mass(int body) const { return masses_[body]; }          // mass of the body's subtree
  const Vec3& moment(int body) const { return moments_[body]; }  // their mass times their centre
  const Vec3& centre(int body) const { return centres_[body]; }  // mass centre of the body with its payloads
  bool carries(int carrier, int body) const {
    while (body > carrier) body = bodies_[body].parent;
    return body == carrier;
  }

 private:
  void take_up() {  // compute masses and centres of the subtrees
    for (std::size_t i = 0; i < bodies_.size(); ++i) own_[i] = bodies_[i].mass;
    for (const Carried& load : carried_) {
      const Vec3 p = load.at();
      const int b = load.body;
      own_[b] += load.value[0];
      moments_[b] = moments_[b] + load.value[0] * p;
      if (own_[b] != 0.0) centres_[b] = (1.0 / own_[b]) * moments_[b];
    }
    masses_ = own_;
    for (std::size_t i = bodies_.size(); i-- > 1;) masses_[bodies_[i].parent] += masses_[i];
  }

  std::vector<Body> bodies_;
  const double* twists_;  // (6, nv) column-major
  std::vector<Motion> motions_, drifts_;
  std::vector<Vec3> centres_;
  std::vector<Carried> carried_;
  std::vector<double> own_, masses_;
  std::vector<Vec3> moments_;
  std::vector<int> owners_;
  bool moving_ = false, weighing_ = false;
};

}  // namespace hqp
