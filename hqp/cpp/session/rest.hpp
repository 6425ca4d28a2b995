// Coming to rest: what a session sends while no answer is usable; the equations of hqp/loop/rest.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "node.hpp"

namespace hqp {

class Rest {
 public:
  virtual ~Rest() = default;
  // From the last good state, null where there was none, and the last x; now: whether the state is this tick's.
  virtual void begin(const double* q, const double* v, const double* x, bool now) = 0;
  virtual void next(double* x) = 0;
};

// The fastest of the joints, of all coordinates where none moves.
class Fastest {
 public:
  explicit Fastest(std::vector<int> joints) : joints_(std::move(joints)) {}
  double of(const std::vector<double>& x, bool or_all) const {
    double most = 0.0;
    for (const int j : joints_) most = std::max(most, std::fabs(x[static_cast<std::size_t>(j)]));
    if (most > 0.0 || !or_all) return most;
    for (const double number : x) most = std::max(most, std::fabs(number));
    return most;
  }

 private:
  std::vector<int> joints_;
};

// Velocity level: x shrinks by a common factor, and joints stop at their limits.
class SlowDown final : public Rest {
 public:
  SlowDown(const Node& robot, double deceleration, double dt, const Kinematics& kinematics)
      : step_(deceleration * dt),
        dt_(dt),
        low_(robot.numbers("lower")),
        high_(robot.numbers("upper")),
        fastest_(robot.ints("actuated")),
        kinematics_(kinematics),
        x_(low_.size()),
        angles_(low_.size()) {}

  void begin(const double* q, const double*, const double* x, bool now) override {
    if (!q) {
      std::fill(x_.begin(), x_.end(), 0.0);
      return;
    }
    std::copy(x, x + x_.size(), x_.begin());
    kinematics_.angles(q, angles_.data());
    for (std::size_t i = 0; !now && i < x_.size(); ++i) angles_[i] = angles_[i] + dt_ * x[i];
  }
  void next(double* x) override {
    const double fastest = fastest_.of(x_, true), factor = fastest > step_ ? std::max(0.0, 1.0 - step_ / fastest) : 0.0;
    for (std::size_t i = 0; i < x_.size(); ++i) {
      const double down = std::min((low_[i] - angles_[i]) / dt_, 0.0),
                   up = std::max((high_[i] - angles_[i]) / dt_, 0.0);
      x_[i] = std::min(std::max(x_[i] * factor, down), up);
      angles_[i] += dt_ * x_[i];
      x[i] = x_[i];
    }
  }

 private:
  double step_, dt_;
  std::vector<double> low_, high_;
  Fastest fastest_;
  const Kinematics& kinematics_;
  std::vector<double> x_, angles_;
};

// Acceleration level: qdd = -v min(1 / dt, a / max_i |v_i|), v estimated from the last good state on.
class Brake final : public Rest {
 public:
  Brake(const Node& robot, double deceleration, double dt)
      : most_(deceleration), dt_(dt), fastest_(robot.ints("actuated")), v_(std::size_t(robot.integer("nv"))) {}

  void begin(const double* q, const double* v, const double* x, bool now) override {
    for (std::size_t i = 0; i < v_.size(); ++i) v_[i] = q ? v[i] + (now ? 0.0 : dt_) * x[i] : 0.0;
  }
  void next(double* x) override {
    const double fastest = fastest_.of(v_, false);
    const double share = std::min(1.0 / dt_, fastest > 0.0 ? most_ / fastest : 0.0);
    for (std::size_t i = 0; i < v_.size(); ++i) {
      x[i] = -v_[i] * share;
      v_[i] += dt_ * x[i];
    }
  }

 private:
  double most_, dt_;
  Fastest fastest_;
  std::vector<double> v_;
};

}  // namespace hqp
