// Base of a legged robot from an IMU, encoders and feet that stand still. See estimation/feet.py for the equations.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "feet_kinematics.hpp"
#include "plane.hpp"

namespace hqp {

inline Mat3 about_vertical(double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {{{c, s, 0.0}, {-s, c, 0.0}, {0.0, 0.0, 1.0}}};
}
inline Mat3 exponential(const Vec3& w) {
  const double square = dot(w, w), angle = std::sqrt(square);
  const double a = angle > 1e-9 ? std::sin(angle) / angle : 1.0;
  const double b = angle > 1e-9 ? (1.0 - std::cos(angle)) / square : 0.5;
  const double xy = b * w[0] * w[1], xz = b * w[0] * w[2], yz = b * w[1] * w[2];
  const Vec3 t = a * w;
  return {{{1.0 - b * (w[1] * w[1] + w[2] * w[2]), xy + t[2], xz - t[1]},
           {xy - t[2], 1.0 - b * (w[0] * w[0] + w[2] * w[2]), yz + t[0]},
           {xz + t[1], yz - t[0], 1.0 - b * (w[0] * w[0] + w[1] * w[1])}}};
}
// Rotation of a quaternion (x, y, z, w) of any nonzero length.
inline Mat3 rotation_of(const double* quaternion) {
  const double x = quaternion[0], y = quaternion[1], z = quaternion[2], w = quaternion[3];
  const double s = 2.0 / (x * x + y * y + z * z + w * w);
  return {{{1.0 - s * (y * y + z * z), s * (x * y + z * w), s * (x * z - y * w)},
           {s * (x * y - z * w), 1.0 - s * (x * x + z * z), s * (y * z + x * w)},
           {s * (x * z + y * w), s * (y * z - x * w), 1.0 - s * (x * x + y * y)}}};
}
// Unit quaternion (x, y, z, w) of a rotation.
inline void quaternion_of(const Mat3& R, double* found) {
  const auto m = [&](int i, int j) { return R.column[j][i]; };
  const double trace = m(0, 0) + m(1, 1) + m(2, 2);
  if (trace > 0.0) {
    const double w = 0.5 * std::sqrt(1.0 + trace), f = 0.25 / w;
    found[0] = f * (m(2, 1) - m(1, 2)), found[1] = f * (m(0, 2) - m(2, 0)), found[2] = f * (m(1, 0) - m(0, 1));
    found[3] = w;
  } else {
    int i = 0;
    if (m(1, 1) > m(i, i)) i = 1;
    if (m(2, 2) > m(i, i)) i = 2;
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    found[i] = 0.5 * std::sqrt(std::max(1.0 + m(i, i) - m(j, j) - m(k, k), 0.0));
    const double f = 0.25 / found[i];
    found[j] = f * (m(i, j) + m(j, i)), found[k] = f * (m(i, k) + m(k, i)), found[3] = f * (m(k, j) - m(j, k));
  }
  double square = 0.0;
  for (int i = 0; i < 4; ++i) square += found[i] * found[i];
  for (int i = 0; i < 4; ++i) found[i] /= std::sqrt(square);
}

class FeetEstimator {
 public:
  // p: joints, bodies and feet, and the constants of estimation/feet.py; q: configuration at the start.
  template <class Plan>
  FeetEstimator(const Plan& p, const double* q)
      : kinematics_(p.part("motion"), p.parts("feet"), p.integer("nv")),
        feet_(kinematics_.feet()),
        still_(std::size_t(kinematics_.nv()), 0.0),
        period_(p.number("period")),
        least_load_(p.number("least_load")),
        tilt_(period_ / p.number("tilt")),
        yaw_(period_ / p.number("yaw")),
        velocity_(period_ / p.number("velocity")),
        bias_(velocity_ / p.number("bias")),
        position_(period_ / p.number("position")),
        landed_(p.number("landed")),
        faint_(p.number("faint")),
        slips_(p.number("slips")),
        turns_(p.number("turns")),
        smooth_(p.number("smooth")),
        lost_(p.number("lost")),
        agree_(p.number("agree")),
        gravity_(p.vec3("gravity")),
        base_(rotation_of(q + 3)),
        p_(load(q)) {
    kinematics_.update(q, still_.data());
    for (std::size_t i = 0; i < feet_.size(); ++i)
      feet_[i].anchor = kinematics_.position(i), feet_[i].anchor_yaw = yaw_of(kinematics_.rotation(i));
  }

