// The path of a foot in the air. See walking/swing.py.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "plane.hpp"

namespace hqp {

struct AxisState {
  double x, v, a;
};

// Position, velocity and acceleration `after` [s] on the quintic from `start` to (goal, rate, 0).
inline AxisState quintic(const AxisState& start, double goal, double duration, double after, double rate = 0.0) {
  const double x = start.x, v = start.v, a = start.a, T = duration, t = std::min(after, duration);
  const double h = goal - x - v * T - 0.5 * a * T * T, dv = rate - v - a * T;
  const double T3 = std::pow(T, 3), T4 = std::pow(T, 4), T5 = std::pow(T, 5);
  const double c3 = (20.0 * h - 8.0 * dv * T - a * T * T) / (2.0 * T3);
  const double c4 = (-30.0 * h + 14.0 * dv * T + 2.0 * a * T * T) / (2.0 * T4);
  const double c5 = (12.0 * h - 6.0 * dv * T - a * T * T) / (2.0 * T5);
  return {x + t * (v + t * (0.5 * a + t * (c3 + t * (c4 + t * c5)))),
          v + t * (a + t * (3.0 * c3 + t * (4.0 * c4 + t * 5.0 * c5))),
          a + t * (6.0 * c3 + t * (12.0 * c4 + t * 20.0 * c5))};
}

class Swing {
 public:
  using Four = std::array<double, 4>;  // x, y, z, yaw

  static constexpr double kRise = 0.45;     // share of the swing time at the foot's highest point
  static constexpr double kScuff = 0.4;     // share of the remaining time in which a scuffed foot rises again
  static constexpr double kLead = 0.03;     // time before the landing at which the foot is at its goal [s]
  static constexpr double kFollows = 0.06;  // shortest time to a moved goal [s]
  static constexpr double kYields = 0.04;   // time constant of the lead of a blocked foot [s]
  static constexpr double kStops = 0.01;    // time constant in which a blocked foot's reference slows down to that [s]
  static constexpr double kFalls = 10.0;    // largest acceleration of a foot on its way down [m/s^2]
  static constexpr double kQuintic = 5.77;  // largest acceleration of a quintic over a unit of length and time
  static constexpr double kSinks = 200.0;   // rate of the acceleration of a foot that finds no ground [m/s^3]

  Four x{}, v{}, a{}, goal{};
  double duration = 1.0, time = 0.0, search = 0.0, depth = 0.0;

  Swing() = default;
  Swing(const Four& start, const Four& to, double seconds, double height, double speed, double deep = 0.06)
      : x(start), goal(seen(to, start)), duration(seconds), search(speed), depth(deep), above_(height) {
    top_ = std::max(x[2], goal[2]) + height;
    aimed_ = peak_ = kRise * duration;
  }

