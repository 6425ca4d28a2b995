// Inertias of bodies and of all that they carry, about the world's origin.
#pragma once

#include <array>

#include "spatial.hpp"

namespace hqp {

using BodyInertia = std::array<double, 6>;  // xx, yy, zz, xy, xz, yz about a body's centre of mass, in its axes

inline Mat3 turned(const Mat3& R, const BodyInertia& I) {  // R I R^T
  const Mat3 own{{{I[0], I[3], I[4]}, {I[3], I[1], I[5]}, {I[4], I[5], I[2]}}}, half = R * own;
  Mat3 found;
  for (int k = 0; k < 3; ++k)
    found.column[k] =
        R.column[0][k] * half.column[0] + R.column[1][k] * half.column[1] + R.column[2][k] * half.column[2];
  return found;
}

inline Form operator+(const Form& a, const Form& b) { return {a.linear + b.linear, a.angular + b.angular}; }

struct Inertia {  // mass, mass times centre, moments about the origin
  double mass = 0.0;
  Vec3 moment{};
  Mat3 about{};

  static Inertia of(double mass, const Vec3& p, const Mat3& own) {
    Inertia found{mass, mass * p, own};
    const double square = dot(p, p);
    for (int k = 0; k < 3; ++k) {
      found.about.column[k] = found.about.column[k] - (mass * p[k]) * p;
      found.about.column[k][k] += mass * square;
    }
    return found;
  }

  // Its rate while the body moves with V.
  static Inertia rate(double mass, const Vec3& p, const Mat3& own, const Motion& V) {
    const Vec3 change = V.at(p);
    Inertia found{0.0, mass * change, {}};
    const double square = 2.0 * dot(p, change);
    for (int k = 0; k < 3; ++k) {
      const Vec3 e = axis(k);  // w x own - own x w
      found.about.column[k] =
          cross(V.angular, own.column[k]) - own * cross(V.angular, e) - (mass * p[k]) * change - (mass * change[k]) * p;
      found.about.column[k][k] += mass * square;
    }
    return found;
  }

  void add(const Inertia& other) {
    mass += other.mass;
    moment = moment + other.moment;
    for (int k = 0; k < 3; ++k) about.column[k] = about.column[k] + other.about.column[k];
  }

  Form operator*(const Motion& V) const {  // momentum
    return {mass * V.linear + cross(V.angular, moment), about * V.angular + cross(moment, V.linear)};
  }
};

}  // namespace hqp
