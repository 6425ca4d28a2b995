// Python interface of forward kinematics: a robot's joints and frames, and their live views.
#pragma once

#include <vector>

#include "../common/capsule.hpp"
#include "live_plan.hpp"
#include "planned.hpp"

namespace binding {

// Forward kinematics of a robot, written into its live views.
class LiveKinematics {
 public:
  LiveKinematics(const WrittenColumns& twists, const nb::object& joints, const nb::object& frames)
      : kinematics_(hqp::joints(LivePlan(joints, kept_), static_cast<int>(twists.shape(1))),
                    hqp::frames(LivePlan(frames, kept_), LivePlan(joints, kept_).parts().size()), twists.data()),
        twists_(nb::cast(twists)) {}
  LiveKinematics(const LiveKinematics&) = delete;

  hqp::Kinematics& get() { return kinematics_; }
  nb::capsule core() { return hqp::capsule_of_part(&kinematics_, "hqp.kinematics"); }
  void update(const Vector& q) { kinematics_.update(q.data()); }
  void integrate(const Vector& q, const Vector& x, double h, const Written& out) {
    kinematics_.integrate(q.data(), x.data(), h, out.data());
  }

 private:
  std::vector<nb::object> kept_;  // declared before the pointers into it
  hqp::Kinematics kinematics_;
  nb::object twists_;
};

}  // namespace binding