  int nq() const { return kinematics_.nq(); }
  int nv() const { return kinematics_.nv(); }
  std::size_t feet() const { return feet_.size(); }
  bool slipping(std::size_t foot) const {
    const Foot& one = feet_[foot];
    return one.moves && std::hypot(one.over_ground[0], one.over_ground[1]) > 0.5 * slips_;
  }

  // q, v: joints from encoders, orientation and angular velocity of the base from the IMU; found_q, found_v: with the
  // estimated base.  Measurements that are not finite leave the estimate as it is.
  void update(const double* q, const double* v, const double* specific_force, const double* loads, double* found_q,
              double* found_v) {
    std::copy(q, q + nq(), found_q), std::copy(v, v + nv(), found_v);
    if (finite(q + 3, nq() - 3) && finite(v + 3, nv() - 3) && finite(specific_force, 3)) {
      const double dt = period_;
      const Vec3 down = row(rotation_of(q + 3), 2), own = row(base_, 2);  // the vertical in the base's axes
      base_ = base_ * exponential(dt * load(v + 3) + tilt_ * cross(down, own));
      std::fill(found_q, found_q + 3, 0.0), std::fill(found_v, found_v + 3, 0.0);
      quaternion_of(base_, found_q + 3);
      kinematics_.update(found_q, found_v);
      for (std::size_t i = 0; i < feet_.size(); ++i) {
        Foot& foot = feet_[i];
        foot.place = kinematics_.position(i), foot.rate = kinematics_.velocity(i), foot.spin = kinematics_.turn(i);
        foot.yaw = yaw_of(kinematics_.rotation(i));
      }
      v_ = v_ + dt * (base_ * (load(specific_force) - offset_) + gravity_);
      p_ = p_ + dt * v_;
      stand(loads);
      hold();
      agree();
      lead_back();
    }
    for (int i = 0; i < 3; ++i) found_q[i] = p_[i];
    quaternion_of(base_, found_q + 3);
    const Vec3 own = transposed(base_, v_);
    for (int i = 0; i < 3; ++i) found_v[i] = own[i];
  }

 private:
  struct Foot {
    Vec3 anchor{}, place{}, rate{}, spin{};  // in the world; from the base; over the base; angular over the ground
    double anchor_yaw = 0.0, yaw = 0.0, contrary = 0.0, weight = 0.0;
    Vec3 over_ground{}, turning{};
    bool stands = true, moves = false;

    double turned() const { return wrapped(anchor_yaw - yaw); }
    void land(const Vec3& base) { anchor = base + place, anchor_yaw = yaw; }
  };

