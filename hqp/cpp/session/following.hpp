// Measured joints compared with the commands that a session has sent.
#pragma once

#include <memory>
#include <vector>

#include "follow_watch.hpp"
#include "latest.hpp"
#include "line.hpp"

namespace hqp {

class Following {
 public:
  // watch: null if the plan compares no joints.
  Following(Line& line, const Foreign* foreign, std::unique_ptr<FollowWatch> watch)
      : line_(line), foreign_(foreign), watch_(std::move(watch)), angles_(std::size_t(line.nv())) {}

  // Begin a tick at that time [s].
  void begin(double now) {
    if (watch_) watch_->pass(now);
  }
  // Return false, and the reason, if the measured joints do not follow.  angles: joints of the state, if the line has
  // no kinematics.  aside: the command is a blend with that of another session, unknown here.
  template <class Report>
  bool check(const Latest& latest, const double* angles, bool aside, Note& why, const Report& report) {
    if (!watch_) return true;
    if (aside) return watch_->reset(), true;
    if (!angles) line_.kinematics()->angles(latest.q.data(), angles_.data()), angles = angles_.data();
    return watch_->follow(angles, latest.v.data(), why, report);
  }
  // Pass the motion that x demands of the motors; solved: true if the dynamics are those of this tick.
  void sent(const double* x, bool solved) {
    if (!watch_) return;
    const TorqueParts* torque = line_.torque();
    if (torque && (!solved || (foreign_ && foreign_->fills))) return watch_->unknown();
    watch_->sent([&](std::size_t joint) { return torque ? torque->acceleration(joint, x) : x[joint]; },
                 [&](std::size_t motor) { return torque->felt(motor); });
  }
  void reset() {
    if (watch_) watch_->reset();
  }
  void drop() { watch_.reset(); }
  void follow(const Following& other) {
    if (watch_ && other.watch_) *watch_ = *other.watch_;
  }

 private:
  Line& line_;
  const Foreign* foreign_;
  std::unique_ptr<FollowWatch> watch_;
  std::vector<double> angles_;
};

}  // namespace hqp
