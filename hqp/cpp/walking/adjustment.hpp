// Step adjustment after a push. See walking/adjustment.py for the equations.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "footsteps.hpp"

namespace hqp {

struct Landing {
  Foothold stance, foothold;
  Vec2 offset;  // offset of the DCM from the foothold at the landing
  double left;  // time until the landing [s]

  Vec2 dcm(double omega, double before) const {
    const Vec2 zmp = stance.xy();
    return zmp + std::exp(-omega * before) * (foothold.xy() + offset - zmp);
  }
};

struct Correction {  // bounds of a correction
  Vec2 now;          // place of the foot, which moves no faster than `speed`
  double soonest, latest, usual, speed, least;
};

constexpr int kLandingTimes = 24;  // landing times compared
constexpr double kMeets = 10.0;    // weight of the DCM error relative to changes of foothold and time

// Foothold and time left with which the DCM is least off at the landing, then nearest to the planned ones.
inline std::pair<Foothold, double> adjusted(const Landing& planned, const Footsteps& footsteps, const Vec2& error,
                                            const Vec2& ankle, double omega, const Correction& bounds) {
  const Foothold &stance = planned.stance, &nominal = planned.foothold;
  const Vec2 zmp = stance.xy();
  const auto seen = [&](const Vec2& v) { return turned_back(stance.yaw, v); };
  Vec2 e = seen(error), dz = seen(ankle);
  const auto alone = [](double& off, double& by) {  // a ZMP beyond the DCM leads it back
    if (off * by > 0.0 && std::fabs(by) >= std::fabs(off)) off = by = 0.0;
  };
  alone(e.x, dz.x), alone(e.y, dz.y);
  const Vec2 grown = dz + std::exp(omega * planned.left) * (e - dz);
  const double size = std::hypot(grown.x, grown.y);
  if (size <= bounds.least) return {nominal, planned.left};
  const double part = 1.0 - bounds.least / size;
  e = part * e, dz = part * dz;
  const Vec2 start = seen(planned.dcm(omega, planned.left) - zmp) + e, offset = seen(planned.offset);
  const Vec2 step = seen(nominal.xy() - zmp), foot = seen(bounds.now - zmp);
  const Reach& reach = footsteps.reach;
  const double out = Footsteps::outwards(nominal.side);
  const Vec2 low{-reach.forward, std::min(out * reach.least, out * reach.most)};
  const Vec2 high{reach.forward, std::max(out * reach.least, out * reach.most)};
  const double wide[2] = {reach.forward, reach.most - reach.least}, square = kMeets * kMeets;
  const double last = std::max(bounds.latest, bounds.soonest), gap = (last - bounds.soonest) / (kLandingTimes - 1);
  double cheapest = std::numeric_limits<double>::infinity(), left = planned.left;
  Vec2 best = step;
  for (int k = 0; k <= kLandingTimes; ++k) {
    const double L = k == kLandingTimes       ? held(planned.left, bounds.soonest, bounds.latest)
                     : k == kLandingTimes - 1 ? last
                                              : k * gap + bounds.soonest;
    const double far = std::max(bounds.speed * L, 1e-3);
    const Vec2 xi = dz + std::exp(omega * L) * (start - dz);
    const auto nearest = [&](double target, double planned_step, double at, double least, double most) {
      const double from = held(at - far, least, most), to = held(at + far, least, most);
      return held((square * target + planned_step) / (square + 1.0), from, to);
    };
    const Vec2 u{nearest(xi.x - offset.x, step.x, foot.x, low.x, high.x),
                 nearest(xi.y - offset.y, step.y, foot.y, low.y, high.y)};
    const Vec2 missed = xi - offset - u, moved = u - step;
    const auto weighed = [&](const Vec2& v) {
      return (v.x / wide[0]) * (v.x / wide[0]) + (v.y / wide[1]) * (v.y / wide[1]);
    };
    const double later = (L - bounds.usual) / footsteps.period;
    const double cost = square * weighed(missed) + weighed(moved) + later * later;
    if (cost < cheapest) cheapest = cost, left = L, best = u;
  }
  const Vec2 at = zmp + turned(stance.yaw, best);
  Foothold found = nominal;
  found.x = at.x, found.y = at.y;
  return {footsteps.within(found, stance), left};
}

}  // namespace hqp
