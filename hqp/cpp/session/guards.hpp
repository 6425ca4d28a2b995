// Limits of states and commands: size and age of states, rates of commands, limits of motors.
#pragma once

#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "../rows/references.hpp"
#include "errors.hpp"
#include "tick.hpp"

namespace hqp {

// Magnitudes beyond which a state is a fault of its source: bounds of each coordinate (nv), and of the free base.
class StateBounds {
 public:
  StateBounds(std::vector<double> low, std::vector<double> high, std::vector<double> speed, double distance,
              bool floating, std::vector<std::string> names)
      : low_(std::move(low)),
        high_(std::move(high)),
        speed_(std::move(speed)),
        distance_(distance),
        floating_(floating),
        names_(std::move(names)) {
    const std::size_t n = low_.size();
    if (high_.size() != n || speed_.size() != n || names_.size() != n)
      throw PlanError("the state bounds of the plan need " + std::to_string(n) + " of low, high, speed and names each");
  }

  std::size_t size() const { return low_.size(); }
  std::size_t places() const { return floating_ ? 3 : 0; }  // count of checked numbers of q
  // Return false, and the reason, if a number is too large.
  bool hold(const double* angles, const double* q, const double* v, Note& why) const {
    std::size_t worst = 0;
    double most = 0.0;
    for (std::size_t i = 0; i < low_.size(); ++i) {
      const double outside = std::fmax(low_[i] - angles[i], angles[i] - high_[i]);
      if (outside > most) most = outside, worst = i;
    }
    if (most > 0.0) {
      refuse(why, Cause::kPosition, names_[worst], angles[worst], low_[worst]);
      return why.most = high_[worst], false;
    }
    most = 1.0;
    for (std::size_t i = 0; i < low_.size(); ++i) {
      const double over = std::fabs(v[i]) / speed_[i];
      if (over > most) most = over, worst = i;
    }
    if (most > 1.0) return refuse(why, Cause::kVelocity, names_[worst], v[worst], speed_[worst]);
    double far = 0.0;
    for (int i = 0; floating_ && i < 3; ++i) far = std::fmax(far, std::fabs(q[i]));
    return far <= distance_ || refuse(why, Cause::kBase, base_, far, distance_);
  }

  static bool refuse(Note& why, Cause cause, const std::string& where, double amount, double allowed) {
    why = {"state", Status::kInvalidState, cause, where.c_str(), amount, allowed};
    return false;
  }

 private:
  std::vector<double> low_, high_, speed_;
  double distance_;
  bool floating_;
  std::vector<std::string> names_;
  std::string base_ = "base";
};

// Limit on the age of a state; its time and the session's are of one clock [s].
class StateAge {
 public:
  // Largest lead of a state over the session: the error of two synchronised clocks.
  static constexpr double kAhead = 1e-3;

  explicit StateAge(double most) : most_(most) {}
  // Return false, and the reason, if it is too old.  time: null if the state has none.
  bool hold(const double* time, double now, Note& why) const {
    const auto refuse = [&](Cause cause, double amount, double allowed) {
      return StateBounds::refuse(why, cause, none_, amount, allowed);
    };
    if (!time) return refuse(Cause::kNoTime, 0.0, 0.0);
    const double age = now - *time;
    if (age < -kAhead) return refuse(Cause::kAhead, -age, kAhead);
    return age <= most_ || refuse(Cause::kAge, age, most_);
  }

 private:
  double most_;
  std::string none_;
};

// Checks that q and v are a state of ordinary size.
class StateCheck {
 public:
  // places, speeds: the joint of each number of q and of v.  ordinary: sum of squares below which every number is
  // within its bounds.  age: null for any.
  StateCheck(StateBounds bounds, std::vector<std::string> places, std::vector<std::string> speeds, double ordinary,
             std::unique_ptr<StateAge> age, const Kinematics* kinematics)
      : bounds_(std::move(bounds)),
        places_(std::move(places)),
        speeds_(std::move(speeds)),
        ordinary_(ordinary),
        age_(std::move(age)),
        kinematics_(kinematics),
        angles_(bounds_.size()) {
    if ((kinematics && places_.size() != std::size_t(kinematics->size())) || speeds_.size() != bounds_.size() ||
        places_.size() < bounds_.places())
      throw PlanError("the state bounds of the plan need a name for each of nq = " + std::to_string(places_.size()) +
                      " and nv = " + std::to_string(bounds_.size()) + " numbers");
  }

