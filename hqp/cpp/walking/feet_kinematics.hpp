// Centre of mass, soles and their velocities for a state, from a robot's joints and bodies alone.
#pragma once

#include <cmath>
#include <utility>
#include <vector>

#include "../dynamics/kinematics.hpp"
#include "../rows/planned.hpp"
#include "../rows/relative_frame.hpp"

namespace hqp {

inline double yaw_of(const Mat3& R) { return std::atan2(R.column[0][1], R.column[0][0]); }

class FeetKinematics {
 public:
  // motion: joints, frames, bodies and twists of a plan; feet: frames of the soles.
  template <class Plan>
  FeetKinematics(const Plan& motion, const std::vector<Plan>& feet, int nv)
      : kinematics_(joints(motion.part("joints"), nv), frames(motion.part("frames"), motion.parts("joints").size()),
                    twists(motion, nv)),
        tree_(bodies(motion.part("bodies"), nv), twists(motion, nv)),
        nv_(nv) {
    for (const Plan& one : feet) feet_.push_back(one.frame(tree_));
    tree_.need_motions(), tree_.need_centres();
  }
  FeetKinematics(const FeetKinematics&) = delete;

  void update(const double* q, const double* v) {
    kinematics_.update(q);
    tree_.update(v);
  }
  int nq() const { return kinematics_.size(); }
  int nv() const { return nv_; }
  std::size_t feet() const { return feet_.size(); }
  Vec3 position(std::size_t foot) const { return load(feet_[foot].position); }
  Mat3 rotation(std::size_t foot) const { return load_rotation(feet_[foot].rotation); }
  Vec3 velocity(std::size_t foot) const { return tree_.motion(feet_[foot].body).at(position(foot)); }
  Vec3 turn(std::size_t foot) const { return tree_.motion(feet_[foot].body).angular; }
  Vec3 com() const { return 1.0 / tree_.mass(0) * tree_.moment(0); }
  Vec3 com_velocity() const {
    Vec3 momentum{};
    for (int b = 1; b < static_cast<int>(tree_.bodies().size()); ++b)
      momentum = momentum + tree_.own_mass(b) * tree_.motion(b).at(tree_.centre(b));
    return 1.0 / tree_.mass(0) * momentum;
  }

 private:
  template <class Plan>
  static double* twists(const Plan& motion, int nv) {
    return motion.doubles("twists", 6 * static_cast<std::size_t>(nv));
  }

  Kinematics kinematics_;
  Tree tree_;
  std::vector<Frame> feet_;
  int nv_;
};

}  // namespace hqp
