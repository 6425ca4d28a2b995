// Coming to rest: what a session sends while no answer is usable; the equations of hqp/loop/rest.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "line.hpp"

namespace hqp {

class Rest {
 public:
  virtual ~Rest() = default;
  // From the last good state, null where there was none, and the last x; now: whether the state is this tick's.
  virtual void begin(const double* q, const double* v, const double* x, bool now) = 0;
  virtual void next(double* x) = 0;
  virtual void keep(CarryOver& state) = 0;
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
  void keep(CarryOver& state) override {
    state.take(x_.data(), x_.size());
    state.take(angles_.data(), angles_.size());
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
  void keep(CarryOver& state) override { state.take(v_.data(), v_.size()); }

 private:
  double most_, dt_;
  Fastest fastest_;
  std::vector<double> v_;
};

// Torque level: tau = tau_g(q) - D qd within the effort limits, qd fading; the equations of hqp/torque/rest.py.
class Hold final : public Rest {
 public:
  Hold(const Node& robot, double damping, Line& line)
      : line_(line), actuated_(robot.ints("actuated")), dt_(line.dt()), still_(std::size_t(line.nv()), 0.0) {
    const std::vector<double> limit = robot.numbers("effort_limit");
    const std::size_t n = actuated_.size();
    for (const int i : actuated_) limit_.push_back(limit.at(std::size_t(i)));
    time_ = std::max(damping, double(n) * dt_);
    holding_.resize(n), damping_.resize(n), rate_.resize(n), felt_.resize(n);
  }

  void begin(const double* q, const double* v, const double* x, bool) override {
    const std::size_t n = limit_.size();
    std::fill(rate_.begin(), rate_.end(), 0.0);
    std::fill(damping_.begin(), damping_.end(), 0.0);
    if (!q || !look(q, v)) std::copy(x, x + n, holding_.begin());
  }
  void next(double* x) override {
    for (std::size_t i = 0; i < limit_.size(); ++i) {
      x[i] = std::min(std::max(holding_[i] - damping_[i] * rate_[i], -limit_[i]), limit_[i]);
      rate_[i] *= std::max(0.0, 1.0 - dt_ / time_);
    }
  }
  void keep(CarryOver& state) override {
    for (std::vector<double>* part : {&holding_, &damping_, &rate_}) state.take(part->data(), part->size());
  }

 private:
  bool look(const double* q, const double* v) {
    line_.kinematics().update(q);
    line_.assembly().operate(q, still_.data());
    if (!line_.torque()->at_rest(holding_.data(), felt_.data())) return false;
    double largest = 0.0, sum = 0.0;
    for (const double felt : felt_) largest = std::max(largest, felt);
    for (std::size_t i = 0; i < felt_.size(); ++i) {
      const bool locked = felt_[i] <= 1e-9 * largest;  // motors that the constraints lock need no damping
      damping_[i] = locked ? 0.0 : 1.0 / (time_ * felt_[i]);
      rate_[i] = v[actuated_[i]];
      sum += holding_[i] * holding_[i] + damping_[i] * damping_[i];
    }
    if (sum < std::numeric_limits<double>::infinity()) return true;
    std::fill(rate_.begin(), rate_.end(), 0.0);
    std::fill(damping_.begin(), damping_.end(), 0.0);
    return false;
  }

  Line& line_;
  std::vector<int> actuated_;
  double dt_, time_ = 0.0;
  std::vector<double> still_, limit_, holding_, damping_, rate_, felt_;
};

}  // namespace hqp
