// Friction of a motor's joint, viscous and dry, which a torque overcomes.
#pragma once

#include <cmath>
#include <cstddef>

namespace hqp {

struct JointFriction {
  static constexpr double kSoon = 0.02;   // the rate is that of so much later: a joint at rest begins to move [s]
  static constexpr double kBreaks = 0.3;  // rate for 76 % of dry friction: at 0.1 a stance foot trembles [rad/s]

  std::size_t motor = 0, column = 0;  // of the torques, of v
  double viscous = 0.0, dry = 0.0;    // [N m s/rad], [N m]

  template <class Plan>
  static JointFriction of(const Plan& p) {
    return {std::size_t(p.integer("motor")), std::size_t(p.integer("column")), p.number("viscous"), p.number("dry")};
  }
  // Torque at a rate and an acceleration; none if they are not finite.
  double torque(double rate, double acceleration) const {
    const double soon = rate + kSoon * acceleration;
    return std::isfinite(soon) ? viscous * soon + dry * std::tanh(soon / kBreaks) : 0.0;
  }
};

}  // namespace hqp
