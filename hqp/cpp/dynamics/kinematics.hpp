// Forward kinematics of a tree of joints, written where rows read placements and twists; steps of its configuration.
#pragma once

#include <utility>
#include <vector>

#include "spatial.hpp"

namespace hqp {

// Continuous: cosine and sine in q. Planar: x, y, cosine and sine in q, along and about the axes of its own body.
enum class JointKind { kTurning, kContinuous, kSliding, kBall, kFree, kPlanar, kTranslating };

struct Placed {  // fixed in its parent; destination of its placement in the world, the rotation column-major
  int parent;
  Vec3 position;
  Mat3 rotation;
  double *position_out, *rotation_out;
};

struct TreeJoint {
  JointKind kind;
  int q, v;  // first place in a configuration, and in a velocity
  Vec3 axis;
  Placed placed;
};

class Kinematics {
 public:
  // Body 0 is the world, body i + 1 that of joint i. twists: (6, nv) column-major.
  Kinematics(std::vector<TreeJoint> joints, std::vector<Placed> frames, double* twists)
      : joints_(std::move(joints)),
        frames_(std::move(frames)),
        twists_(twists),
        positions_(joints_.size() + 1),
        rotations_(joints_.size() + 1) {
    rotations_[0] = {{axis(0), axis(1), axis(2)}};
    for (const TreeJoint& joint : joints_) {
      size_ = std::max(size_, joint.q + sizes(joint.kind).first);
    }
  }

  int size() const { return size_; }  // numbers of a configuration
  // Number of entries of a joint in a configuration, and in a velocity.
  static std::pair<int, int> sizes(JointKind kind) {
    const auto [first, count] = unit_part(kind);
    const int q = count ? first + count : kind == JointKind::kTranslating ? 3 : 1;
    return {q, kind == JointKind::kContinuous ? 1 : q == 7 ? 6 : q > 1 ? 3 : 1};
  }
  static constexpr double kRounding = 1e-12;  // ROUNDING and UNIT_TOLERANCE of robots/checks.py
  static constexpr double kUnit = 1e-3;
  // Return true if quaternions and pairs of cosine and sine have length one, up to that.
  bool unit(const double* q, double rounding) const {
    for (const TreeJoint& joint : joints_) {
      const auto [first, count] = unit_part(joint.kind);
      double square = count ? -1.0 : 0.0;
      for (int i = 0; i < count; ++i) square += q[joint.q + first + i] * q[joint.q + first + i];
      if (!(std::fabs(square) < rounding)) return false;
    }
    return true;
  }

  // Give quaternions and pairs of cosine and sine length one; the first place in q of one that is too far from it, -1
  // for none, its length, and whether it is a pair.
  int normalise(double* q, double most, double& length, bool& pair) const {
    for (const TreeJoint& joint : joints_) {
      const auto [first, count] = unit_part(joint.kind);
      double square = 0.0;
      for (int i = 0; i < count; ++i) square += q[joint.q + first + i] * q[joint.q + first + i];
      length = std::sqrt(square), pair = count == 2;
      if (count && !(std::fabs(length - 1.0) <= most)) return joint.q + first;
      for (int i = 0; i < count; ++i) q[joint.q + first + i] /= length;
    }
    return -1;
  }

  // Positions of joints by tangent coordinate; 0 for free bodies, for a joint of several axes the velocity that leads
  // there from its neutral position in one second.
  void angles(const double* q, double* out) const {
    for (const TreeJoint& joint : joints_) {
      const double* at = q + joint.q;
      double* to = out + joint.v;
      switch (joint.kind) {
        case JointKind::kTurning:
        case JointKind::kSliding:
          to[0] = at[0];
          break;
        case JointKind::kContinuous:
          to[0] = std::atan2(at[1], at[0]);
          break;
        case JointKind::kBall: {
          const double sign = at[3] < 0.0 ? -1.0 : 1.0,
                       length = std::sqrt(at[0] * at[0] + at[1] * at[1] + at[2] * at[2]);
          const double factor = length > 1e-8 ? 2.0 * std::atan2(length, sign * at[3]) / length : 2.0;
          for (int i = 0; i < 3; ++i) to[i] = factor * sign * at[i];
          break;
        }
        case JointKind::kFree:
          for (int i = 0; i < 6; ++i) to[i] = 0.0;
          break;
        case JointKind::kPlanar: {
          const double t = std::atan2(at[3], at[2]), half = 0.5 * t;
          const double a = std::fabs(t) > 1e-6 ? half * at[3] / (1.0 - at[2]) : 1.0 - t * t / 12.0;
          to[0] = a * at[0] + half * at[1];
          to[1] = a * at[1] - half * at[0];
          to[2] = t;
          break;
        }
        case JointKind::kTranslating:
          for (int i = 0; i < 3; ++i) to[i] = at[i];
      }
    }
  }

