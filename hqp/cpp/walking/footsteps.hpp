// From a velocity to footholds within reach. See walking/footsteps.py for the equations.
#pragma once

#include "plane.hpp"

namespace hqp {

enum Side { kLeft, kRight };

struct Foothold {  // the middle of a sole on the ground, and its heading
  int side = kLeft;
  double x = 0.0, y = 0.0, z = 0.0, yaw = 0.0;

  Vec2 xy() const { return {x, y}; }
};

struct Command {  // forward, to the left [m/s], turning [rad/s]
  double forward = 0.0, left = 0.0, turn = 0.0;

  bool operator==(const Command& other) const {
    return forward == other.forward && left == other.left && turn == other.turn;
  }
};

struct Reach {
  double forward, least, most, turn;
};

struct Footsteps {
  double period, width;
  Reach reach;

  // The next foothold, at the height of the stance foot.
  Foothold next(const Foothold& stance, const Command& command) const {
    const int side = 1 - stance.side;
    const double out = outwards(side);
    const double turn = command.turn * out > 0.0 ? held(2.0 * command.turn * period, -reach.turn, reach.turn) : 0.0;
    const double across = command.left * out > 0.0 ? 2.0 * command.left * period : 0.0;
    const Vec2 at = stance.xy() + turned(stance.yaw + 0.5 * turn, {command.forward * period, out * width + across});
    return within({side, at.x, at.y, stance.z, stance.yaw + turn}, stance);
  }
  // The foothold, or the nearest one within reach of the stance foot.
  Foothold within(const Foothold& foothold, const Foothold& stance) const {
    const double out = outwards(foothold.side);
    const Vec2 seen = turned_back(stance.yaw, foothold.xy() - stance.xy());
    const Vec2 step{held(seen.x, -reach.forward, reach.forward), out * held(out * seen.y, reach.least, reach.most)};
    const double turn = held(wrapped(foothold.yaw - stance.yaw), -reach.turn, reach.turn);
    const Vec2 at = stance.xy() + turned(stance.yaw, step);
    return {foothold.side, at.x, at.y, foothold.z, stance.yaw + turn};
  }
  static double outwards(int side) { return side == kLeft ? 1.0 : -1.0; }
};

}  // namespace hqp
