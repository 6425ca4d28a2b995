// Commands of a policy before and behind the stack that guards them; hqp/policies/policy_filter.py has the equations.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "inverse_dynamics.hpp"

namespace hqp {

enum class Commanded { kPositions, kVelocities, kTorques };

class Filter {
 public:
  // Fields: see PolicyFilter.tree of hqp/policies/policy_filter.py.
  template <class Plan>
  explicit Filter(const Plan& p)
      : kind_(static_cast<Commanded>(p.place("kind", 3))),
        dt_(p.number("dt")),
        kept_(p.number("kept")),
        q_(count(p, "nq")),
        v_(count(p, "nv")),
        columns_(p.places("columns", v_.size())),
        passive_(p.places("passive", v_.size())),
        kp_(p.numbers("kp")),
        motors_(kp_.size()),
        kd_(p.numbers("kd", motors_)),
        effort_(p.numbers("effort", motors_)),
        largest_(p.numbers("largest", motors_)),
        rounding_(p.numbers("rounding", motors_)),
        stiffening_(p.numbers("stiffening", columns_.size())),
        most_(p.numbers("most", columns_.size())),
        first_(columns_.size() - std::min(motors_, columns_.size())),
        transmitted_(p.numbers("transmitted", passive_.size() * motors_)) {
    need(columns_.size() == motors_ + first_ && (first_ == 0 || first_ == 6), "a wrench has six numbers");
    before_q_ = middle_ = between_ = q_;
    before_v_ = mean_ = acceleration_ = forces_ = positions_ = v_;
    angles_.resize(motors_), requested_ = speeds_ = taken_ = free_ = last_ = place_ = torque_ = angles_;
    known_.resize(motors_), limited_.resize(motors_);
    lacking_.resize(columns_.size()), rate_ = held_ = lacking_;
  }
  Filter(const Filter&) = delete;

  // Discard earlier commands and estimates.
  void reset() {
    begun_ = sent_ = false;
    std::fill(rate_.begin(), rate_.end(), 0.0), std::fill(lacking_.begin(), lacking_.end(), 0.0);
  }

  // Take a command (motors) for a measured state; numbers that are not valid are replaced by the last ones sent.
  void begin(InverseDynamics& model, const double* command, const double* q, const double* v) {
    measure(model.kinematics(), q, v);
    if (!begun_) start();
    std::copy(command, command + motors_, requested_.begin());
    for (std::size_t i = 0; i < motors_; ++i)
      taken_[i] = std::isfinite(command[i]) && std::fabs(command[i]) <= largest_[i] ? command[i] : last_[i];
    std::copy(q, q + middle_.size(), middle_.begin());
    if (!forces()) {
      free_ = taken_;
      return;
    }
    estimate(model);
    if (valid_) model.kinematics().integrate(q_.data(), v_.data(), 0.5 * dt_, middle_.data());
    for (std::size_t i = 0; i < motors_; ++i) {
      taken_[i] = within_effort(i, taken_[i], angles_[i]);
      free_[i] = torque(i, taken_[i]);
    }
  }
  const std::vector<double>& free() const { return free_; }        // torques or velocities by the command
  const std::vector<double>& lacking() const { return lacking_; }  // torques beside the motors, first the base's wrench
  const std::vector<double>& middle() const { return middle_; }    // configuration at which the stack has its rows
  bool forces() const { return kind_ != Commanded::kVelocities; }
  std::size_t motors() const { return motors_; }
  std::size_t nq() const { return q_.size(); }
  std::size_t nv() const { return v_.size(); }

  // The command (motors) for the stack's answer x (motors), which brings the joints to rest if it is not solved.
  void end(const double* x, bool solved, double* command) {
    for (std::size_t i = 0; i < motors_; ++i) {
      const double change = x[i] - free_[i];
      const bool changed = !solved || std::fabs(change) > rounding_[i];
      double sent = taken_[i] + (changed ? change : 0.0) * share(i);
      if (!solved) sent = resting(i, x[i]);
      if (solved && known_[i]) place_[i] = angles_[i];
      if (forces()) sent = within_effort(i, sent, known_[i] ? angles_[i] : place_[i]);
      if (std::isfinite(sent)) last_[i] = sent;
      command[i] = last_[i];
      limited_[i] = changed || !(taken_[i] == requested_[i]);
      if (forces()) torque_[i] = torque(i, last_[i]);
    }
    if (solved) held_ = lacking_;
    before_q_ = q_, before_v_ = v_, sent_ = forces();
  }
  // Joints whose command differs from the requested one.
  const std::vector<std::uint8_t>& limited() const { return limited_; }

