// Inertias of bodies and of all that they carry, about one point of space.
#pragma once

#include <array>

#include "spatial.hpp"

namespace hqp {

using BodyInertia = std::array<double, 6>;  // xx, yy, zz, xy, xz, yz about a body's centre of mass, in its axes

struct Symmetric {
  double xx, yy, zz, xy, xz, yz;
  Vec3 operator*(const Vec3& a) const {
    return {xx * a[0] + xy * a[1] + xz * a[2], xy * a[0] + yy * a[1] + yz * a[2], xz * a[0] + yz * a[1] + zz * a[2]};
  }
};

inline Symmetric operator+(const Symmetric& a, const Symmetric& b) {
  return {a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}

inline Symmetric turned(const Mat3& R, const BodyInertia& I) {  // R I R^T
  const Vec3 *r = R.column, x = I[0] * r[0] + I[3] * r[1] + I[4] * r[2], y = I[3] * r[0] + I[1] * r[1] + I[5] * r[2],
             z = I[4] * r[0] + I[5] * r[1] + I[2] * r[2];
  const auto entry = [&](int i, int j) { return x[i] * r[0][j] + y[i] * r[1][j] + z[i] * r[2][j]; };
  return {entry(0, 0), entry(1, 1), entry(2, 2), entry(0, 1), entry(0, 2), entry(1, 2)};
}

// 2 a.b - a b^T - b a^T.
inline Symmetric across(const Vec3& a, const Vec3& b) {
  const double xx = a[0] * b[0], yy = a[1] * b[1], zz = a[2] * b[2];
  return {2.0 * (yy + zz),
          2.0 * (xx + zz),
          2.0 * (xx + yy),
          -a[0] * b[1] - a[1] * b[0],
          -a[0] * b[2] - a[2] * b[0],
          -a[1] * b[2] - a[2] * b[1]};
}

struct Inertia {  // mass, mass times centre, moments about the point
  double mass = 0.0;
  Vec3 moment{};
  Symmetric about{};

  // p: the centre of mass, own: the moments about it.
  static Inertia of(double mass, const Vec3& p, const Symmetric& own) {
    return {mass, mass * p, own + across(0.5 * mass * p, p)};
  }

  // Its rate while the body turns with w and its centre moves with u.
  static Inertia rate(double mass, const Vec3& p, const Symmetric& own, const Vec3& w, const Vec3& u) {
    const Vec3 x = own * axis(0), y = own * axis(1), z = own * axis(2);  // w x own - own x w
    const Vec3 a = cross(w, x), b = cross(w, y), c = cross(w, z);
    const Symmetric turning{2.0 * a[0], 2.0 * b[1], 2.0 * c[2], a[1] + b[0], a[2] + c[0], b[2] + c[1]};
    return {0.0, mass * u, turning + across(mass * p, u)};
  }

  void add(const Inertia& other) {
    mass += other.mass;
    moment = moment + other.moment;
    about = about + other.about;
  }

  Form operator*(const Motion& V) const {  // momentum
    return {mass * V.linear + cross(V.angular, moment), about * V.angular + cross(moment, V.linear)};
  }
};

}  // namespace hqp
