// Known loads in the equation of motion A qdd + b + g = ...: payloads, wrenches, loads of joints. See tasks/loads.py.
#pragma once

#include <vector>

#include "relative_frame.hpp"

namespace hqp {

struct KnownLoad {
  Frame frame;
  const double* value;  // mass and point (3,) in the frame's axes position of a payload; force and moment of a wrench
  bool wrench, local;   // local: the wrench is in the frame's axes
  bool resisted;        // true if the holding torque compensates the load, too
};

// An inertia on the diagonal of A and a live torque for each of these coordinates.
struct KnownJointLoad {
  std::vector<int> columns;
  std::vector<double> inertia;
  const double* torque;
};

class KnownLoads {
 public:
  void add(KnownJointLoad load) { joints_.push_back(std::move(load)); }
  void add(KnownLoad load) {
    speeds_.reserve(std::max(speeds_.capacity(), load.frame.columns.size()));
    loads_.push_back(std::move(load));
  }

  // A: (nv, nv) column-major, its upper triangle; bias: b + g (nv,).
  void apply(const Tree& tree, const Vec3& gravity, double* A, double* bias) {
    const int nv = tree.size();
    for (const KnownJointLoad& load : joints_)
      for (std::size_t k = 0; k < load.columns.size(); ++k) {
        const std::ptrdiff_t c = load.columns[k];
        A[c * nv + c] += load.inertia[k];
        bias[c] -= load.torque[k];
      }
    for (const KnownLoad& load : loads_) {
      if (load.wrench) {
        push(tree, load, bias);
        continue;
      }
      const double m = load.value[0];
      if (m == 0.0) continue;
      const Vec3 p = place(load);
      const Vec3 a = tree.point_drift(load.frame.body, p) - gravity;
      const std::vector<int>& columns = load.frame.columns;
      speeds_.clear();
      for (const int c : columns) {
        const double* t = tree.twist(c);
        speeds_.push_back(hqp::load(t) + cross(hqp::load(t + 3), p));
        bias[c] += m * dot(speeds_.back(), a);
      }
      for (std::size_t j = 0; j < columns.size(); ++j)
        for (std::size_t i = 0; i <= j; ++i)  // columns ascend
          A[static_cast<std::ptrdiff_t>(columns[j]) * nv + columns[i]] += m * dot(speeds_[i], speeds_[j]);
    }
  }

  // Contribution of the loads to g (nv).
  void weigh(const Tree& tree, const Vec3& gravity, double* g) const {
    for (const KnownJointLoad& load : joints_)
      for (std::size_t k = 0; k < load.columns.size(); ++k) g[load.columns[k]] -= load.torque[k];
    for (const KnownLoad& load : loads_) {
      if (load.wrench) {
        if (load.resisted) push(tree, load, g);
        continue;
      }
      const Vec3 p = place(load), weight = load.value[0] * gravity;
      for (const int c : load.frame.columns) {
        const double* t = tree.twist(c);
        g[c] -= dot(hqp::load(t) + cross(hqp::load(t + 3), p), weight);
      }
    }
  }

 private:
  static Vec3 place(const KnownLoad& load) {  // centre of a payload
    return hqp::load(load.frame.position) + load_rotation(load.frame.rotation) * hqp::load(load.value + 1);
  }
  static void push(const Tree& tree, const KnownLoad& load, double* bias) {
    const Vec3 origin = hqp::load(load.frame.position);
    const Mat3 R = load_rotation(load.frame.rotation);
    Vec3 force = hqp::load(load.value), moment = hqp::load(load.value + 3);
    if (load.local) force = R * force, moment = R * moment;
    moment = moment + cross(origin, force);
    for (const int c : load.frame.columns) {
      const double* t = tree.twist(c);
      bias[c] -= dot(force, hqp::load(t)) + dot(moment, hqp::load(t + 3));
    }
  }

  std::vector<KnownLoad> loads_;
  std::vector<KnownJointLoad> joints_;
  std::vector<Vec3> speeds_;
};

}  // namespace hqp
