// Forward kinematics as Python asks for it: a robot's joints and frames, and their live views.
#pragma once

#include <tuple>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "live_plan.hpp"

namespace binding {

using Fixed = std::tuple<int, Numbers, Numbers, std::tuple<Written, WrittenColumns>>;  // parent, placement, live views
using Joint = std::tuple<int, int, int, Numbers, Fixed>;                               // kind, q, v, axis

// Forward kinematics of a robot, written into its live views.
class LiveKinematics {
 public:
  LiveKinematics(const WrittenColumns& twists, const std::vector<Joint>& joints, const std::vector<Fixed>& frames)
      : kinematics_(tree(joints), placed(frames), keep(twists)) {}
  LiveKinematics(const LiveKinematics&) = delete;

  hqp::Kinematics& get() { return kinematics_; }
  void update(const Vector& q) { kinematics_.update(q.data()); }
  void integrate(const Vector& q, const Vector& x, double h, const Written& out) {
    kinematics_.integrate(q.data(), x.data(), h, out.data());
  }

 private:
  static hqp::Mat3 matrix(const Numbers& a) {
    if (a.size() != 9) throw nb::value_error("a rotation has nine numbers");
    return hqp::load_rotation(a.data());
  }
  hqp::Placed placed(const Fixed& fixed) {
    const auto& [parent, position, rotation, views] = fixed;
    return {parent, vector(position), matrix(rotation), keep(std::get<0>(views)), keep(std::get<1>(views))};
  }
  std::vector<hqp::Placed> placed(const std::vector<Fixed>& all) {
    std::vector<hqp::Placed> found;
    for (const Fixed& fixed : all) found.push_back(placed(fixed));
    return found;
  }
  std::vector<hqp::TreeJoint> tree(const std::vector<Joint>& joints) {
    std::vector<hqp::TreeJoint> found;
    for (const auto& [kind, q, v, axis, fixed] : joints)
      found.push_back({static_cast<hqp::JointKind>(kind), q, v, vector(axis), placed(fixed)});
    return found;
  }
  template <typename Array>
  auto keep(const Array& array) -> decltype(array.data()) {
    kept_.push_back(nb::cast(array));
    return array.data();
  }

  std::vector<nb::object> kept_;  // before what points into it
  hqp::Kinematics kinematics_;
};

}  // namespace binding
