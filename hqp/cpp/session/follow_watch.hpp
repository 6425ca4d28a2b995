// Joints that do not follow their command: a frozen sensor, a blocked joint, joints in another order.
#pragma once

#include <cmath>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "../rows/whole_turns.hpp"
#include "errors.hpp"
#include "tick.hpp"

namespace hqp {

// Compares the motion that commands demand of each motor with the measured one, over the last kSpan or so:
//
//   velocity level:    g' = u - dq/dt - g / kWay,              |g| <= v_max delay
//   levels above:      g' = v - dq/dt - g / kWay,              |g| <= v_max delay
//                      s' = m - s / kSpan,                     |s| <= a kSpan
//                      m' = (a_sent - dv/dt - m) / kMean,      m clipped to -2 a ... 2 a
//
// u: velocity that was sent; q, v: measured; a_sent: acceleration that was sent, or that the sent torque causes by the
// model. delay: largest age of a state plus that of a drive plus three periods from a command to its motion; the
// bound on g is the way of a joint at its speed limit within it. a is the acceleration from rest to the speed limit
// within kSpan. Anything may touch a robot at torque level, and no torque distinguishes a load from a brake: more than
// that is noted, and the command comes to rest from the acceleration by the motor's whole torque limit on, which no
// load has for long, or if neither position nor speed of the joint have changed by a bit for kStill: noise changes
// those of a joint that a load or a brake holds, and of a frozen sensor nothing does. The clip keeps pushes shorter
// than kSpan log 2 from counting. A joint without a speed limit is not compared.
class FollowWatch {
 public:
  // Times after which differences are forgotten [s]: drives may be wrong by the speed v_max delay / kWay for ever, and
  // by the acceleration a.
  static constexpr double kWay = 1.0, kSpan = 0.5;
  static constexpr double kMean = 0.05;   // accelerations are averaged over this time: v has noise [s]
  static constexpr double kStill = 0.25;  // time without a change after which a sensor is frozen [s]
  static constexpr double kAgain = 1.0;   // time at rest before joints are moved and compared again [s]

  // Motors: names, speed limits and torque limits (0 for none), units of their positions, rad or m, and indices
  // in v.
  FollowWatch(std::vector<std::string> names, const std::vector<double>& speeds, const std::vector<double>& efforts,
              const std::vector<std::string>& units, const std::vector<int>& coordinates, int order, double delay)
      : names_(std::move(names)), order_(order), delay_(delay) {
    const std::size_t n = names_.size();
    if (speeds.size() != n || efforts.size() != n || units.size() != n || coordinates.size() != n || !(delay > 0.0))
      throw PlanError("following: " + std::to_string(speeds.size()) + " speeds, " + std::to_string(units.size()) +
                      " units and a delay of " + std::to_string(delay) + " s for " + std::to_string(n) + " motors");
    const auto finite = [](double limit) { return std::isfinite(limit) && limit > 0.0 ? limit : 0.0; };
    for (std::size_t i = 0; i < n; ++i) {
      joints_.emplace_back();
      Joint& joint = joints_.back();
      joint.coordinate = std::size_t(coordinates[i]), joint.turns = units[i] == "rad";
      joint.limit = finite(speeds[i]), joint.effort = finite(efforts[i]);
    }
  }

