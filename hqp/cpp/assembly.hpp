// Rows of the common tasks, written straight from Pinocchio's arrays: one call a tick for all of them.
//
// Every operation holds the addresses it reads and writes; all arrays outlive it (the binding keeps references).
// Twists are (6, nv) column-major, linear first, at the world's origin: column c gives the velocity
// twist_v + twist_w x p of a body's point p when coordinate c moves.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

namespace hqp {

struct Target {  // where one element's rows go
  double* J;     // (m, nv) row-major
  double* error;
  const double* reference;
  double weight;
  int nv;
};

struct Frame {  // a frame's live placement and the coordinates that move it
  const double* position;
  const double* rotation;  // (3, 3) column-major
  const double* twists;
  std::vector<int> columns;
};

class Operation {
 public:
  virtual ~Operation() = default;
  virtual void run(const double* q, const double* v) = 0;
};

// Rotation vector of R R0^T: R column-major, R0 row-major with the given stride. Through the quaternion, which is
// accurate at every angle.
inline void rotation_error(const double* R, const double* R0, int stride, double* out) {
  double E[3][3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      E[i][j] = R[i] * R0[j * stride] + R[3 + i] * R0[j * stride + 1] + R[6 + i] * R0[j * stride + 2];
  const double trace = E[0][0] + E[1][1] + E[2][2];
  double w, u[3];
  if (trace > 0.0) {
    const double s = 2.0 * std::sqrt(1.0 + trace);
    w = 0.25 * s;
    u[0] = (E[2][1] - E[1][2]) / s;
    u[1] = (E[0][2] - E[2][0]) / s;
    u[2] = (E[1][0] - E[0][1]) / s;
  } else {
    const int i = E[0][0] > E[1][1] ? (E[0][0] > E[2][2] ? 0 : 2) : (E[1][1] > E[2][2] ? 1 : 2);
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    const double s = 2.0 * std::sqrt(std::max(0.0, 1.0 + E[i][i] - E[j][j] - E[k][k]));
    w = (E[k][j] - E[j][k]) / s;
    u[i] = 0.25 * s;
    u[j] = (E[i][j] + E[j][i]) / s;
    u[k] = (E[i][k] + E[k][i]) / s;
    if (w < 0.0) {
      w = -w;
      for (double& x : u) x = -x;
    }
  }
  const double sine = std::sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
  const double scale = sine > 1e-12 ? 2.0 * std::atan2(sine, w) / sine : 2.0;
  for (int i = 0; i < 3; ++i) out[i] = scale * u[i];
}

// Row of the velocity along axis a of the point p.
inline void linear_row(const Frame& f, const double* p, int a, double weight, double* J) {
  const int b = (a + 1) % 3, c = (a + 2) % 3;
  for (const int column : f.columns) {
    const double* t = f.twists + 6 * column;
    J[column] = weight * (t[a] + t[3 + b] * p[c] - t[3 + c] * p[b]);
  }
}

// Row of the angular velocity along u.
inline void angular_row(const Frame& f, double x, double y, double z, double weight, double* J) {
  for (const int column : f.columns) {
    const double* t = f.twists + 6 * column + 3;
    J[column] = weight * (x * t[0] + y * t[1] + z * t[2]);
  }
}

class Point final : public Operation {  // position of a frame's point along chosen world axes
 public:
  Point(Target out, Frame frame, std::vector<int> axes, const double* offset)
      : out_(out), frame_(std::move(frame)), axes_(std::move(axes)) {
    std::copy(offset, offset + 3, offset_);
  }
  void run(const double*, const double*) override {
    double p[3];
    for (int i = 0; i < 3; ++i) {
      p[i] = frame_.position[i];
      for (int j = 0; j < 3; ++j) p[i] += frame_.rotation[3 * j + i] * offset_[j];
    }
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      linear_row(frame_, p, axes_[i], out_.weight, out_.J + i * out_.nv);
      out_.error[i] = p[axes_[i]] - out_.reference[i];
    }
  }

 private:
  Target out_;
  Frame frame_;
  std::vector<int> axes_;
  double offset_[3];
};

class Pose final : public Operation {  // a frame's pose in world axes; reference (4, 4) row-major
 public:
  Pose(Target out, Frame frame) : out_(out), frame_(std::move(frame)) {}
  void run(const double*, const double*) override {
    const double* p = frame_.position;
    for (int i = 0; i < 3; ++i) {
      linear_row(frame_, p, i, out_.weight, out_.J + i * out_.nv);
      angular_row(frame_, i == 0, i == 1, i == 2, out_.weight, out_.J + (3 + i) * out_.nv);
      out_.error[i] = p[i] - out_.reference[4 * i + 3];
    }
    rotation_error(frame_.rotation, out_.reference, 4, out_.error + 3);
  }

