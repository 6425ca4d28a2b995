// Position, orientation and pose of a frame, in the world or relative to another frame; a fixed edge.
#pragma once

#include "rows.hpp"
#include "whole_turns.hpp"

namespace hqp {

class Point final : public Operation, Rows {  // position of a frame's point along chosen axes
 public:
  Point(Rows rows, std::vector<int> axes, Vec3 offset)
      : Rows(std::move(rows)), axes_(std::move(axes)), offset_(offset) {}
  void run(const double*, const double*) override {
    relative_.update();
    const Vec3 p = origin() + rotation() * offset_, d = p - relative_.origin();
    const Vec3 drift = out_.drift ? relative_drift(p) : Vec3{};
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      const Vec3& u = relative_.axes().column[axes_[i]];
      write_velocity(i, u, p);
      out_.error[i] = dot(u, d) - out_.reference[i];
      if (out_.drift) out_.drift[i] = drift[axes_[i]];
    }
  }
  bool hold(const double* q, const double* v, double* value) override {
    return hold_value(*this, out_, static_cast<int>(axes_.size()), q, v, value);
  }

 private:
  std::vector<int> axes_;
  Vec3 offset_;
};

class Pose final : public Operation, Rows {  // reference (4, 4) row-major
 public:
  explicit Pose(Rows rows) : Rows(std::move(rows)) {}
  void run(const double*, const double*) override {
    relative_.update();
    const Vec3 p = origin(), d = p - relative_.origin();
    const Vec3 turn = rotation_error(transposed(relative_.axes(), rotation()), out_.reference, 4);
    for (int i = 0; i < 3; ++i) {
      const Vec3& u = relative_.axes().column[i];
      write_velocity(i, u, p);
      write_turning(3 + i, u);
      out_.error[i] = dot(u, d) - out_.reference[4 * i + 3];
      out_.error[3 + i] = turn[i];
    }
    if (!out_.drift) return;
    const Vec3 linear = relative_drift(p), angular = relative_.turn_drift(tree_, motion(), body_drift());
    for (int i = 0; i < 3; ++i) {
      out_.drift[i] = linear[i];
      out_.drift[3 + i] = angular[i];
    }
  }
  bool hold(const double*, const double*, double* value) override {
    relative_.update();
    const Vec3 p = transposed(relative_.axes(), origin() - relative_.origin());
    const Mat3 R = transposed(relative_.axes(), rotation());
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j < 3; ++j) value[4 * i + j] = R.column[j][i];
      value[4 * i + 3] = p[i];
      value[12 + i] = 0.0;
    }
    value[15] = 1.0;
    return true;
  }
};

class Rotation final : public Operation, Rows {  // reference (3, 3) row-major
 public:
  explicit Rotation(Rows rows) : Rows(std::move(rows)) {}
  void run(const double*, const double*) override {
    relative_.update();
    const Vec3 turn = rotation_error(transposed(relative_.axes(), rotation()), out_.reference, 3);
    const Vec3 drift = out_.drift ? relative_.turn_drift(tree_, motion(), body_drift()) : Vec3{};
    for (int i = 0; i < 3; ++i) {
      write_turning(i, relative_.axes().column[i]);
      out_.error[i] = turn[i];
      if (out_.drift) out_.drift[i] = drift[i];
    }
  }
  bool hold(const double*, const double*, double* value) override {
    relative_.update();
    const Mat3 R = transposed(relative_.axes(), rotation());
    for (int i = 0; i < 9; ++i) value[i] = R.column[i % 3][i / 3];
    return true;
  }
};