  // Normalise q in place; return false, and the reason, if the state is not usable.
  // angles: joints of q, if there are no kinematics.
  bool check(double* q, const double* v, const double* time, double now, const double* angles, Note& why) {
    double square = 0.0;
    if (!unit(q, v, square, why)) return false;
    if (age_ && !age_->hold(time, now, why)) return false;
    return square < ordinary_ || within(q, v, angles, why);
  }
  // Check a state of any age.
  bool valid(double* q, const double* v, const double* angles, Note& why) {
    double square = 0.0;
    return unit(q, v, square, why) && (square < ordinary_ || within(q, v, angles, why));
  }
  // Return true if no number of a valid state is too large.
  bool within(const double* q, const double* v, const double* angles, Note& why) {
    if (!kinematics_) return bounds_.hold(angles, q, v, why);
    kinematics_->angles(q, angles_.data());
    return bounds_.hold(angles_.data(), q, v, why);
  }
  void of_any_age() { age_.reset(); }
  bool any_age() const { return !age_; }

 private:
  // Normalise q, and return true if q and v are finite with quaternions near length one; square: sum over all numbers.
  bool unit(double* q, const double* v, double& square, Note& why) const {
    const int nq = static_cast<int>(places_.size()), nv = static_cast<int>(speeds_.size());
    square = squared(q, nq) + squared(v, nv);
    if (!(square < std::numeric_limits<double>::infinity())) return not_finite(q, v, why);
    if (kinematics_ && !kinematics_->unit(q, Kinematics::kRounding)) {
      double length = 0.0;
      bool pair = false;
      const int wrong = kinematics_->normalise(q, Kinematics::kUnit, length, pair);
      if (wrong >= 0)
        return StateBounds::refuse(why, pair ? Cause::kPair : Cause::kQuaternion, places_[std::size_t(wrong)], length,
                                   Kinematics::kUnit);
    }
    return true;
  }
  bool not_finite(const double* q, const double* v, Note& why) const {
    for (std::size_t i = 0; i < places_.size(); ++i)
      if (!std::isfinite(q[i] * q[i])) return StateBounds::refuse(why, Cause::kNotFinite, places_[i], q[i], 0.0);
    for (std::size_t i = 0; i < speeds_.size(); ++i)
      if (!std::isfinite(v[i] * v[i])) return StateBounds::refuse(why, Cause::kNotFiniteV, speeds_[i], v[i], 0.0);
    return StateBounds::refuse(why, Cause::kTooLarge, places_[0], 0.0, 0.0);
  }

  StateBounds bounds_;
  std::vector<std::string> places_, speeds_;
  double ordinary_;
  std::unique_ptr<StateAge> age_;
  const Kinematics* kinematics_;  // null if q is normalised and its angles are given
  std::vector<double> angles_;
};

// Limits the change of a command: inverse of the largest change in a tick (motors,).
class RateLimiter {
 public:
  // joints, name: names of the motors and of the limit.
  RateLimiter(std::vector<std::string> joints, std::vector<double> inverse, double dt, std::string name)
      : names_(std::move(joints)), inverse_(std::move(inverse)), dt_(dt), name_(std::move(name)), all_(name_ + "s") {
    if (names_.size() != inverse_.size())
      throw PlanError("rate limits: " + std::to_string(inverse_.size()) + " numbers for " +
                      std::to_string(names_.size()) + " motors");
  }