 private:
  Target out_;
  Frame frame_;
};

class Rotation final : public Operation {  // a frame's orientation in world axes; reference (3, 3) row-major
 public:
  Rotation(Target out, Frame frame) : out_(out), frame_(std::move(frame)) {}
  void run(const double*, const double*) override {
    for (int i = 0; i < 3; ++i) angular_row(frame_, i == 0, i == 1, i == 2, out_.weight, out_.J + i * out_.nv);
    rotation_error(frame_.rotation, out_.reference, 3, out_.error);
  }

 private:
  Target out_;
  Frame frame_;
};

class Angles final : public Operation {  // roll, pitch, yaw of a frame: rows of E(rpy)^-1 J_w
 public:
  Angles(Target out, Frame frame, std::vector<int> picked, double gimbal)
      : out_(out), frame_(std::move(frame)), picked_(std::move(picked)), gimbal_(gimbal) {}
  void run(const double*, const double*) override {
    constexpr double kTurn = 6.283185307179586476925;
    const double* R = frame_.rotation;
    const double angle[3] = {std::atan2(R[5], R[8]), std::atan2(-R[2], std::sqrt(R[0] * R[0] + R[1] * R[1])),
                             std::atan2(R[1], R[0])};
    const double c = std::cos(angle[2]), s = std::sin(angle[2]);
    const double inverse = 1.0 / std::max(std::cos(angle[1]), gimbal_), tangent = std::sin(angle[1]) * inverse;
    const double rows[3][3] = {{c * inverse, s * inverse, 0.0}, {-s, c, 0.0}, {c * tangent, s * tangent, 1.0}};
    for (std::size_t i = 0; i < picked_.size(); ++i) {
      const double* u = rows[picked_[i]];
      angular_row(frame_, u[0], u[1], u[2], out_.weight, out_.J + i * out_.nv);
      out_.error[i] = std::remainder(angle[picked_[i]] - out_.reference[i], kTurn);
    }
  }

 private:
  Target out_;
  Frame frame_;
  std::vector<int> picked_;
  double gimbal_;
};

class Com final : public Operation {  // the whole robot's centre of mass; jacobian (3, nv) column-major
 public:
  Com(Target out, const double* com, const double* jacobian, std::vector<int> axes)
      : out_(out), com_(com), jacobian_(jacobian), axes_(std::move(axes)) {}
  void run(const double*, const double*) override {
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      double* J = out_.J + i * out_.nv;
      for (int c = 0; c < out_.nv; ++c) J[c] = out_.weight * jacobian_[3 * c + axes_[i]];
      out_.error[i] = com_[axes_[i]] - out_.reference[i];
    }
  }

 private:
  Target out_;
  const double *com_, *jacobian_;
  std::vector<int> axes_;
};

class Joints final : public Operation {  // positions of single-axis joints; J is constant and not written
 public:
  Joints(Target out, std::vector<int> positions) : out_(out), positions_(std::move(positions)) {}
  void run(const double* q, const double*) override {
    for (std::size_t i = 0; i < positions_.size(); ++i) out_.error[i] = q[positions_[i]] - out_.reference[i];
  }

 private:
  Target out_;
  std::vector<int> positions_;
};

struct Limits {  // of k joints; see JointLimits for the equations
  std::vector<int> positions, columns;
  std::vector<double> low, high, speed;
  double acceleration;  // infinite for none
  double return_velocity;
  double dt;
  int order;
};

class Box final : public Operation {  // one consistent box for the next step
 public:
  Box(double* lower, double* upper, Limits limits) : lower_(lower), upper_(upper), limits_(std::move(limits)) {}
  void run(const double* q, const double* v) override {
    const Limits& l = limits_;
    for (std::size_t i = 0; i < l.positions.size(); ++i) {
      const double at = q[l.positions[i]], rate = v[l.columns[i]];
      double up = towards(l.high[i] - at, l.speed[i]), down = -towards(at - l.low[i], l.speed[i]);
      if (std::isfinite(l.acceleration)) {
        const double reach = l.acceleration * l.dt;
        down = std::min(std::max(down, rate - reach), rate + reach);
        up = std::min(std::max(up, rate - reach), rate + reach);
      }
      if (l.order == 2) {
        down = (down - rate) / l.dt;
        up = (up - rate) / l.dt;
      }
      lower_[i] = down;
      upper_[i] = up;
    }
  }

 private:
  double towards(double way, double speed) const {  // largest speed towards a limit that is `way` off
    const Limits& l = limits_;
    if (way < 0.0) return std::max(way / l.dt, -std::min(speed, l.return_velocity));
    double most = way / l.dt;
    if (std::isfinite(l.acceleration))
      most = l.acceleration * (std::sqrt(l.dt * l.dt + 2.0 * way / l.acceleration) - l.dt);
    return std::min(most, speed);
  }

  double *lower_, *upper_;
  Limits limits_;
};

}  // namespace hqp
