// Positions, relations and limits of joints.
#pragma once

#include "rows.hpp"
#include "whole_turns.hpp"

namespace hqp {

struct Joints {  // single-axis joints; a continuous one has cosine and sine in q
  std::vector<int> columns, positions;
  std::vector<bool> continuous;

  std::size_t size() const { return columns.size(); }
  double angle(std::size_t i, const double* q) const {
    const double* at = q + positions[i];
    return continuous[i] ? std::atan2(at[1], at[0]) : at[0];
  }
  bool hold(const double* q, double* value) const {
    for (std::size_t i = 0; i < size(); ++i) value[i] = angle(i, q);
    return true;
  }
  // J is constant: one entry a row, written once.
  void write(const Target& out) const {
    for (std::size_t i = 0; out.J && i < size(); ++i) out.row(i)[columns[i]] = out.weight;
  }
};

class Posture final : public Operation {
 public:
  Posture(Target out, Joints joints) : out_(out), joints_(std::move(joints)) { joints_.write(out_); }
  void run(const double* q, const double*) override {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const double off = joints_.angle(i, q) - out_.reference[i];
      out_.error[i] = joints_.continuous[i] ? std::remainder(off, kTurn) : off;
    }
  }
  bool hold(const double* q, const double*, double* value) override { return joints_.hold(q, value); }

 private:
  Target out_;
  Joints joints_;
};

class Coupling final : public Operation {  // a linear relation of joints, see tasks/coupling.py
 public:
  Coupling(Target out, Joints joints, std::vector<double> coefficients)
      : out_(out), joints_(std::move(joints)), coefficients_(std::move(coefficients)), at_(joints_.size()) {
    std::vector<double> sizes;
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      if (out_.J) out_.J[joints_.columns[i]] = out_.weight * coefficients_[i];
      if (joints_.continuous[i]) turning_.push_back(i), sizes.push_back(coefficients_[i]);
    }
    turns_ = WholeTurns(std::move(sizes));
  }
  void run(const double* q, const double*) override {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const double angle = joints_.angle(i, q);
      const bool follows = begun_ && joints_.continuous[i];
      at_[i] = follows ? angle + kTurn * std::round((at_[i] - angle) / kTurn) : angle;
    }
    if (!begun_) {
      const std::vector<double>& turns = turns_.nearest(error());
      for (std::size_t k = 0; k < turning_.size(); ++k) at_[turning_[k]] += kTurn * turns[k];
      begun_ = std::isfinite(error());
    }
    out_.error[0] = error();
  }
  void begin() override { begun_ = false; }
  void keep(CarryOver& state) override { state.take(begun_), state.take(at_.data(), at_.size()); }

 private:
  double error() const {
    double total = -out_.reference[0];
    for (std::size_t i = 0; i < joints_.size(); ++i) total += coefficients_[i] * at_[i];
    return total;
  }

  Target out_;
  Joints joints_;
  std::vector<double> coefficients_, at_;  // positions of the joints, turns included
  std::vector<std::size_t> turning_;
  WholeTurns turns_{{}};
  bool begun_ = false;
};

class Still final : public Operation {  // coordinates whose velocity is wanted for itself: no error
 public:
  Still(const Target& out, const std::vector<int>& columns) {
    for (std::size_t i = 0; out.J && i < columns.size(); ++i) out.row(static_cast<int>(i))[columns[i]] = out.weight;
  }
  void run(const double*, const double*) override {}
};

class Steady final : public Operation {  // coordinates that go on as they did
 public:
  Steady(Target out, std::vector<int> columns, int order) : out_(out), columns_(std::move(columns)), order_(order) {
    for (std::size_t i = 0; out_.J && i < columns_.size(); ++i)
      out_.row(static_cast<int>(i))[columns_[i]] = out_.weight;
  }
  void run(const double*, const double* v) override {
    for (std::size_t i = 0; i < columns_.size(); ++i)
      out_.lower[i] = out_.upper[i] = order_ == 1 ? v[columns_[i]] : 0.0;
  }

 private:
  Target out_;
  std::vector<int> columns_;
  int order_;
};

class Prescribed final : public Operation {  // coordinates that another controller moves
 public:
  Prescribed(Target out, std::vector<int> columns, double dt, int order)
      : out_(out), columns_(std::move(columns)), dt_(dt), order_(order) {
    for (std::size_t i = 0; out_.J && i < columns_.size(); ++i)
      out_.row(static_cast<int>(i))[columns_[i]] = out_.weight;
  }
  void measure(const double* v) override { v_ = v; }
  void run(const double*, const double*) override {
    for (std::size_t i = 0; i < columns_.size(); ++i)
      out_.lower[i] = out_.upper[i] = order_ == 1 ? v_[columns_[i]] + dt_ * out_.feedforward[i] : out_.feedforward[i];
  }

 private:
  Target out_;
  std::vector<int> columns_;
  double dt_;
  int order_;
  const double* v_ = nullptr;  // velocity of the state, during a tick
};