  static double length(const Vec3& x) { return std::sqrt(dot(x, x)); }
  static Vec3 row(const Mat3& R, int i) { return {R.column[0][i], R.column[1][i], R.column[2][i]}; }
  static bool finite(const double* x, int n) {
    double sum = 0.0;
    for (int i = 0; i < n; ++i) sum += 0.0 * x[i];
    return sum == 0.0;
  }
  // Weights of the feet that stand; one that has just landed gets its place.
  void stand(const double* loads) {
    for (std::size_t i = 0; i < feet_.size(); ++i) {
      Foot& foot = feet_[i];
      const bool loaded = loads[i] > least_load_;  // NaN is no load
      foot.contrary = loaded == foot.stands ? 0.0 : foot.contrary + period_;
      if (foot.contrary >= landed_) foot.stands = loaded, foot.contrary = 0.0, foot.land(p_);
      foot.weight = !foot.stands ? 0.0 : loaded ? std::max(loads[i] - least_load_, faint_) : faint_;
    }
    share();
  }
  // Weights without the feet that move over the ground; the fastest is found first, one in an update: it pulls at the
  // others.
  void hold() {
    const double follow = std::min(period_ / smooth_, 1.0);
    double fastest = 1.0;
    Foot* found = nullptr;
    bool bears = false, stands = false;
    for (Foot& foot : feet_) {
      if (!(foot.weight > 0.0)) {
        foot.over_ground = foot.turning = {}, foot.moves = false;
        continue;
      }
      foot.over_ground = foot.over_ground + follow * (v_ + foot.rate - foot.over_ground);
      foot.turning = foot.turning + follow * (foot.spin - foot.turning);
      const double speed = std::max(length(foot.over_ground) / slips_, length(foot.turning) / turns_);
      if (foot.moves && speed < 0.5) foot.moves = false, foot.land(p_);
      if (!foot.moves && speed > fastest) fastest = speed, found = &foot;
      bears = true;
    }
    if (found) found->moves = true;
    for (const Foot& foot : feet_) stands = stands || (foot.weight > 0.0 && !foot.moves);
    alone_ = stands ? 0.0 : alone_ + (bears ? period_ : 0.0);
    if (alone_ >= lost_) return believe();
    for (Foot& foot : feet_)
      if (foot.moves) foot.weight = 0.0;
    share();
  }
  // Let all feet stand where they are: the accelerometer is off by the velocity that it gained alone.
  void believe() {
    for (Foot& foot : feet_) foot.moves = false, foot.over_ground = foot.turning = {}, foot.land(p_);
    const Vec3 missed = -1.0 * rate() - v_;
    v_ = v_ + missed;
    offset_ = offset_ - (1.0 / alone_) * transposed(base_, missed);
    alone_ = 0.0;
  }
  // Lead the anchors to one base.  Their weighted mean stays, so that a foot that settles moves the base by no more
  // than its share of the load.
  void agree() {
    double turn = 0.0;
    Vec3 place{};
    for (const Foot& foot : feet_) {
      turn += foot.weight * foot.turned();
      place = place + foot.weight * (foot.anchor - foot.place);
    }
    const double follow = std::min(period_ / agree_, 1.0);
    for (Foot& foot : feet_) {
      if (!(foot.weight > 0.0)) continue;
      foot.anchor = foot.anchor + follow * (place - (foot.anchor - foot.place));
      foot.anchor_yaw += follow * (turn - foot.turned());
    }
  }
  Vec3 rate() const {  // mean velocity of the feet over the base
    Vec3 found{};
    for (const Foot& foot : feet_) found = found + foot.weight * foot.rate;
    return found;
  }
  void lead_back() {
    double all = 0.0, turn = 0.0;
    Vec3 place{};
    for (const Foot& foot : feet_) {
      all += foot.weight;
      turn += foot.weight * foot.turned();
      place = place + foot.weight * (foot.anchor - foot.place);
    }
    if (!(all > 0.0)) return;
    base_ = about_vertical(yaw_ * turn) * base_;
    const Vec3 missed = -1.0 * rate() - v_;
    v_ = v_ + velocity_ * missed;
    offset_ = offset_ - bias_ * transposed(base_, missed);
    p_ = p_ + position_ * (place - p_);
  }
  void share() {  // the weights have the sum 1, unless all are zero
    double total = 0.0;
    for (const Foot& foot : feet_) total += foot.weight;
    for (Foot& foot : feet_)
      if (total > 0.0) foot.weight /= total;
  }

  FeetKinematics kinematics_;
  std::vector<Foot> feet_;
  std::vector<double> still_;
  double period_, least_load_, tilt_, yaw_, velocity_, bias_, position_, landed_, faint_, slips_, turns_, smooth_,
      lost_, agree_;
  Vec3 gravity_;
  double alone_ = 0.0;  // time without a foot that stands [s]
  Mat3 base_;
  Vec3 p_, v_{}, offset_{};  // offset: estimated bias of the accelerometer, in the base's axes
};

}  // namespace hqp
