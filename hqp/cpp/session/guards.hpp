// What a session lets in: states of ordinary size, the equations of hqp/loop/safety.py.
#pragma once

#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "../rows/references.hpp"
#include "node.hpp"
#include "tick.hpp"

namespace hqp {

class StateGuard {
 public:
  StateGuard(const Node& robot, const Node& p, const Kinematics& kinematics)
      : kinematics_(kinematics),
        nq_(robot.integer("nq")),
        nv_(robot.integer("nv")),
        floating_(robot.flag("floating")),
        low_(p.numbers("low")),
        high_(p.numbers("high")),
        speed_(p.numbers("speed")),
        distance_(p.number("distance")),
        ordinary_(p.number("ordinary")),
        names_(robot.texts("coordinates")),
        places_(robot.texts("places")),
        angles_(low_.size()) {
    const std::size_t n = static_cast<std::size_t>(nv_);
    if (low_.size() != n || high_.size() != n || speed_.size() != n || names_.size() != n ||
        places_.size() != static_cast<std::size_t>(nq_))
      throw PlanError("the bounds of the plan have a wrong size");
  }

  // q is normalised in place; false, and why, where the state is not usable.
  bool check(double* q, const double* v, Note& why) {
    const double square = squared(q, nq_) + squared(v, nv_);
    if (!(square < std::numeric_limits<double>::infinity())) return not_finite(q, v, why);
    if (!kinematics_.unit(q, kRounding)) {
      const int wrong = kinematics_.normalise(q, kUnit);
      if (wrong >= 0) return refuse(why, Cause::kQuaternion, places_[static_cast<std::size_t>(wrong)], 0.0, kUnit);
    }
    return square < ordinary_ || small(q, v, why);
  }

 private:
  static constexpr double kRounding = 1e-12;  // ROUNDING and UNIT_TOLERANCE of robots/checks.py
  static constexpr double kUnit = 1e-3;

  static bool refuse(Note& why, Cause cause, const std::string& where, double amount, double allowed) {
    why = {"state", Status::kInvalidState, cause, where.c_str(), amount, allowed};
    return false;
  }
  bool not_finite(const double* q, const double* v, Note& why) const {
    for (int i = 0; i < nq_; ++i)
      if (!std::isfinite(q[i] * q[i])) return refuse(why, Cause::kNotFinite, places_[std::size_t(i)], q[i], 0.0);
    for (int i = 0; i < nv_; ++i)
      if (!std::isfinite(v[i] * v[i])) return refuse(why, Cause::kNotFinite, names_[std::size_t(i)], v[i], 0.0);
    return refuse(why, Cause::kNotFinite, all_, std::numeric_limits<double>::infinity(), 0.0);
  }
  bool small(const double* q, const double* v, Note& why) {
    kinematics_.angles(q, angles_.data());
    int worst = -1;
    double most = 0.0;
    for (int i = 0; i < nv_; ++i) {
      const std::size_t k = static_cast<std::size_t>(i);
      const double outside = std::fmax(low_[k] - angles_[k], angles_[k] - high_[k]);
      if (outside > most) most = outside, worst = i;
    }
    if (worst >= 0) {
      const std::size_t k = static_cast<std::size_t>(worst);
      return refuse(why, Cause::kPosition, names_[k], angles_[k], angles_[k] > high_[k] ? high_[k] : low_[k]);
    }
    most = 1.0;
    for (int i = 0; i < nv_; ++i) {
      const double over = std::fabs(v[i]) / speed_[static_cast<std::size_t>(i)];
      if (over > most) most = over, worst = i;
    }
    if (worst >= 0) {
      const std::size_t k = static_cast<std::size_t>(worst);
      return refuse(why, Cause::kVelocity, names_[k], v[worst], speed_[k]);
    }
    for (int i = 0; floating_ && i < 3; ++i)
      if (std::fabs(q[i]) > distance_) return refuse(why, Cause::kBase, all_, std::fabs(q[i]), distance_);
    return true;
  }

  const Kinematics& kinematics_;
  int nq_, nv_;
  bool floating_;
  std::vector<double> low_, high_, speed_;
  double distance_, ordinary_;
  std::vector<std::string> names_, places_;
  std::string all_ = "base";
  std::vector<double> angles_;
};

}  // namespace hqp