class Frozen final : public Operation {  // joints that stay where they were
 public:
  Frozen(Target out, Joints joints, double rate, double acceleration, double dt, int order)
      : out_(out), joints_(std::move(joints)), rate_(rate), most_(acceleration), dt_(dt), order_(order) {
    joints_.write(out_);
  }
  void run(const double* q, const double* v) override {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      double e = joints_.angle(i, q) - out_.reference[i];
      if (joints_.continuous[i]) e = std::remainder(e, kTurn);
      const double u = v[joints_.columns[i]];
      const double x =
          order_ == 1 ? u + clip(-rate_ * e - u, most_ * dt_) : clip(-rate_ * (rate_ * e + 2.0 * u), most_);
      out_.lower[i] = out_.upper[i] = x;
    }
  }
  bool hold(const double* q, const double*, double* value) override { return joints_.hold(q, value); }

 private:
  static double clip(double x, double most) { return std::min(std::max(x, -most), most); }

  Target out_;
  Joints joints_;
  double rate_, most_, dt_;
  int order_;
};

struct Limits {  // limits of each joint, infinite for none; see JointLimits for the equations
  std::vector<double> low, high, speed, acceleration, braking;
  double approach, return_velocity, noise;  // approach [1/s], infinite for none; noise of measured rates [1/s]
  double dt;
  int order;
};

class JointBox final : public Operation {  // one consistent box for the next step
 public:
  JointBox(Target out, Joints joints, Limits limits)
      : out_(out), joints_(std::move(joints)), limits_(std::move(limits)), at_(joints_.size()) {
    joints_.write(out_);
  }
  void run(const double* q, const double* v) override {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      at_[i] = joints_.angle(i, q);
      bound(i, v[joints_.columns[i]]);
    }
  }
  double approach() const override { return limits_.order == 2 ? limits_.approach : INFINITY; }
  void around(const double* v, const double* braking) override {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      if (std::isinf(out_.lower[i]) && std::isinf(out_.upper[i])) continue;  // none, or free in this tick
      const int column = joints_.columns[i];
      bound(i, v[column]);
      for (double* side : {out_.lower, out_.upper}) side[i] = out_.weight * (side[i] - braking[column]);
    }
  }
  // For each joint max(0, dt (n |v| - a dt n (n + 1) / 2) - d), n = floor(|v| / (a dt)), with d the distance to the
  // limit ahead: the way of the velocities |v| - a dt, |v| - 2 a dt, ... Without a window it stops at once.
  void overrun(const double* q, const double* v, std::vector<double>& over) override {
    const Limits& l = limits_;
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const double at = joints_.angle(i, q), rate = v[joints_.columns[i]], speed = std::fabs(rate);
      const double reach = l.acceleration[i] * l.dt, steps = std::floor(speed / reach);
      const double way = steps > 0.0 ? l.dt * steps * (speed - reach * (steps + 1.0) / 2.0) : 0.0;
      over.push_back(way > 0.0 ? std::max(way - (rate > 0.0 ? l.high[i] - at : at - l.low[i]), 0.0) : 0.0);
    }
  }
  double outside(int i, const double* q, double& low, double& high) const override {
    low = limits_.low[i], high = limits_.high[i];
    const double at = joints_.angle(i, q);
    return std::max({low - at, at - high, 0.0});
  }

 private:
  static double clip(double u, double low, double high) { return std::min(std::max(u, low), high); }

  void bound(std::size_t i, double rate) const {
    const Limits& l = limits_;
    const double reach = l.acceleration[i] * l.dt, above = l.high[i] - at_[i], below = at_[i] - l.low[i];
    const double highest = fastest(above, i), lowest = -fastest(below, i);
    double up = gradual(above, highest, rate, i), down = -gradual(below, -lowest, -rate, i);
    up = std::max(up, std::min(highest, down));  // a gradual bound gives way where the two would cross
    down = std::min(down, std::max(lowest, up));
    up = clip(up, rate - reach, rate + reach);
    down = clip(down, rate - reach, rate + reach);
    if (l.order == 2) {
      down = (down - rate) / l.dt;
      up = (up - rate) / l.dt;
    }
    out_.lower[i] = down;
    out_.upper[i] = up;
  }

  // Velocity of the next step from `rate` that nears braking curve and top speed gradually, at order 2; off the curve
  // by no more than the noise.
  double gradual(double way, double most, double rate, std::size_t i) const {
    const Limits& l = limits_;
    if (l.order == 1 || !std::isfinite(l.braking[i]) || !std::isfinite(l.approach)) return most;
    const double share = std::min(1.0, l.approach * l.dt), f = most > 0.0 ? curve(way, i) : most;
    const double slope = rate > 0.0 ? -rate / (std::max(f, 0.0) / l.braking[i] + horizon(i)) : 0.0;
    const double near = rate + l.dt * slope + share * (f - rate - l.dt * slope);
    if (!(most > 0.0)) return std::max(most - l.noise, std::min(near, share * most + l.noise));
    return std::min({most + l.noise, near, rate + share * (l.speed[i] - rate)});
  }

  double fastest(double way, std::size_t i) const {  // velocity towards a limit that is `way` off, or back to it
    const double most = std::min(limits_.speed[i], curve(way, i));
    return way >= 0.0 ? most : -std::min(most, limits_.return_velocity);
  }

  double curve(double way, std::size_t i) const {  // the speed from which a joint stops on the limit
    const double off = std::fabs(way), T = horizon(i);
    if (!std::isfinite(off)) return INFINITY;
    return 2.0 * off / (std::sqrt(T * T + 2.0 * off / limits_.braking[i]) + T);
  }

  double horizon(std::size_t i) const {  // T of the curve [s]
    return std::isfinite(limits_.braking[i]) ? std::max(limits_.dt, 1.0 / limits_.approach) : limits_.dt;
  }

  Target out_;
  Joints joints_;
  Limits limits_;
  std::vector<double> at_;  // the angles of the tick
};

}  // namespace hqp
