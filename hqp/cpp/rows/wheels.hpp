// Wheels on the ground; see tasks/wheel.py for the rows and hqp/declare/readable.py for the plane a wheel is held on.
#pragma once

#include "rows.hpp"

namespace hqp {

class Wheel final : public Operation, Rows {
 public:
  // picked: some of rolling, lateral and normal, which is last.  aligned: sine below which an axle is along the normal.
  Wheel(Rows rows, double radius, Vec3 axle, std::vector<int> picked, double aligned)
      : Rows(std::move(rows)), radius_(radius), axle_(axle), picked_(std::move(picked)), aligned_(aligned) {}
  void run(const double*, const double*) override {
    const Vec3 p = origin(), n = load(out_.normal), axle = rotation() * axle_;
    settle(load(out_.reference), n, p);
    const Vec3 across = cross(n, axle);
    const double length = std::sqrt(dot(across, across)), scale = length > aligned_ ? 1.0 / length : 0.0;
    const Vec3 rolling = scale * across, directions[3] = {rolling, cross(rolling, n), n};
    const Vec3 contact = p - radius_ * n;
    for (std::size_t i = 0; i < picked_.size(); ++i) write_velocity(i, directions[picked_[i]], contact);
    out_.error[picked_.size() - 1] = dot(n, p - anchor_);
    if (!out_.drift) return;
    // The contact point is always straight below the centre: delta stays, while the directions turn with the axle.
    const Vec3 slip = motion().at(contact), delta = -radius_ * n, &omega = motion().angular;
    const Vec3 drift = tree_.point_drift(frame_.body, p) + cross(body_drift().angular, delta);
    const Vec3 turning = cross(n, cross(omega, axle));
    const Vec3 rate = scale * (turning - dot(rolling, turning) * rolling);
    const Vec3 rates[3] = {rate, cross(rate, n), {0.0, 0.0, 0.0}};
    for (std::size_t i = 0; i < picked_.size(); ++i)
      out_.drift[i] = dot(directions[picked_[i]], drift) + dot(rates[picked_[i]], slip);
  }
  bool hold(const double*, const double*, double* value) override {
    const Vec3 p = origin();
    for (int i = 0; i < 3; ++i) value[i] = p[i];
    return true;
  }
  void keep(CarryOver& state) override {
    state.take(placed_);
    state.take(value_), state.take(anchor_), state.take(plane_);
  }

 private:
  static bool same(const Vec3& a, const Vec3& b) { return a[0] == b[0] && a[1] == b[1] && a[2] == b[2]; }

  // A new value is a new place of the plane; a change of the normal alone tilts the plane about the wheel. An invalid
  // normal makes this tick's error NaN, and keeps the plane.
  void settle(const Vec3& value, const Vec3& n, const Vec3& p) {
    const bool finite = std::isfinite(n[0] + n[1] + n[2]);
    if (!placed_ || !same(value, value_)) {
      value_ = anchor_ = value;
      placed_ = true;
    } else if (finite && !same(n, plane_)) {
      anchor_ = p - dot(plane_, p - anchor_) * n;
    }
    if (finite) plane_ = n;
  }

  double radius_;
  Vec3 axle_;
  std::vector<int> picked_;
  double aligned_;
  bool placed_ = false;
  Vec3 value_{}, anchor_{}, plane_{0.0, 0.0, 1.0};
};

}  // namespace hqp