  void update(const double* q) {
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const TreeJoint& joint = joints_[i];
      const int parent = joint.placed.parent;
      Vec3 p = positions_[parent] + rotations_[parent] * joint.placed.position;
      Mat3 R = rotations_[parent] * joint.placed.rotation;
      const double* at = q + joint.q;
      switch (joint.kind) {
        case JointKind::kTurning:
          R = R * turn(joint.axis, std::cos(at[0]), std::sin(at[0]));
          break;
        case JointKind::kContinuous:
          R = R * turn(joint.axis, at[0], at[1]);
          break;
        case JointKind::kSliding:
          p = p + at[0] * (R * joint.axis);
          break;
        case JointKind::kBall:
          R = R * of_quaternion(at);
          break;
        case JointKind::kFree:
          p = p + R * load(at);
          R = R * of_quaternion(at + 3);
          break;
        case JointKind::kPlanar:
          p = p + at[0] * R.column[0] + at[1] * R.column[1];
          R = R * turn(joint.axis, at[2], at[3]);
          break;
        case JointKind::kTranslating:
          p = p + R * load(at);
      }
      positions_[i + 1] = p;
      rotations_[i + 1] = R;
      write(joint.placed, p, R);
      write_twists(joint, p, R);
    }
    for (const Placed& frame : frames_)
      write(frame, positions_[frame.parent] + rotations_[frame.parent] * frame.position,
            rotations_[frame.parent] * frame.rotation);
  }

  // The configuration after moving with velocity x for a time h.
  void integrate(const double* q, const double* x, double h, double* out) const {
    for (const TreeJoint& joint : joints_) {
      const double *at = q + joint.q, *u = x + joint.v;
      double* to = out + joint.q;
      switch (joint.kind) {
        case JointKind::kTurning:
        case JointKind::kSliding:
          to[0] = at[0] + h * u[0];
          break;
        case JointKind::kContinuous:
          turned(at, h * u[0], to);
          break;
        case JointKind::kBall:
          turned(at, h * load(u), to);
          break;
        case JointKind::kFree: {
          const Vec3 w = h * load(u + 3), moved = load(at) + of_quaternion(at + 3) * screw(h * load(u), w);
          turned(at + 3, w, to + 3);
          for (int i = 0; i < 3; ++i) to[i] = moved[i];
          break;
        }
        case JointKind::kPlanar: {
          const Vec3 way = screw({h * u[0], h * u[1], 0.0}, {0.0, 0.0, h * u[2]});
          const double c = at[2], s = at[3];
          to[0] = at[0] + c * way[0] - s * way[1];
          to[1] = at[1] + s * way[0] + c * way[1];
          turned(at + 2, h * u[2], to + 2);
          break;
        }
        case JointKind::kTranslating:
          for (int i = 0; i < 3; ++i) to[i] = at[i] + h * u[i];
      }
    }
  }

