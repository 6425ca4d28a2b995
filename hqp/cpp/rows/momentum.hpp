// Centroidal momentum, linear and about the centre of mass.
#pragma once

#include "inertia.hpp"
#include "rows.hpp"

namespace hqp {

class Momentum final : public Operation {
 public:
  // picked: of linear x, y, z, angular x, y, z. inertias: of all bodies.
  Momentum(Target out, const Tree& tree, std::vector<int> picked, std::vector<BodyInertia> inertias)
      : out_(out), tree_(tree), picked_(std::move(picked)), inertias_(std::move(inertias)), about_(inertias_.size()) {
    if (inertias_.size() != tree_.bodies().size()) throw std::invalid_argument("an inertia for every body is needed");
  }

  void run(const double*, const double*) override {
    const Vec3 centre = (1.0 / tree_.mass(0)) * tree_.moment(0);
    Vec3 drift[2] = {};
    gather(centre, drift);
    for (int c = 0; c < tree_.size(); ++c) {
      const int b = tree_.owner(c);
      const Vec3 v = load(tree_.twist(c)), w = load(tree_.twist(c) + 3), &h = tree_.moment(b);
      const Vec3 linear = tree_.mass(b) * v + cross(w, h);
      const Vec3 both[2] = {linear, about_[b] * w + cross(h, v) - cross(centre, linear)};
      for (std::size_t i = 0; i < picked_.size(); ++i)
        out_.row(static_cast<int>(i))[c] = out_.weight * both[picked_[i] / 3][picked_[i] % 3];
    }
    for (std::size_t i = 0; out_.drift && i < picked_.size(); ++i)
      out_.drift[i] = drift[picked_[i] / 3][picked_[i] % 3];
  }

 private:
  // Inertias of all that each body carries, about the world's origin; the rate of the momentum at zero acceleration.
  void gather(const Vec3& centre, Vec3* drift) {
    const auto& bodies = tree_.bodies();
    about_[0] = {};
    for (std::size_t i = 1; i < bodies.size(); ++i) {
      const Body& body = bodies[i];
      const Mat3 R = load_rotation(body.rotation), own = turned(R, inertias_[i]);
      const Vec3 p = load(body.position) + R * body.centre;
      about_[i] = own;
      add_point(static_cast<int>(i), body.mass, p, centre, drift);
      if (!out_.drift) continue;
      const Vec3 &w = tree_.motion(static_cast<int>(i)).angular, &a = tree_.drift(static_cast<int>(i)).angular;
      drift[1] = drift[1] + own * a + cross(w, own * w);
    }
    for (const Carried& load : tree_.carried()) add_point(load.body, load.value[0], load.at(), centre, drift);
    for (std::size_t i = bodies.size(); i-- > 1;)
      for (int k = 0; k < 3; ++k)
        about_[bodies[i].parent].column[k] = about_[bodies[i].parent].column[k] + about_[i].column[k];
  }
  void add_point(int body, double mass, const Vec3& p, const Vec3& centre, Vec3* drift) {
    const double square = dot(p, p);
    for (int k = 0; k < 3; ++k) {
      about_[body].column[k] = about_[body].column[k] - (mass * p[k]) * p;
      about_[body].column[k][k] += mass * square;
    }
    if (!out_.drift) return;
    const Vec3 rate = mass * tree_.point_drift(body, p);
    drift[0] = drift[0] + rate;
    drift[1] = drift[1] + cross(p - centre, rate);
  }

  Target out_;
  const Tree& tree_;
  std::vector<int> picked_;
  std::vector<BodyInertia> inertias_;
  std::vector<Mat3> about_;
};

}  // namespace hqp
