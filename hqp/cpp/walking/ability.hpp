// Limits between a velocity command and the next steps. See walking/preview.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "footsteps.hpp"

namespace hqp {

struct Gait {
  double single_support, double_support, first, height, search, patience;

  double period() const { return single_support + double_support; }
};

// A change of one velocity, and the reason: `length` is the most within `seconds`.
struct Limited {
  enum Axis { kForward, kLeft, kTurn };
  Axis axis;
  double requested, allowed, length, seconds;

  std::string text() const {
    static constexpr const char* kFormats[] = {
        "forward %.2f -> %.2f m/s: knees stretch beyond steps of %.2f m in %.2f s",
        "left %.2f -> %.2f m/s: feet get %.2f m further apart in %.2f s",
        "turn %.2f -> %.2f rad/s: a foot turns by %.2f rad in %.2f s",
    };
    char found[160];
    std::snprintf(found, sizeof found, kFormats[axis], requested, allowed, length, seconds);
    return found;
  }
};

// A change of one foothold of a route, seen from the foot that stands, and the reason.
struct Moved {
  enum Axis { kAhead, kOut, kUp, kTurn, kAdded };
  Axis axis;
  int number, side;  // counted from 1, 0 for a step in place before them
  double requested, allowed;

  std::string text() const {
    static constexpr const char* kFormats[] = {
        "foothold %d, %s: %.2f -> %.2f m ahead: knees stretch beyond it",
        "foothold %d, %s: %.2f -> %.2f m aside: the feet get no further apart",
        "foothold %d, %s: %.2f -> %.2f m up: the CoM rises by no more in a step",
        "foothold %d, %s: %.2f -> %.2f rad: a foot turns no further",
        "foothold %d, %s: a step in place comes first, as the other foot stands",
    };
    static constexpr const char* kNear = "foothold %d, %s: %.2f -> %.2f m aside: the feet meet if they are nearer";
    char found[160];
    std::snprintf(found, sizeof found, axis == kOut && allowed > requested ? kNear : kFormats[axis], number,
                  side == kLeft ? "left" : "right", requested, allowed);
    return found;
  }
};

struct Ability {
  static constexpr double kQuick = 2.0 / 3.0;  // shortest step time as a share of the gait's
  static constexpr double kComfort = 0.6;      // share of the reach above which steps become quicker, not longer
  static constexpr double kChange = 0.04;      // largest change of velocity in a step, a share of sqrt(g h)
  static constexpr double kTurns = 0.3;        // largest change of the turning rate in a step [rad/s]
  static constexpr int kMost = 24;             // steps until a command is met
  static constexpr double kClimb = 0.05;       // largest change of the CoM's height in a second, a share of it [1/s]
  static constexpr double kSame = 1e-9;        // largest difference between places that is rounding [m, rad]

  Gait gait;
  Reach reach;
  double width, height, gravity;

  double change() const { return kChange * std::sqrt(gravity * height); }
  // The nearest command that steps within reach follow; limited(reason) is called for each change.
  template <class Report>
  Command allowed(const Command& requested, const Report& limited) const {
    const double T = kQuick * gait.period(), aside = reach.most - width;
    const auto bounded = [&](Limited::Axis axis, double value, double most, double length, double seconds) {
      const double found = held(value, -most, most);
      if (found != value) limited(Limited{axis, value, found, length, seconds});
      return found;
    };
    Command found;
    found.forward = bounded(Limited::kForward, requested.forward, reach.forward / T, reach.forward, T);
    found.left = bounded(Limited::kLeft, requested.left, 0.5 * aside / T, aside, 2.0 * T);
    found.turn = bounded(Limited::kTurn, requested.turn, 0.5 * reach.turn / T, reach.turn, 2.0 * T);
    return found;
  }
  // The foothold, or the nearest one within a reach of the foot that stands; `half`: half the length of the longer
  // sole, `rise`: its height above that foot [m]; moved(axis, requested, allowed) is called for each change.
  template <class Report>
  Foothold reached(Foothold wanted, const Foothold& stance, Reach within, double half, double rise,
                   const Report& moved) const {
    const double turn = held(wrapped(wanted.yaw - stance.yaw), -within.turn, within.turn);
    within.least = std::min(within.least + half * std::fabs(std::sin(turn)), within.most);  // toes or heels get nearer
    const double up = kClimb * height * gait.period(), out = Footsteps::outwards(wanted.side);
    const double allowed = held(rise, -up, up);
    wanted.z = stance.z + allowed;
    const Foothold found = Footsteps{gait.period(), width, within}.within(wanted, stance);
    const auto seen = [&](const Foothold& one) { return turned_back(stance.yaw, one.xy() - stance.xy()); };
    const Vec2 before = seen(wanted), after = seen(found);
    const auto compare = [&](Moved::Axis axis, double one, double other) {
      if (std::fabs(one - other) > kSame) moved(axis, one, other);
    };
    compare(Moved::kAhead, before.x, after.x);
    compare(Moved::kOut, out * before.y, out * after.y);
    compare(Moved::kUp, rise, allowed);
    compare(Moved::kTurn, wrapped(wanted.yaw - stance.yaw), turn);
    return found;
  }
  // Velocity of the next step: a bounded change towards the command.
  Command paced(const Command& now, const Command& requested) const {
    const double x = requested.forward - now.forward, y = requested.left - now.left;
    const double share = std::min(1.0, change() / std::max(std::hypot(x, y), 1e-12));
    const double turn = held(requested.turn - now.turn, -kTurns, kTurns);
    if (share == 1.0) return {requested.forward, requested.left, now.turn + turn};
    return {now.forward + share * x, now.left + share * y, now.turn + turn};
  }
  // Velocities of the steps until the command is met.
  void paces(Command now, const Command& requested, std::vector<Command>& found, int most = kMost) const {
    found.clear();
    while (static_cast<int>(found.size()) < most && (found.empty() || !(now == requested)))
      found.push_back(now = paced(now, requested));
  }
  // Time of a step at a velocity, a share of that of the gait.
  double haste(const Command& pace) const {
    const double T = gait.period(), aside = std::max(reach.most - width, 1e-9);
    const double needed = std::max(std::fabs(pace.forward) * T / reach.forward, 2.0 * std::fabs(pace.left) * T / aside);
    return std::min(1.0, std::max(kQuick, kComfort / std::max(needed, 1e-9)));
  }
};

}  // namespace hqp
