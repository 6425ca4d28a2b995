// Distances between a capsule and other shapes: steps equal to those of tasks/distances.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "../dynamics/spatial.hpp"

namespace hqp {

struct Distance {
  double value;      // between the surfaces, negative inside
  Vec3 normal;       // from the capsule to the other
  Vec3 point;        // nearest of the capsule's axis
  int feature = -1;  // nearest of a hull, -1 for none
};

struct Segment {
  Vec3 a, b;
};

class Measure {
 public:
  // Squared sine below which axes count as parallel; distance of axes below which they give no normal [m].
  static constexpr double kParallel = 1e-9, kTouching = 1e-9;

  static Distance capsule(const Segment& one, double radius, const Segment& two, double other) {
    const Vec3 u = one.b - one.a, v = two.b - two.a;
    double s, t;
    nearest(one, two, s, t);
    const Vec3 p = one.a + s * u, w = two.a + t * v - p;
    const double length = std::sqrt(dot(w, w));
    if (length > kTouching) return {length - radius - other, (1.0 / length) * w, p};
    return {-radius - other, across(u, v), p};
  }

  static Distance half_space(const Segment& one, double radius, const Vec3& origin, const Mat3& R) {
    const Vec3 &n = R.column[2], u = one.b - one.a;
    const double low = dot(n, one.a - origin), high = dot(n, one.b - origin), gap = high - low;
    const double s = std::fabs(gap) <= kParallel * std::sqrt(dot(u, u)) ? 0.5 : (gap < 0.0 ? 1.0 : 0.0);
    return {std::min(low, high) - radius, -1.0 * n, one.a + s * u};
  }

  static Distance box(const Segment& one, double radius, const Vec3& half, const Vec3& origin, const Mat3& R) {
    const Vec3 p = transposed(R, one.a - origin), u = transposed(R, one.b - origin) - p;
    double s = outside(p, u, half);
    const Vec3 off = beyond(p + s * u, half);
    const double length = std::sqrt(dot(off, off));
    const Vec3 along = one.b - one.a;
    if (length > kTouching) return {length - radius, R * ((-1.0 / length) * off), one.a + s * along};
    Vec3 outward;
    const double depth = inside(p, u, half, outward, s);
    return {-depth - radius, R * (-1.0 * outward), one.a + s * along};
  }

  static void nearest(const Segment& one, const Segment& two, double& s, double& t) {
    const Vec3 u = one.b - one.a, v = two.b - two.a, w = two.a - one.a;
    const double A = dot(u, u), B = dot(u, v), C = dot(v, v), D = dot(u, w), E = dot(v, w);
    constexpr double tiny = kTouching * kTouching;
    s = t = 0.0;
    if (A <= tiny && C <= tiny) return;
    if (A <= tiny) {
      t = share(-E / C);
      return;
    }
    if (C <= tiny) {
      s = share(D / A);
      return;
    }
    const double square = A * C - B * B;
    s = square > kParallel * A * C ? share((D * C - B * E) / square) : 0.5 * (share(D / A) + share((D + B) / A));
    t = (B * s - E) / C;
    if (t < 0.0) {
      s = share(D / A);
      t = 0.0;
    } else if (t > 1.0) {
      s = share((D + B) / A);
      t = 1.0;
    }
  }

 private:
  static double share(double x) { return std::min(std::max(x, 0.0), 1.0); }

  static Vec3 beyond(const Vec3& at, const Vec3& half) {
    Vec3 off;
    for (int i = 0; i < 3; ++i) off[i] = at[i] - std::min(std::max(at[i], -half[i]), half[i]);
    return off;
  }

  // Share where p + s u is nearest to the box: the zero of a slope that is piecewise linear and rises.
  static double outside(const Vec3& p, const Vec3& u, const Vec3& half) {
    double stops[8] = {0.0, 1.0};
    int count = 2;
    for (int i = 0; i < 3; ++i)
      if (std::fabs(u[i]) > kTouching) {
        stops[count++] = share((-half[i] - p[i]) / u[i]);
        stops[count++] = share((half[i] - p[i]) / u[i]);
      }
    std::sort(stops, stops + count);
    const auto slope = [&](double s) { return dot(u, beyond(p + s * u, half)); };
    double first = -1.0, last = -1.0;
    for (int k = 0; k + 1 < count; ++k) {
      const double left = stops[k], right = stops[k + 1], low = slope(left), high = slope(right);
      if (low >= 0.0 && first < 0.0) first = left;
      if (high <= 0.0) last = right;
      else if (low < 0.0 && 0.0 < high) return left - low * (right - left) / (high - low);
    }
    return first < 0.0 ? 1.0 : 0.5 * (first + std::max(first, std::max(last, 0.0)));
  }

  // The shortest way that takes the segment out of the box, across a face or across an edge and the segment, its
  // direction, and the share of the last point out.
  static double inside(const Vec3& p, const Vec3& u, const Vec3& half, Vec3& outward, double& s) {
    double best = std::numeric_limits<double>::infinity();
    const Vec3 q = p + u;
    for (int i = 0; i < 3; ++i)
      for (const double sign : {-1.0, 1.0}) {
        const double depth = half[i] - sign * (sign * u[i] < 0.0 ? q[i] : p[i]);
        if (!(depth < best)) continue;
        best = depth;
        outward = sign * axis(i);
        s = std::fabs(u[i]) <= kTouching ? 0.5 : (sign * u[i] < 0.0 ? 1.0 : 0.0);
      }
    for (int i = 0; i < 3; ++i) {
      const Vec3 w = cross(u, axis(i));
      const double size = std::sqrt(dot(w, w));
      if (size <= kTouching) continue;
      for (const double sign : {-1.0, 1.0}) {
        const Vec3 normal = (sign / size) * w;
        double reach = 0.0;
        for (int k = 0; k < 3; ++k) reach += std::fabs(normal[k]) * half[k];
        const double depth = reach - dot(normal, p);
        if (!(depth < best)) continue;
        best = depth;
        outward = normal;
        Segment edge;
        for (int k = 0; k < 3; ++k) edge.a[k] = edge.b[k] = std::copysign(half[k], normal[k]);
        edge.a[i] = -half[i];
        edge.b[i] = half[i];
        double t;
        nearest({p, q}, edge, s, t);
      }
    }
    return best;
  }

  static Vec3 across(const Vec3& u, const Vec3& v) {
    Vec3 w = cross(u, v);
    if (dot(w, w) <= kParallel * dot(u, u) * dot(v, v)) {
      const Vec3& longer = dot(u, u) >= dot(v, v) ? u : v;
      int i = 0;
      for (int k = 1; k < 3; ++k)
        if (std::fabs(longer[k]) < std::fabs(longer[i])) i = k;
      w = cross(longer, axis(i));
    }
    const double size = std::sqrt(dot(w, w));
    return size > 0.0 ? (1.0 / size) * w : Vec3{0.0, 0.0, 1.0};
  }
};

}  // namespace hqp
