// Directions and distances: an axis along a direction or towards a point, frames some way apart, cones. See
// tasks/directions.py and tasks/cone.py for the equations.
#pragma once

#include "barrier.hpp"

namespace hqp {

constexpr double kNear = 1e-6;  // least distance to which there is a direction [m]

struct Axis {  // axis of a frame: a unit vector in its axes, and two across it
  Vec3 along, first, other;
};

struct Sight {  // desired direction of an axis, and its change as the frame's origin moves
  Vec3 direction;
  double distance;  // distance of the point, infinite for a direction
};

inline Sight sight(const double* reference, const Vec3& origin, bool point) {
  const Vec3 r = load(reference);
  if (!point) return {r, std::numeric_limits<double>::infinity()};
  const Vec3 way = r - origin;
  const double d = std::max(std::sqrt(dot(way, way)), kNear);
  return {(1.0 / d) * way, d};
}

// Direction of an axis: its direction, or the point 1 m ahead.
inline bool ahead(const Vec3& origin, const Vec3& along, bool point, double* value) {
  for (int i = 0; i < 3; ++i) value[i] = (point ? origin[i] : 0.0) + along[i];
  return true;
}

class Pointing final : public Operation, Rows {  // two rows across an axis; reference (3,): a direction or a point
 public:
  Pointing(Rows rows, Axis axis, bool point) : Rows(std::move(rows)), axis_(axis), point_(point) {}
  void run(const double*, const double*) override {
    const Vec3 p = origin();
    const Mat3 R = rotation();
    const Sight s = sight(out_.reference, p, point_);
    const Vec3 u = R * axis_.along, B[2] = {R * axis_.first, R * axis_.other};
    const Vec3 off = cross(s.direction, u);
    const double sine[2] = {dot(B[0], off), dot(B[1], off)}, size = std::hypot(sine[0], sine[1]);
    const double cosine = dot(s.direction, u);
    const double factor = size < 1e-9 ? 0.0 : std::atan2(size, cosine) / size;
    for (int i = 0; i < 2; ++i) {
      const Vec3 across = (1.0 / s.distance) * cross(B[i], s.direction);
      write_form(i, {across, cross(p, across) + B[i]});
      out_.error[i] = factor * sine[i];
    }
    if (size < 1e-9 && !(cosine > 0.0)) out_.error[0] = 3.14159265358979323846;  // half a turn about one of them
    if (out_.drift) write_drift(s, p, B);
  }
  bool hold(const double*, const double*, double* value) override {
    return ahead(origin(), rotation() * axis_.along, point_, value);
  }

 private:
  void write_drift(const Sight& s, const Vec3& p, const Vec3 (&B)[2]) {
    const Vec3 omega = motion().angular, alpha = body_drift().angular, &w = s.direction;
    Vec3 turn{}, rate{};  // angular velocity of the line of sight, and its change
    if (point_) {
      const Vec3 v = motion().at(p), a = tree_.point_drift(frame_.body, p);
      const double closing = dot(w, v), share = 1.0 / s.distance;
      const Vec3 w_rate = -share * (v - closing * w);
      turn = share * cross(w, v);
      rate = share * (cross(w_rate, v) + cross(w, a)) + share * closing * turn;
    }
    for (int i = 0; i < 2; ++i) out_.drift[i] = dot(B[i], alpha + rate) + dot(cross(omega, B[i]), omega + turn);
  }