 private:
  void measure(const Kinematics& kinematics, const double* q, const double* v) {
    std::copy(q, q + q_.size(), q_.begin()), std::copy(v, v + v_.size(), v_.begin());
    double length = 0.0;
    bool pair = false;
    valid_ = finite(q_.data(), int(q_.size())) && finite(v_.data(), int(v_.size())) &&
             (kinematics.unit(q_.data(), Kinematics::kRounding) ||
              kinematics.normalise(q_.data(), Kinematics::kUnit, length, pair) < 0);
    kinematics.angles(q_.data(), positions_.data());
    for (std::size_t i = 0; i < motors_; ++i) {
      const std::size_t c = std::size_t(columns_[first_ + i]);
      known_[i] = std::isfinite(positions_[c]) && std::isfinite(v_[c]);
      angles_[i] = known_[i] ? positions_[c] : 0.0, speeds_[i] = known_[i] ? v_[c] : 0.0;
    }
  }
  void start() {
    begun_ = true, place_ = angles_, held_ = lacking_;
    if (kind_ == Commanded::kPositions) last_ = angles_;
    else std::fill(last_.begin(), last_.end(), 0.0);
  }
  double share(std::size_t i) const { return kind_ == Commanded::kPositions ? 1.0 / kp_[i] : 1.0; }
  double resting(std::size_t i, double x) const {
    if (kind_ == Commanded::kPositions) return place_[i] + x / kp_[i];
    if (kind_ == Commanded::kTorques) return x + (held_[first_ + i] - lacking_[first_ + i]);  // x holds with an older d
    return x;
  }
  // The command whose torque is within the effort limit.
  double within_effort(std::size_t i, double command, double angle) const {
    if (kind_ == Commanded::kTorques) return within(command, -effort_[i], effort_[i]);
    const double damping = kd_[i] * speeds_[i];
    return within(command, angle + (damping - effort_[i]) / kp_[i], angle + (damping + effort_[i]) / kp_[i]);
  }
  // Torque of the command at the end of the period.
  double torque(std::size_t i, double command) const {
    if (kind_ == Commanded::kTorques) return command;
    return kp_[i] * (command - (angles_[i] + dt_ * speeds_[i])) - kd_[i] * speeds_[i];
  }

  // Estimate d and its change in a tick from the motion of the last period, without lag behind a ramp.
  void estimate(InverseDynamics& model) {
    if (!sent_) return;
    for (std::size_t c = 0; c < v_.size(); ++c) mean_[c] = 0.5 * (before_v_[c] + v_[c]);
    for (const std::vector<int>* some : {&columns_, &passive_})
      for (const int c : *some) acceleration_[std::size_t(c)] = (v_[std::size_t(c)] - before_v_[std::size_t(c)]) / dt_;
    model.kinematics().integrate(before_q_.data(), mean_.data(), 0.5 * dt_, between_.data());
    model.run(between_.data(), mean_.data(), acceleration_.data(), forces_.data());
    for (std::size_t k = 0; k < columns_.size(); ++k) {
      const std::size_t c = std::size_t(columns_[k]);
      double found = forces_[c] + stiffening_[k] * acceleration_[c];
      if (k >= first_) found += transmitted(k - first_) - torque_[k - first_];
      const double error = std::isfinite(found) ? within(found, -most_[k], most_[k]) - lacking_[k] : 0.0;
      rate_[k] += (1.0 - kept_) * (1.0 - kept_) * error;
      lacking_[k] = within(lacking_[k] + (1.0 - kept_ * kept_) * error + rate_[k], -most_[k], most_[k]);
    }
    if (first_) carry();
  }
  // Torque at a motor's joint that moves joints without a motor, by the couplings between them.
  double transmitted(std::size_t motor) const {
    double sum = 0.0;
    for (std::size_t j = 0; j < passive_.size(); ++j)
      if (const double share = transmitted_[j * motors_ + motor]) sum += share * forces_[std::size_t(passive_[j])];
    return sum;
  }
  // Carry the wrench on a free base on by a period: it keeps its direction in the world.
  void carry() {
    const Vec3 turn = -dt_ * load(v_.data() + 3);
    const double square = dot(turn, turn), t = std::sqrt(square);
    if (!(square < std::numeric_limits<double>::infinity())) return;
    const double s = t > 1e-8 ? std::sin(t) / t : 1.0, h = t > 1e-8 ? std::sin(0.5 * t) / t : 0.5;
    for (double* wrench : {lacking_.data(), lacking_.data() + 3, rate_.data(), rate_.data() + 3}) {
      const Vec3 r = load(wrench), across = cross(turn, r), turned = r + s * across + 2.0 * h * h * cross(turn, across);
      for (int i = 0; i < 3; ++i) wrench[i] = turned[i];
    }
  }
  static double within(double number, double low, double high) { return std::min(std::max(number, low), high); }

  template <class Plan>
  static std::size_t count(const Plan& p, const char* field) {
    return std::size_t(p.part("model").place(field, std::size_t(kMost)));
  }

  Commanded kind_;
  double dt_, kept_;
  std::vector<double> q_, v_;
  std::vector<int> columns_;  // coordinates of a free base, then of the motors' joints
  std::vector<int> passive_;  // coordinates of joints without a motor
  std::vector<double> kp_;
  std::size_t motors_;
  std::vector<double> kd_, effort_, largest_, rounding_, stiffening_, most_;
  std::size_t first_;                // place of the first motor in columns_
  std::vector<double> transmitted_;  // rates of passive joints by those of the motors' joints (passive, motors)

  bool valid_ = false, begun_ = false, sent_ = false;
  std::vector<double> before_q_, before_v_, middle_, between_, mean_, acceleration_, forces_, positions_;
  std::vector<double> requested_, angles_, speeds_, taken_, free_, last_, place_, torque_;
  std::vector<double> lacking_, rate_, held_;
  std::vector<std::uint8_t> known_, limited_;
};

}  // namespace hqp