 private:
  static std::pair<int, int> unit_part(
      JointKind kind) {  // first and number of the entries of length one, in a joint's q
    switch (kind) {
      case JointKind::kContinuous:
        return {0, 2};
      case JointKind::kBall:
        return {0, 4};
      case JointKind::kFree:
        return {3, 4};
      case JointKind::kPlanar:
        return {2, 2};
      default:
        return {0, 0};
    }
  }
  static void write(const Placed& placed, const Vec3& p, const Mat3& R) {
    for (int i = 0; i < 3; ++i) placed.position_out[i] = p[i];
    for (int i = 0; i < 9; ++i) placed.rotation_out[i] = R.column[i / 3][i % 3];
  }
  void write_twists(const TreeJoint& joint, const Vec3& p, const Mat3& R) {
    double* out = twists_ + 6 * joint.v;
    switch (joint.kind) {
      case JointKind::kTurning:
      case JointKind::kContinuous:
        return write_turning(out, p, R * joint.axis);
      case JointKind::kSliding:
        return write(out, R * joint.axis, {});
      case JointKind::kPlanar:
        for (int i = 0; i < 2; ++i, out += 6) write(out, R.column[i], {});
        return write_turning(out, p, R.column[2]);
      case JointKind::kTranslating:
      case JointKind::kFree:
        for (int i = 0; i < 3; ++i, out += 6) write(out, R.column[i], {});
        if (joint.kind == JointKind::kTranslating) return;
        [[fallthrough]];
      case JointKind::kBall:
        for (int i = 0; i < 3; ++i, out += 6) write_turning(out, p, R.column[i]);
    }
  }
  static void write_turning(double* out, const Vec3& p, const Vec3& axis) { write(out, cross(p, axis), axis); }
  static void write(double* out, const Vec3& linear, const Vec3& angular) {
    for (int i = 0; i < 3; ++i) {
      out[i] = linear[i];
      out[3 + i] = angular[i];
    }
  }

  static Mat3 turn(const Vec3& a, double c, double s) {
    const double k = 1.0 - c;
    return {{{c + k * a[0] * a[0], k * a[0] * a[1] + s * a[2], k * a[0] * a[2] - s * a[1]},
             {k * a[0] * a[1] - s * a[2], c + k * a[1] * a[1], k * a[1] * a[2] + s * a[0]},
             {k * a[0] * a[2] + s * a[1], k * a[1] * a[2] - s * a[0], c + k * a[2] * a[2]}}};
  }
  static Mat3 of_quaternion(const double* q) {  // x, y, z, w
    const double x = q[0], y = q[1], z = q[2], w = q[3];
    return {{{1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)},
             {2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)},
             {2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)}}};
  }
  static void turned(const double* q, const Vec3& w, double* out) {  // q times the exponential of w
    const double t = std::sqrt(dot(w, w)), c = std::cos(0.5 * t), s = t > 1e-8 ? std::sin(0.5 * t) / t : 0.5;
    const Vec3 e = s * w, u{q[0], q[1], q[2]}, v = q[3] * e + c * u + cross(u, e);
    out[3] = q[3] * c - dot(u, e);
    for (int i = 0; i < 3; ++i) out[i] = v[i];
    normalise(out, 4);
  }
  static void turned(const double* at, double angle, double* out) {  // a cosine and a sine
    const double c = std::cos(angle), s = std::sin(angle), cosine = at[0] * c - at[1] * s;
    out[1] = at[1] * c + at[0] * s;
    out[0] = cosine;
    normalise(out, 2);
  }
  static Vec3 screw(const Vec3& u, const Vec3& w) {  // displacement of a body that moves with u and turns with w
    const double square = dot(w, w), t = std::sqrt(square);
    const double a = t > 1e-4 ? (1.0 - std::cos(t)) / square : 0.5 - square / 24.0;
    const double b = t > 1e-4 ? (t - std::sin(t)) / (square * t) : 1.0 / 6.0 - square / 120.0;
    const Vec3 across = cross(w, u);
    return u + a * across + b * cross(w, across);
  }
  static void normalise(double* a, int n) {
    double square = 0.0;
    for (int i = 0; i < n; ++i) square += a[i] * a[i];
    for (int i = 0; i < n; ++i) a[i] /= std::sqrt(square);
  }

  std::vector<TreeJoint> joints_;
  std::vector<Placed> frames_;
  double* twists_;
  int size_ = 0;
  std::vector<Vec3> positions_;
  std::vector<Mat3> rotations_;
};

}  // namespace hqp
