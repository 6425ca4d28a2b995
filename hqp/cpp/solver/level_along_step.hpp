// A level along a step: ||w||^2 / 2 of its rows at v + alpha c is a convex piecewise quadratic in alpha.
#pragma once

#include "table.hpp"

namespace hqp {
inline namespace HQP_ISA {

struct LevelAlongStep {
  const Table& table;
  const Block& level;
  const double* v;       // (rows,) A x at the start
  const double* change;  // (rows,) A times the step

  // Its slope at alpha, and its curvature there.
  double slope(double alpha, double& curvature) const {
    const Vec4 a = splat(alpha), zero = splat(0.0);
    Vec4 slopes = zero, curvatures = zero;
    int r = level.begin;
    for (; r + kLane <= level.end; r += kLane) {
      const Vec4 c = unaligned(change + r), value = unaligned(v + r) + a * c;
      const Vec4 lower = unaligned(table.lower + r), upper = unaligned(table.upper + r);
      const Vec4 out = value > upper ? value - upper : value < lower ? value - lower : zero;
      slopes += c * out;
      curvatures += out != zero ? c * c : zero;
    }
    double s = sum(slopes);
    curvature = sum(curvatures);
    for (; r < level.end; ++r) {
      const double c = change[r], out = table.beyond(r, v[r] + alpha * c);
      s += c * out;
      if (out != 0.0) curvature += c * c;
    }
    return s;
  }

  // Return the minimiser on [0, alpha]: Newton within a bracket, down to a slope of `flat` times that at 0.
  double lowest(double alpha, double flat) const {
    double curvature, low = 0.0, high = alpha, a = alpha;
    const double least = flat * std::fabs(slope(0.0, curvature));
    for (int turn = 0; turn < kEnough; ++turn) {
      const double s = slope(a, curvature);
      if (a == alpha && s <= least) return alpha;
      if (std::fabs(s) <= least) break;
      if (s > 0.0) high = a;
      else low = a;
      const double newton = a - s / curvature;
      a = newton > low && newton < high ? newton : 0.5 * (low + high);
    }
    return a < alpha * (1.0 - kNoRate) ? a : alpha;
  }
};

}  // namespace HQP_ISA
}  // namespace hqp
