// Coming to rest: the command without a usable answer.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "../common/carry_over.hpp"

namespace hqp {

// The state that a robot comes to rest from; all null if there was none.
struct RestFrom {
  const double *angles = nullptr, *v = nullptr;  // (nv)
  // Torque level: the torques (n) that hold the robot up [N m] and its momentum [N m s]; null if unknown.
  const double *holding = nullptr, *momentum = nullptr;
};

// Answers x that bring a robot to rest from the last good tick on; every number is finite.
class Rest {
 public:
  virtual ~Rest() = default;
  // From the last good state and the last x; now: true if the state is this tick's, else x was sent in it.
  virtual void begin(const RestFrom& from, const double* x, bool now) = 0;
  virtual void next(double* x) = 0;
  virtual void keep(CarryOver& state) = 0;
  virtual std::unique_ptr<Rest> copy() const = 0;
  // Go on as another one of the kind.
  virtual void follow(const Rest& other) = 0;
  std::size_t size() const { return size_; }

 protected:
  explicit Rest(std::size_t size) : size_(size) {}
  // The fastest of the joints, of all coordinates if none moves.
  static double fastest(const std::vector<double>& x, const std::vector<int>& joints) {
    double most = 0.0;
    for (const int j : joints) most = std::max(most, std::fabs(x[static_cast<std::size_t>(j)]));
    for (std::size_t i = 0; most == 0.0 && i < x.size(); ++i) most = std::max(most, std::fabs(x[i]));
    return most;
  }

 private:
  std::size_t size_;
};

template <class Own>
class Copied : public Rest {
 public:
  std::unique_ptr<Rest> copy() const override { return std::make_unique<Own>(static_cast<const Own&>(*this)); }
  void follow(const Rest& other) override { static_cast<Own&>(*this) = dynamic_cast<const Own&>(other); }

 protected:
  using Rest::Rest;
};

// Velocity level: x+ = x max(0, 1 - a dt / max_i |x_i|) over the joints, a common factor, so that J x = 0 of contacts
// stays true; a joint whose estimated position would pass its limit stops there.
class SlowDown final : public Copied<SlowDown> {
 public:
  SlowDown(std::vector<double> low, std::vector<double> high, std::vector<int> joints, double deceleration, double dt)
      : Copied(low.size()),
        step_(deceleration * dt),
        dt_(dt),
        low_(std::move(low)),
        high_(std::move(high)),
        joints_(std::move(joints)),
        x_(low_.size()),
        angles_(low_.size()) {}

  void begin(const RestFrom& from, const double* x, bool now) override {
    placed_ = from.angles != nullptr;
    for (std::size_t i = 0; i < x_.size(); ++i) {
      x_[i] = x[i];
      if (placed_) angles_[i] = from.angles[i] + (now ? 0.0 : dt_ * x[i]);
    }
  }
  void next(double* x) override {
    const double most = fastest(x_, joints_), factor = most > step_ ? std::max(0.0, 1.0 - step_ / most) : 0.0;
    for (std::size_t i = 0; i < x_.size(); ++i) {
      if (!placed_) {
        x[i] = x_[i] *= factor;
        continue;
      }
      // the last way to a limit and no further; back from beyond a limit is not its business
      const double down = std::min((low_[i] - angles_[i]) / dt_, 0.0),
                   up = std::max((high_[i] - angles_[i]) / dt_, 0.0);
      x_[i] = std::min(std::max(x_[i] * factor, down), up);
      angles_[i] += dt_ * x_[i];
      x[i] = x_[i];
    }
  }
  void keep(CarryOver& state) override {
    state.take(placed_);
    state.take(x_.data(), x_.size());
    state.take(angles_.data(), angles_.size());
  }

 private:
  double step_, dt_;
  std::vector<double> low_, high_;
  std::vector<int> joints_;
  std::vector<double> x_, angles_;
  bool placed_ = false;  // true if the angles are known
};

// Acceleration level: qdd = -v min(1 / dt, a / max_i |v_i|), v estimated from the last good state on.
class Brake final : public Copied<Brake> {
 public:
  Brake(std::size_t nv, std::vector<int> joints, double deceleration, double dt)
      : Copied(nv), most_(deceleration), dt_(dt), joints_(std::move(joints)), v_(nv) {}

  void begin(const RestFrom& from, const double* x, bool now) override {
    for (std::size_t i = 0; i < v_.size(); ++i) v_[i] = from.v ? from.v[i] + (now ? 0.0 : dt_) * x[i] : 0.0;
  }
  void next(double* x) override {
    const double most = fastest(v_, joints_), share = std::min(1.0 / dt_, most > 0.0 ? most_ / most : 0.0);
    for (std::size_t i = 0; i < v_.size(); ++i) {
      x[i] = -v_[i] * share;
      v_[i] += dt_ * x[i];
    }
  }
  void keep(CarryOver& state) override { state.take(v_.data(), v_.size()); }

 private:
  double most_, dt_;
  std::vector<int> joints_;
  std::vector<double> v_;
};

// Torque level: tau = tau_g(q) - tau_v / T within the effort limits, T = max(damping, 2 dt).
//
// tau_v holds the momentum A qd as tau_g holds gravity, so that every joint slows down by qd / T with any load,
// while contacts hold; T is long enough that it never overshoots within one period. q is that of the last good state;
// tau_v as well, fading with T, for damping by an old velocity would push. If the dynamics fail, from the last
// torque.
class Hold final : public Copied<Hold> {
 public:
  Hold(std::vector<double> limit, double damping, double dt)
      : Copied(limit.size()),
        limit_(std::move(limit)),
        dt_(dt),
        time_(std::max(damping, 2.0 * dt)),
        holding_(limit_.size()),
        damping_(limit_.size()) {}

  void begin(const RestFrom& from, const double* x, bool) override {
    if (from.holding && take(from)) return;
    std::copy(x, x + holding_.size(), holding_.begin());
    std::fill(damping_.begin(), damping_.end(), 0.0);
  }
  void next(double* x) override {
    for (std::size_t i = 0; i < limit_.size(); ++i) {
      x[i] = std::min(std::max(holding_[i] - damping_[i], -limit_[i]), limit_[i]);
      damping_[i] *= 1.0 - dt_ / time_;
    }
  }
  void keep(CarryOver& state) override {
    for (std::vector<double>* part : {&holding_, &damping_}) state.take(part->data(), part->size());
  }

 private:
  bool take(const RestFrom& from) {
    double sum = 0.0;
    for (std::size_t i = 0; i < limit_.size(); ++i) {
      holding_[i] = from.holding[i];
      damping_[i] = from.momentum[i] / time_;
      sum += std::fabs(holding_[i]) + std::fabs(damping_[i]);
    }
    return sum < std::numeric_limits<double>::infinity();
  }

  std::vector<double> limit_;
  double dt_, time_;
  std::vector<double> holding_, damping_;  // tau_g and tau_v / T [N m]
};

}  // namespace hqp