class Angles final : public Operation, Rows {  // roll, pitch, yaw: rows of E(rpy)^-1 J_w
 public:
  Angles(Rows rows, std::vector<int> picked, double gimbal)
      : Rows(std::move(rows)), picked_(std::move(picked)), gimbal_(gimbal) {}
  void run(const double*, const double*) override {
    relative_.update();
    const Mat3 R = transposed(relative_.axes(), rotation());
    const Vec3 &x = R.column[0], angle{std::atan2(R.column[1][2], R.column[2][2]),
                                       std::atan2(-x[2], std::sqrt(x[0] * x[0] + x[1] * x[1])), std::atan2(x[1], x[0])};
    const double c = std::cos(angle[2]), s = std::sin(angle[2]), cp = std::cos(angle[1]), sp = std::sin(angle[1]);
    const double inverse = 1.0 / std::max(cp, gimbal_), tangent = sp * inverse;
    const Vec3 rows[3] = {{c * inverse, s * inverse, 0.0}, {-s, c, 0.0}, {c * tangent, s * tangent, 1.0}};
    for (std::size_t i = 0; i < picked_.size(); ++i) {
      write_turning(i, relative_.axes() * rows[picked_[i]]);
      out_.error[i] = std::remainder(angle[picked_[i]] - out_.reference[i], kTurn);
    }
    if (!out_.drift) return;
    const Vec3 omega = relative_.turn_velocity(tree_, motion());
    const double roll = dot(rows[0], omega), pitch = dot(rows[1], omega), yaw = dot(rows[2], omega);
    const Vec3 axes_rate{roll * (-sp * c * pitch - cp * s * yaw) - pitch * c * yaw,  // dE/dt (roll, pitch, yaw rates)
                         roll * (-sp * s * pitch + cp * c * yaw) - pitch * s * yaw, -roll * cp * pitch};
    const Vec3 left = relative_.turn_drift(tree_, motion(), body_drift()) - axes_rate;
    for (std::size_t i = 0; i < picked_.size(); ++i) out_.drift[i] = dot(rows[picked_[i]], left);
  }
  bool hold(const double* q, const double* v, double* value) override {
    return hold_value(*this, out_, static_cast<int>(picked_.size()), q, v, value);
  }

 private:
  std::vector<int> picked_;
  double gimbal_;
};

class Edge final : public Operation, Rows {  // position, and tilt across an edge; reference (6,): position, direction
 public:
  Edge(Rows rows, Vec3 edge, Vec3 first, Vec3 other) : Rows(std::move(rows)), edge_(edge), across_{first, other} {}
  void run(const double*, const double*) override {
    const Vec3 p = origin();
    const Mat3 R = rotation();
    const Vec3 tilt = cross(load(out_.reference + 3), R * edge_);
    for (int i = 0; i < 3; ++i) {
      write_velocity(i, axis(i), p);
      out_.error[i] = p[i] - out_.reference[i];
    }
    const Vec3 linear = out_.drift ? relative_drift(p) : Vec3{};
    for (int i = 0; out_.drift && i < 3; ++i) out_.drift[i] = linear[i];
    for (int k = 0; k < 2; ++k) {
      const Vec3 u = R * across_[k];
      write_turning(3 + k, u);
      out_.error[3 + k] = dot(u, tilt);
      if (out_.drift) out_.drift[3 + k] = dot(u, body_drift().angular);
    }
  }
  bool hold(const double*, const double*, double* value) override {
    const Vec3 p = origin(), along = rotation() * edge_;
    for (int i = 0; i < 3; ++i) value[i] = p[i], value[3 + i] = along[i];
    return true;
  }

 private:
  Vec3 edge_, across_[2];
};

// Position of a frame, and tilt of an axis, relative to another frame that has the axis; reference (6,): position, and
// direction of the axis in the frame.
class Hinge final : public Operation, Rows {
 public:
  Hinge(Rows rows, Vec3 axis, Vec3 first, Vec3 other) : Rows(std::move(rows)), axis_(axis), across_{first, other} {}
  void run(const double*, const double*) override {
    relative_.update();
    const Vec3 p = origin(), d = p - relative_.origin();
    const Vec3 tilt = cross(axis_, transposed(relative_.axes(), rotation()) * load(out_.reference + 3));
    for (int i = 0; i < 3; ++i) {
      const Vec3& u = relative_.axes().column[i];
      write_velocity(i, u, p);
      out_.error[i] = dot(u, d) - out_.reference[i];
    }
    for (int k = 0; k < 2; ++k) {
      write_turning(3 + k, relative_.axes() * across_[k]);
      out_.error[3 + k] = dot(across_[k], tilt);
    }
    if (!out_.drift) return;
    const Vec3 linear = relative_drift(p), angular = relative_.turn_drift(tree_, motion(), body_drift());
    for (int i = 0; i < 3; ++i) out_.drift[i] = linear[i];
    for (int k = 0; k < 2; ++k) out_.drift[3 + k] = dot(across_[k], angular);
  }
  bool hold(const double*, const double*, double* value) override {
    relative_.update();
    const Vec3 p = transposed(relative_.axes(), origin() - relative_.origin());
    const Vec3 along = transposed(rotation(), relative_.axes() * axis_);
    for (int i = 0; i < 3; ++i) value[i] = p[i], value[3 + i] = along[i];
    return true;
  }

 private:
  Vec3 axis_, across_[2];
};

}  // namespace hqp