  // Move the goal towards another one, over ground, up and in yaw by at most fastest dt each.
  void retarget(const Four& to, double fastest, double dt) {
    const double most = fastest * dt;
    const Four next = seen(to, goal);
    if (next == goal) return;
    const Vec2 off = within({next[0] - goal[0], next[1] - goal[1]}, most);
    goal[0] += off.x, goal[1] += off.y;
    for (const int i : {2, 3}) goal[i] += held(next[i] - goal[i], -most, most);
    moved_ = time;
  }
  double soonest() const { return falling(x[2], v[2]) + kLead; }  // shortest time until it can land [s]
  // Rise again, from wherever the path is, to the swing's height above z [m] or as high as the time allows: the foot
  // has scuffed there.  Return false if the time does not suffice for that.
  bool clear(double z) {
    const double rest = left() - kLead, up = kScuff * rest, down = rest - up;
    const double top = std::min(std::max(top_, z + above_), goal[2] + kFalls / kQuintic * down * down);
    if (up < kFollows || top <= z) return false;
    top_ = top, cleared_ = aimed_ = peak_ = std::max(cleared_, time + up), falls_ = false;
    return true;
  }
  // Lead the foot at a place over ground by no more than `most`.  If something is in the way there, the lead grows ever
  // slower; dt: time since the last call.
  void lead(const Vec2& place, double most, bool blocked, double dt) {
    const Vec2 off{x[0] - place.x, x[1] - place.y}, at = place + within(off, most);
    const double square = dot(off, off), size = std::sqrt(square);
    x[0] = at.x, x[1] = at.y;
    if (!blocked || !(square > 0.0)) return;
    const double along = dot(off, {v[0], v[1]}) / size, fastest = std::max(most - size, 0.0) / kYields;
    if (!(along > fastest)) return;
    const double slower = std::min(1.0 - fastest / along, dt / kStops);
    for (Four* one : {&v, &a}) {
      const double part = slower * std::max(dot(off, {(*one)[0], (*one)[1]}), 0.0) / square;
      (*one)[0] -= part * off.x, (*one)[1] -= part * off.y;
    }
  }
  // Go on from a place at rest, down to a goal, and land later if the time does not suffice.
  void lower(const Four& from, const Four& to) {
    x = from, v = a = {}, goal = seen(to, from);
    duration = std::max(duration, time + soonest());
  }
  double left() const { return duration - time; }  // until it is to land [s], negative afterwards
  void step(double dt) {
    const double to_goal = std::max(left() - kLead, moved_ + kFollows - time);
    for (const int i : {0, 1, 3}) {
      const AxisState next =
          to_goal >= dt ? quintic({x[i], v[i], a[i]}, goal[i], to_goal, dt) : AxisState{goal[i], 0.0, 0.0};
      x[i] = next.x, v[i] = next.v, a[i] = next.a;
    }
    const AxisState z = height({x[2], v[2], a[2]}, goal[2], dt);
    x[2] = z.x, v[2] = z.v, a[2] = z.a;
    time += dt;
  }

 private:
  // Time to the goal from a height, with a speed upwards [s]; a foot below it has yet to rise until it is due.
  double falling(double z, double speed) const {
    const double up = std::max(speed, 0.0) / kFalls, far = z + 0.5 * kFalls * up * up - goal[2];
    return up + std::sqrt(kQuintic / kFalls * (left() > kLead ? std::fabs(far) : std::max(far, 0.0)));
  }
  // z after dt: up to the top, down to the goal, and on; a path that changes has time for both.
  AxisState height(const AxisState& now, double to, double dt) {
    const double rest = left() - kLead, wanted = std::max(kRise * duration, cleared_);
    if (wanted != aimed_ && !falls_) {
      aimed_ = wanted, peak_ = std::max(wanted, time + kFollows);
      falls_ = duration - kLead - peak_ < falling(top_, 0.0);
    }
    const double up = peak_ - time;
    if (!falls_ && up >= dt) return quintic(now, top_, up, dt);
    if (!falls_) {
      falls_ = true;
      if (up > 0.0) return quintic({top_, 0.0, 0.0}, to, rest - up, dt - up, -search);  // over the top within this tick
    }
    if (rest >= dt) return quintic(now, to, rest, dt, -search);
    const double late = std::min(dt, dt - rest), z = rest > 0.0 ? to : now.x, speed = rest > 0.0 ? -search : now.v;
    const double a = std::max(std::min(now.a, 0.0) - kSinks * late, -kFalls);
    const double found = z + late * (speed + 0.5 * a * late), lowest = to - depth;
    return found > lowest ? AxisState{found, speed + a * late, a} : AxisState{lowest, 0.0, 0.0};
  }
  static Four seen(Four to, const Four& before) {  // with the yaw within half a turn of that of `before`
    to[3] = before[3] + wrapped(to[3] - before[3]);
    return to;
  }

  double moved_ = -kFollows, top_ = 0.0, above_ = 0.0;
  double peak_ = 0.0, aimed_ = 0.0, cleared_ = -std::numeric_limits<double>::infinity();  // times of the highest point
  bool falls_ = false;
};

}  // namespace hqp
