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
  std::vector<double> low, high, speed;
  double acceleration;  // infinite for none
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
      double up = towards(l.high[i] - at, l.speed[i]), down = -towards(at - l.low[i], l.speed[i]);
      if (std::isfinite(l.acceleration)) {
        const double reach = l.acceleration * l.dt;
        down = std::min(std::max(down, rate - reach), rate + reach);
        up = std::min(std::max(up, rate - reach), rate + reach);
      }
      if (l.order == 2) {
        down = (down - rate) / l.dt;
        up = (up - rate) / l.dt;
      }
      lower_[i] = down;
      upper_[i] = up;
    }
  }

 private:
  double towards(double way, double speed) const {  // largest speed towards a limit that is `way` off
    const Limits& l = limits_;
    if (way < 0.0) return std::max(way / l.dt, -std::min(speed, l.return_velocity));
    double most = way / l.dt;
    if (std::isfinite(l.acceleration))
      most = l.acceleration * (std::sqrt(l.dt * l.dt + 2.0 * way / l.acceleration) - l.dt);
    return std::min(most, speed);
  }

  double *lower_, *upper_;
  Limits limits_;
};

}  // namespace hqp
