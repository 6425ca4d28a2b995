// Centre of mass of the robot or of the subtree of one of its joints.
#pragma once

#include "rows.hpp"

namespace hqp {

// Coordinate c moves the bodies it carries, all of the part or some: J_c = (m t_v + t_w x (m p)) / M, m and p theirs.
class Com final : public Operation, Rows {
 public:
  Com(Rows rows, int part, std::vector<int> axes) : Rows(std::move(rows)), part_(part), axes_(std::move(axes)) {
    const std::vector<Body>& bodies = tree_.bodies();
    for (int b = 1; b < static_cast<int>(bodies.size()); ++b) {
      const bool inside = tree_.carries(part_, b);
      if (inside) bodies_.push_back(b);
      if (!inside && !tree_.carries(b, part_)) continue;
      for (int c = bodies[b].first; c < bodies[b].first + bodies[b].count; ++c)
        columns_.push_back({c, inside ? b : part_});
    }
  }
  void run(const double*, const double*) override {
    relative_.update();
    const double share = 1.0 / tree_.mass(part_);
    const Vec3 p = share * tree_.moment(part_), d = p - relative_.origin();
    const Vec3 drift = out_.drift ? relative_centre_drift(p, share) : Vec3{};
    for (std::size_t i = 0; i < axes_.size(); ++i) {
      const Vec3& u = relative_.axes().column[axes_[i]];
      clear_carried(i);
      double* J = out_.row(i);
      for (const Column& column : columns_) {
        const double* t = tree_.twist(column.index);
        const Vec3 moved = tree_.mass(column.body) * load(t) + cross(load(t + 3), tree_.moment(column.body));
        J[column.index] = out_.weight * share * dot(u, moved);
      }
      subtract_carried(i, relative_.carried(u, p));
      out_.error[i] = dot(u, d) - out_.reference[i];
      if (out_.drift) out_.drift[i] = drift[axes_[i]];
    }
  }
  bool hold(const double* q, const double* v, double* value) override {
    return hold_value(*this, out_, static_cast<int>(axes_.size()), q, v, value);
  }

 private:
  struct Column {
    int index, body;
  };

  Vec3 relative_centre_drift(const Vec3& p, double share) const {
    Vec3 velocity{}, drift{};
    for (const int b : bodies_) {
      const double m = share * tree_.own_mass(b);
      velocity = velocity + m * tree_.motion(b).at(tree_.centre(b));
      drift = drift + m * tree_.point_drift(b, tree_.centre(b));
    }
    return relative_.point_drift(tree_, p, velocity, drift);
  }

  int part_;
  std::vector<int> axes_, bodies_;
  std::vector<Column> columns_;
};

}  // namespace hqp
