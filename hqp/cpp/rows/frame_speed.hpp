// Limits of a frame's speed along many directions. See tasks/frame_speed.py for the equations.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "rows.hpp"

namespace hqp {

class FrameSpeed final : public Operation, Rows {
 public:
  FrameSpeed(Rows rows, std::vector<Vec3> normals, double linear, double angular, double rate, double dt, int order)
      : Rows(std::move(rows)),
        normals_(std::move(normals)),
        linear_(linear),
        angular_(angular),
        share_(std::min(1.0, rate * dt)),
        dt_(dt),
        order_(order) {}
  void run(const double*, const double* v) override {
    const Vec3 p = origin();
    const Mat3 R = rotation();
    const Vec3 moving = body_drift().at(p),
               turning = body_drift().angular;  // drift of the body, whose rotation R follows
    int i = 0;
    if (std::isfinite(linear_))
      for (const Vec3& n : normals_) write_row(i++, along(R * n, p), dot(R * n, moving), linear_, v);
    if (std::isfinite(angular_))
      for (const Vec3& n : normals_) write_row(i++, about(R * n), dot(R * n, turning), angular_, v);
  }

 private:
  void write_row(int i, const Form& form, double drift, double most, const double* v) {
    write_form(i, form);
    double speed = 0.0;
    for (const int c : frame_.columns) speed += out_.row(i)[c] * v[c];
    speed /= out_.weight;
    if (order_ == 2) {
      out_.lower[i] = share_ / dt_ * (-most - speed) - drift;
      out_.upper[i] = share_ / dt_ * (most - speed) - drift;
      return;
    }
    // from a configuration to the mean over the tick before it or after it
    const double turn = 0.5 * dt_ * drift, mean = speed - turn;
    const double over = std::copysign((1.0 - share_) * std::max(std::abs(mean) - most, 0.0), mean);
    out_.lower[i] = std::min(over, 0.0) - most - turn;
    out_.upper[i] = std::max(over, 0.0) + most - turn;
  }

  std::vector<Vec3> normals_;  // in the frame's axes
  double linear_, angular_, share_, dt_;
  int order_;
};

}  // namespace hqp
