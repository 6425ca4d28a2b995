// Positions, relations and limits of joints.
#pragma once

#include "rows.hpp"

namespace hqp {

class Joints final : public Operation {  // positions of single-axis joints; J is constant and not written
 public:
  Joints(Target out, std::vector<int> positions) : out_(out), positions_(std::move(positions)) {}
  void run(const double* q, const double*) override {
    for (std::size_t i = 0; i < positions_.size(); ++i) out_.error[i] = q[positions_[i]] - out_.reference[i];
  }

 private:
  Target out_;
  std::vector<int> positions_;
};

class Coupling final : public Operation {  // a linear relation of joints; J is constant and not written
 public:
  Coupling(Target out, std::vector<int> positions, std::vector<double> coefficients)
      : out_(out), positions_(std::move(positions)), coefficients_(std::move(coefficients)) {}
  void run(const double* q, const double*) override {
    double total = -out_.reference[0];
    for (std::size_t i = 0; i < positions_.size(); ++i) total += coefficients_[i] * q[positions_[i]];
    out_.error[0] = total;
  }

 private:
  Target out_;
  std::vector<int> positions_;
  std::vector<double> coefficients_;
};

struct Limits {  // of k joints; see JointLimits for the equations
  std::vector<int> positions, columns;
  std::vector<double> low, high, speed, acceleration, braking;  // infinite for none
  double return_velocity;
  double dt;
  int order;
};

class Box final : public Operation {  // one consistent box for the next step
 public:
  Box(double* lower, double* upper, Limits limits) : lower_(lower), upper_(upper), limits_(std::move(limits)) {}
  void run(const double* q, const double* v) override {
    const Limits& l = limits_;
    for (std::size_t i = 0; i < l.positions.size(); ++i) {
      const double at = q[l.positions[i]], rate = v[l.columns[i]];
      const double reach = l.acceleration[i] * l.dt;
      double up = clip(fastest(l.high[i] - at, i), rate - reach, rate + reach);
      double down = clip(-fastest(at - l.low[i], i), rate - reach, rate + reach);
      if (l.order == 2) {
        down = (down - rate) / l.dt;
        up = (up - rate) / l.dt;
      }
      lower_[i] = down;
      upper_[i] = up;
    }
  }

 private:
  static double clip(double u, double low, double high) { return std::min(std::max(u, low), high); }

  double fastest(double way, std::size_t i) const {  // velocity towards a limit that is `way` off, or back to it
    const Limits& l = limits_;
    const double off = std::fabs(way);
    double most = l.speed[i];
    if (std::isfinite(off))
      most = std::min(most, 2.0 * off / (std::sqrt(l.dt * l.dt + 2.0 * off / l.braking[i]) + l.dt));
    return way >= 0.0 ? most : -std::min(most, l.return_velocity);
  }

  double *lower_, *upper_;
  Limits limits_;
};

}  // namespace hqp