  // Begin a tick at that time [s]: the last command acted until now.
  void pass(double now) {
    const double elapsed = now - std::exchange(now_, now);
    if (!std::exchange(running_, true) || !(elapsed >= 0.0) || elapsed > delay_) return restart();
    since_ += elapsed;
    const double stays = std::exp(-elapsed / kWay), fade = std::exp(-elapsed / kSpan),
                 fresh = std::exp(-elapsed / kMean);
    for (Joint& joint : joints_) {
      joint.gap *= stays;
      if (known_ && order_ == 1) joint.gap += joint.rate * elapsed;
      for (Lack& lack : joint.lacks) {
        const double mean = std::fmin(std::fmax(lack.mean, -2.0 * lack.most), 2.0 * lack.most);
        lack.sum = lack.sum * fade + mean * elapsed;
        lack.mean = mean * fresh + (known_ && order_ == 2 ? joint.rate * elapsed / kMean : 0.0);
      }
    }
  }
  // Compare with a valid state; angles, v (nv). Return false, and why, while the command must come to rest; note: takes
  // the note on a smaller lack.
  template <class Report>
  bool follow(const double* angles, const double* v, Note& why, const Report& note) {
    if (now_ < until_) return why = worst_, false;
    if (std::exchange(until_, 0.0) > 0.0 || since_ > delay_) restart();
    double most = 1.0, noted = 1.0;
    Note some;
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      Joint& joint = joints_[i];
      const double angle = angles[joint.coordinate], speed = v[joint.coordinate];
      if (measured_) take(joint, angle, speed);
      if (!measured_ || angle != joint.angle || speed != joint.speed) joint.changed = now_;
      joint.angle = angle, joint.speed = speed;
      if (!(joint.limit > 0.0)) continue;
      const double way = joint.limit * delay_;
      if (const double share = std::fabs(joint.gap) / way; share > most)
        most = share, worst_ = of(i, Status::kNotFollowing, joint.gap, way, joint.turns ? "rad" : "m");
      if (order_ == 1) continue;
      const char* unit = joint.turns ? "rad/s^2" : "m/s^2";
      const Lack &large = joint.lacks[0], &small = joint.lacks[1];
      if (large.share() > most)
        most = large.share(), worst_ = of(i, Status::kNotFollowing, large.sum / kSpan, large.most, unit);
      if (small.share() > most && now_ - joint.changed >= kStill)
        most = small.share(), worst_ = of(i, Status::kNotFollowing, small.sum / kSpan, small.most, unit);
      if (small.share() > noted)
        noted = small.share(), some = of(i, Status::kOptimal, small.sum / kSpan, small.most, unit);
    }
    measured_ = compared_ = true, since_ = 0.0;
    if (most == 1.0) {
      if (noted > 1.0) note(some);
      return true;
    }
    until_ = now_ + kAgain;
    return why = worst_, false;
  }
  // Take the motion that the sent command demands. rate(coordinate): a velocity, or an acceleration at the levels
  // above; felt(motor): inverse of the inertia that it feels, at torque level.
  template <class Rate, class Felt>
  void sent(const Rate& rate, const Felt& felt) {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      Joint& joint = joints_[i];
      joint.rate = rate(joint.coordinate);
      const double least = joint.limit / kSpan;
      joint.lacks[0].most = std::fmax(least, joint.effort > 0.0 ? joint.effort * felt(i) : 0.0);
      joint.lacks[1].most = least;
    }
    known_ = true;
  }
  // A command of unknown effect was sent.
  void unknown() { known_ = compared_ = false; }
  // Return to the state after construction.
  void reset() { until_ = 0.0, running_ = false, restart(); }

 private:
  // Acceleration that a joint lacks: in the mean [per s^2], its integral [per s], and how much is allowed [per s^2].
  struct Lack {
    double mean = 0.0, sum = 0.0, most = 0.0;
    double share() const { return std::fabs(sum) / (most * kSpan); }  // NaN before anything was sent
  };
  struct Joint {
    std::size_t coordinate = 0;
    double limit = 0.0, effort = 0.0;  // speed and torque limit, 0 for none
    bool turns = true;
    double rate = 0.0, angle = 0.0, speed = 0.0;
    double gap = 0.0;      // way that the joint lacks [rad, m]
    double changed = 0.0;  // time of the last change of its measured numbers [s]
    Lack lacks[2];         // thresholds of the command's rest, and of a note
  };

  // Begin to compare anew.
  void restart() {
    for (Joint& joint : joints_) joint.gap = 0.0, joint.lacks[0] = joint.lacks[1] = Lack{};
    measured_ = known_ = compared_ = false, since_ = 0.0;
  }
  void take(Joint& joint, double angle, double speed) const {
    double way = angle - joint.angle;
    if (joint.turns) way = std::remainder(way, kTurn);
    if (order_ == 2) joint.gap += 0.5 * (joint.speed + speed) * since_ - way;
    for (Lack& lack : joint.lacks)
      if (order_ == 2 && compared_) lack.mean -= (speed - joint.speed) / kMean;
    if (order_ == 1 && compared_) joint.gap -= way;
  }
  Note of(std::size_t i, Status status, double lack, double allowed, const char* unit) const {
    Note found{"joints", status, Cause::kFollow, names_[i].c_str(), lack, allowed};
    found.rows[0].name = unit;
    return found;
  }

  std::vector<std::string> names_;
  int order_;
  double delay_;
  std::vector<Joint> joints_;
  Note worst_;
  double now_ = 0.0, until_ = 0.0, since_ = 0.0;  // since_: the last valid state [s]
  bool running_ = false, measured_ = false;
  bool known_ = false;     // rates have been sent
  bool compared_ = false;  // rates have been known since the last valid state
};

}  // namespace hqp
