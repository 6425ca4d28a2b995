// Torques that hold joints against gravity, as shares of their motors' limits; see tasks/holding_torque.py for the
// equations.
#pragma once

#include <vector>

#include "rows.hpp"

namespace hqp {

class HoldingTorque final : public Operation {
 public:
  HoldingTorque(Target out, const Tree& tree, const std::vector<int>& columns, const std::vector<double>& limits,
                const Vec3& gravity)
      : out_(out), tree_(tree), moved_(tree.size()), rates_(tree.bodies().size()), changes_(tree.bodies().size()) {
    for (std::size_t i = 0; i < columns.size(); ++i) {
      Held held{columns[i], (-1.0 / limits.at(i)) * gravity, {}, {}};
      const int body = tree_.owner(held.column);
      for (int c = 0; c < tree_.size(); ++c) {
        if (tree_.carries(body, tree_.owner(c))) {
          held.carried.push_back(c);
        } else if (tree_.carries(tree_.owner(c), body)) {
          held.carrying.push_back(c);
        }
      }
      held_.push_back(std::move(held));
    }
  }

  void run(const double*, const double*) override {
    for (int c = 0; c < tree_.size(); ++c) {
      const int b = tree_.owner(c);
      moved_[c] = tree_.mass(b) * load(tree_.twist(c)) + cross(load(tree_.twist(c) + 3), tree_.moment(b));
    }
    if (out_.drift) gather();
    for (std::size_t i = 0; i < held_.size(); ++i) {
      const Held& held = held_[i];
      const Vec3 &own = moved_[held.column], &n = held.down;
      const Vec3 within = out_.weight * cross(n, load(tree_.twist(held.column) + 3)),
                 above = out_.weight * cross(own, n);
      double* J = out_.row(static_cast<int>(i));
      for (const int c : held.carried) J[c] = dot(within, moved_[c]);
      for (const int c : held.carrying) J[c] = dot(above, load(tree_.twist(c) + 3));
      out_.error[i] = dot(n, own) - out_.reference[i];
      if (out_.drift) out_.drift[i] = dot(n, second(held.column));
    }
  }
  bool hold(const double* q, const double* v, double* value) override {
    return hold_value(*this, out_, static_cast<int>(held_.size()), q, v, value);
  }

 private:
  struct Held {
    int column;
    Vec3 down;                           // minus gravity over the limit
    std::vector<int> carried, carrying;  // coordinates of the joint's subtree, coordinates of its ancestors
  };

  void gather() {  // first and second derivative of the moments of all that each body carries, at zero acceleration
    const int n = static_cast<int>(tree_.bodies().size());
    for (int b = 0; b < n; ++b) {
      const Vec3& p = tree_.centre(b);
      rates_[b] = tree_.own_mass(b) * tree_.motion(b).at(p);
      changes_[b] = tree_.own_mass(b) * tree_.point_drift(b, p);
    }
    for (int b = n; b-- > 1;) {
      const int parent = tree_.bodies()[b].parent;
      rates_[parent] = rates_[parent] + rates_[b];
      changes_[parent] = changes_[parent] + changes_[b];
    }
  }
  Vec3 second(int c) const {  // derivative of a coordinate's subtree
    const int b = tree_.owner(c);
    const Motion twist{load(tree_.twist(c)), load(tree_.twist(c) + 3)}, t1 = cross(tree_.motion(b), twist);
    const Motion t2 = cross(tree_.drift(b), twist) + cross(tree_.motion(b), t1);
    return tree_.mass(b) * t2.linear + cross(t2.angular, tree_.moment(b)) + 2.0 * cross(t1.angular, rates_[b]) +
           cross(twist.angular, changes_[b]);
  }

  Target out_;
  const Tree& tree_;
  std::vector<Held> held_;
  std::vector<Vec3> moved_;  // mass times velocity of the centre of mass of a coordinate's subtree
  std::vector<Vec3> rates_, changes_;
};

}  // namespace hqp