  // Share of the way to x that one tick may go, 0 to 1; why: the reason for less than 1.  motors: their places in x.
  double share(const double* last, const double* x, const std::vector<int>& motors, Note& why) const {
    const auto change = [&](std::size_t i) { return x[motors[i]] - last[motors[i]]; };
    double most = 1.0;
    std::size_t worst = 0;
    for (std::size_t i = 0; i < inverse_.size(); ++i) {
      const double over = std::fabs(change(i) * inverse_[i]);
      if (over > most) most = over, worst = i;
    }
    if (most == 1.0) return 1.0;
    why = {all_.c_str(),
           Status::kOptimal,
           Cause::kRate,
           names_[worst].c_str(),
           std::fabs(change(worst)) / dt_,
           1.0 / (inverse_[worst] * dt_)};
    return 1.0 / most;
  }
  const char* name() const { return name_.c_str(); }
  const std::vector<double>& inverse() const { return inverse_; }

 private:
  std::vector<std::string> names_;
  std::vector<double> inverse_;
  double dt_;
  std::string name_, all_;  // in notes on rows that it violates, and on itself
};

// Keeps a command within limits of the motors, independent of the solver's rows: inverse of the largest speed or
// torque (motors,), 0 for no limit. A motor that is faster already may keep its speed.
//
// Velocity and torque level: x+ = share x. Acceleration level, where the limits hold for v + dt x: the point on the way
// from braking, b = -v min(1 / dt, a / max_i |v_i|), to x.
class MotorLimits {
 public:
  static constexpr double kRounding = 1e-6;  // share of a limit: error of the solver's rows

  // units: speed or torque units.  braking: a, at acceleration level; 0 at the others.
  MotorLimits(std::vector<std::string> joints, std::vector<double> inverse, std::vector<std::string> units, double dt,
              double braking)
      : names_(std::move(joints)), units_(std::move(units)), inverse_(std::move(inverse)), dt_(dt), braking_(braking) {
    if (names_.size() != inverse_.size() || names_.size() != units_.size())
      throw PlanError("motor limits: " + std::to_string(inverse_.size()) + " numbers for " +
                      std::to_string(names_.size()) + " motors");
  }

  // Scale x (n) down to the limits; return false, with x as it is, if it is within them.  v: velocity before this tick,
  // the command's at velocity level, null at torque level.  motors: their places in x.
  bool hold(double* x, std::size_t n, const double* v, const std::vector<int>& motors, Note& why) const {
    const double rate = braking_ > 0.0 ? resting(v, motors) : 0.0;
    double share = 1.0;
    for (std::size_t i = 0; i < inverse_.size(); ++i) {
      const std::size_t j = std::size_t(motors[i]);
      const double from = braking_ > 0.0 ? v[j] * (1.0 - dt_ * rate) : 0.0,
                   to = braking_ > 0.0 ? v[j] + dt_ * x[j] : x[j];
      if (!(std::fabs(to) * inverse_[i] > 1.0 + kRounding)) continue;
      const double most = std::fmax(1.0 / inverse_[i], v ? std::fabs(v[j]) : 0.0);
      if (std::fabs(to) <= most * (1.0 + kRounding)) continue;
      const double part = (std::copysign(most, to) - from) / (to - from);
      if (part >= share) continue;
      share = part;
      why = {"motors", Status::kOptimal, Cause::kMotor, names_[i].c_str(), std::fabs(to), 1.0 / inverse_[i]};
      why.rows[0].name = units_[i].c_str();
    }
    if (share == 1.0) return false;
    for (std::size_t i = 0; i < n; ++i) {
      const double from = braking_ > 0.0 ? -v[i] * rate : 0.0;
      x[i] = from + share * (x[i] - from);
    }
    return true;
  }
  static const char* name() { return "motor"; }

 private:
  double resting(const double* v, const std::vector<int>& motors) const {
    double most = 0.0;
    for (const int j : motors) most = std::fmax(most, std::fabs(v[j]));
    return most > 0.0 ? std::fmin(1.0 / dt_, braking_ / most) : 0.0;
  }

  std::vector<std::string> names_, units_;
  std::vector<double> inverse_;
  double dt_, braking_;
};

}  // namespace hqp
