// Frames relative to another one: the world, another frame, or that frame's heading. Formulas in tasks/relative.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "../dynamics/tree.hpp"

namespace hqp {

struct Frame {  // a frame's live placement, the body it is on and the coordinates that move it
  const double* position;
  const double* rotation;  // (3, 3) column-major
  int body;
  std::vector<int> columns;
};

// Turns with Omega = H omega of its frame: H = 0 for the world, I for a frame, z h^T for a heading.
class RelativeFrame {
 public:
  enum class Kind { kWorld, kFrame, kHeading };

  RelativeFrame() = default;
  // upright: least horizontal length of the x axis that a heading rate is computed with.
  RelativeFrame(Frame frame, bool heading, double upright)
      : kind_(heading ? Kind::kHeading : Kind::kFrame), frame_(std::move(frame)), least_(upright * upright) {}

  void update() {  // once a tick, before anything else
    if (kind_ == Kind::kWorld) return;
    origin_ = load(frame_.position);
    axes_ = load_rotation(frame_.rotation);
    if (kind_ == Kind::kFrame) return;
    x_ = axes_.column[0];
    square_ = x_[0] * x_[0] + x_[1] * x_[1];
    const double length = std::sqrt(square_);
    const double c = length > 0.0 ? x_[0] / length : 1.0, s = length > 0.0 ? x_[1] / length : 0.0;
    square_ = std::max(square_, least_);
    yaw_ = {-x_[2] * x_[0] / square_, -x_[2] * x_[1] / square_, 1.0};
    axes_ = Mat3{{{c, s, 0.0}, {-s, c, 0.0}, {0.0, 0.0, 1.0}}};
  }

  const Vec3& origin() const { return origin_; }
  const Mat3& axes() const { return axes_; }
  const std::vector<int>& columns() const { return frame_.columns; }
  int body() const { return frame_.body; }

  // u . (dp_o/dt + Omega x d) and u . Omega as forms on the motion of its body.
  Form carried(const Vec3& u, const Vec3& point) const {
    if (kind_ != Kind::kHeading) return along(u, point);
    const Vec3 d = point - origin_;
    return {u, cross(origin_, u) + (d[0] * u[1] - d[1] * u[0]) * yaw_};
  }
  Form turned(const Vec3& u) const { return about(kind_ == Kind::kHeading ? u[2] * yaw_ : u); }

  // Drift, along the axes, of a world point with that velocity and drift.
  Vec3 point_drift(const Tree& tree, const Vec3& point, const Vec3& velocity, const Vec3& drift) const {
    if (kind_ == Kind::kWorld) return drift;
    const auto [turn, rate] = turning(tree);
    const Vec3 d = point - origin_, moving = velocity - tree.motion(frame_.body).at(origin_);
    const Vec3 apparent = drift - tree.point_drift(frame_.body, origin_) - cross(rate, d);
    return transposed(axes_, apparent - 2.0 * cross(turn, moving) + cross(turn, cross(turn, d)));
  }
  // A body's angular velocity, and its drift, along the axes.
  Vec3 turn_velocity(const Tree& tree, const Motion& motion) const {
    return kind_ == Kind::kWorld ? motion.angular : transposed(axes_, motion.angular - turning(tree).first);
  }
  Vec3 turn_drift(const Tree& tree, const Motion& motion, const Motion& drift) const {
    if (kind_ == Kind::kWorld) return drift.angular;
    const auto [turn, rate] = turning(tree);
    return transposed(axes_, drift.angular - rate - cross(turn, motion.angular - turn));
  }

 private:
  std::pair<Vec3, Vec3> turning(const Tree& tree) const {  // Omega and its rate
    const Vec3 omega = tree.motion(frame_.body).angular, alpha = tree.drift(frame_.body).angular;
    if (kind_ == Kind::kFrame) return {omega, alpha};
    // yaw rate = (x dy - y dx) / rho^2 of the x axis, differentiated once more
    const double yaw_rate = dot(yaw_, omega);
    const Vec3 dx = cross(omega, x_), ddx = cross(alpha, x_) + cross(omega, dx);
    const double stretch = 2.0 * yaw_rate * (x_[0] * dx[0] + x_[1] * dx[1]);
    return {{0.0, 0.0, yaw_rate}, {0.0, 0.0, (x_[0] * ddx[1] - x_[1] * ddx[0] - stretch) / square_}};
  }

  Kind kind_ = Kind::kWorld;
  Frame frame_{};
  double least_ = 0.0, square_ = 1.0;
  Vec3 origin_{}, x_{}, yaw_{};
  Mat3 axes_{{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}};
};

}  // namespace hqp