  Axis axis_;
  bool point_;
};

class Apart final : public Operation, Rows {  // distance of two frames' origins; reference (1,)
 public:
  explicit Apart(Rows rows) : Rows(std::move(rows)) {}
  void run(const double*, const double*) override {
    relative_.update();
    const Vec3 p = origin(), way = p - relative_.origin();
    const double d = std::sqrt(dot(way, way));
    const Vec3 n = d > kNear ? (1.0 / d) * way : Vec3{1.0, 0.0, 0.0};
    write_pair(0, along(n, p), along(n, relative_.origin()));
    out_.error[0] = d - out_.reference[0];
    if (!out_.drift) return;
    const int other = relative_.body();
    const Vec3 o = relative_.origin(), v = motion().at(p) - tree_.motion(other).at(o);
    const Vec3 across = v - dot(n, v) * n, a = tree_.point_drift(frame_.body, p) - tree_.point_drift(other, o);
    out_.drift[0] = dot(n, a) + dot(across, across) / std::max(d, kNear);
  }
  bool hold(const double* q, const double* v, double* value) override {
    return hold_value(*this, out_, 1, q, v, value);
  }
};

class Cone final : public Operation, Rows {  // an axis no further than an angle from a direction or a point
 public:
  Cone(Rows rows, Axis axis, bool point, double angle, Barrier barrier, int order)
      : Rows(std::move(rows)), axis_(axis), point_(point), angle_(angle), barrier_(barrier), order_(order) {}
  void run(const double*, const double* v) override {
    const Vec3 p = origin(), u = rotation() * axis_.along;
    const Sight s = sight(out_.reference, p, point_);
    const Vec3 &w = s.direction, turn = cross(u, w);
    const double cosine = dot(u, w), sine = std::sqrt(dot(turn, turn)), edge = std::cos(angle_);
    const bool inside = cosine >= edge;
    const double scale = inside ? std::sin(angle_) : std::max(sine, kStraightBack);
    const double way = inside ? (cosine - edge) / scale : angle_ - std::atan2(sine, cosine);
    const Vec3 across = (-1.0 / (s.distance * scale)) * (u - cosine * w);
    write_form(0, {across, cross(p, across) + (1.0 / scale) * turn});
    out_.upper[0] = std::numeric_limits<double>::infinity();
    double speed = 0.0;
    for (const int c : frame_.columns) speed += out_.row(0)[c] * v[c];
    const double along = -dot(u, across_of(load(out_.reference + 3), w)) / (scale * (point_ ? s.distance : 1.0));
    speed = speed / out_.weight - along;
    if (order_ == 1) {
      out_.lower[0] = along - barrier_.next(way, -speed);
      return;
    }
    const double drift =
        inside ? second(s, u, p) / scale : (second(s, u, p) + cosine * square(first(s, u, p) / scale)) / scale;
    out_.lower[0] = -barrier_.hardest(way, -speed) - drift;
  }
  bool hold(const double*, const double*, double* value) override {
    std::fill(value, value + 9, 0.0);
    return ahead(origin(), rotation() * axis_.along, point_, value);
  }

 private:
  static constexpr double kStraightBack = 1e-3;  // least sine with which an axis that points away has a way back
  static double square(double x) { return x * x; }

  static Vec3 across_of(const Vec3& x, const Vec3& w) { return x - dot(w, x) * w; }

  Vec3 rate(const Sight& s, const Vec3& p) const {  // rate of the direction
    const Vec3 carried = load(out_.reference + 3);
    if (!point_) return across_of(carried, s.direction);
    return (-1.0 / s.distance) * across_of(motion().at(p) - carried, s.direction);
  }
  double first(const Sight& s, const Vec3& u, const Vec3& p) const {  // derivative of the cosine
    return dot(cross(motion().angular, u), s.direction) + dot(u, rate(s, p));
  }
  double second(const Sight& s, const Vec3& u, const Vec3& p) const {
    const Vec3 omega = motion().angular, u1 = cross(omega, u), w1 = rate(s, p);
    const Vec3 u2 = cross(body_drift().angular, u) + cross(omega, u1);
    const double found = dot(u2, s.direction) + 2.0 * dot(u1, w1);
    const Vec3 &w = s.direction, pushed = load(out_.reference + 6);
    if (!point_) return found + dot(u, across_of(pushed, w) - dot(w1, w1) * w);
    const Vec3 v = motion().at(p) - load(out_.reference + 3), a = tree_.point_drift(frame_.body, p) - pushed;
    const double closing = dot(w, v), share = 1.0 / s.distance;
    const Vec3 w2 = -share * (a - (dot(w1, v) + dot(w, a)) * w - closing * w1) + (closing * share) * w1;
    return found + dot(u, w2);
  }

  Axis axis_;
  bool point_;
  double angle_;
  Barrier barrier_;
  int order_;
};

}  // namespace hqp
