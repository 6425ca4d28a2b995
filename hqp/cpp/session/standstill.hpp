// Coming to rest: the state that it starts from, the braking and the stops.
#pragma once

#include <memory>
#include <vector>

#include "guard_parts.hpp"
#include "halt.hpp"
#include "latest.hpp"
#include "left_out.hpp"
#include "line.hpp"
#include "rest.hpp"

namespace hqp {

class Standstill {
 public:
  // live: true if a program writes into the line's arrays between ticks.
  template <class Node>
  Standstill(const Node& root, Line& line, Foreign* foreign, bool live, const RobotNames& robot, const Latest& latest,
             LeftOut& left_out)
      : line_(line),
        foreign_(foreign),
        live_(live),
        latest_(latest),
        left_out_(left_out),
        rest_(hqp::rest(root, line, robot)),
        halt_(hqp::halt(root, line)),
        angles_(latest.v.size()) {}

  Rest& rest() { return *rest_; }
  const Rest& rest() const { return *rest_; }
  Halt& halt() { return *halt_; }
  // Share stops with another session; return false if they are shared already, so that other threads may read them.
  bool join(const Standstill& other) {
    if (halt_ == other.halt_) return false;
    return halt_ = other.halt_, true;
  }

  // State of the tick, or the last valid one.
  RestFrom from(bool last) {
    const RestFrom found = at(last);
    if (live_ && line_.torque() && !last && !elsewhere()) {
      line_.write(latest_.q.data(), latest_.v.data(), latest_.around());  // explanations read the rows of this tick
      left_out_.free();
      line_.rewrite(latest_.v.data());
    }
    return found;
  }
  // Write the torque that holds the robot up into x.
  void hold_up(double* x) {
    rest_->begin(at(false), x, true);
    rest_->next(x);
  }

 private:
  bool elsewhere() const { return foreign_ && (foreign_->fills || !line_.kinematics()); }  // Python has the state
  RestFrom at(bool last) {
    if (elsewhere()) return foreign_->start(last);
    const double* q = last ? latest_.valid_q.data() : latest_.q.data();
    const double* v = last ? latest_.valid_v.data() : latest_.v.data();
    RestFrom found;
    line_.kinematics()->angles(q, angles_.data());
    found.angles = angles_.data(), found.v = v;
    if (line_.torque() && line_.at_rest(q, v)) found.holding = line_.holding(), found.momentum = line_.momentum();
    return found;
  }

  Line& line_;
  Foreign* foreign_;
  bool live_;
  const Latest& latest_;
  LeftOut& left_out_;
  std::unique_ptr<Rest> rest_;
  std::shared_ptr<Halt> halt_;  // shared by all lines of a session
  std::vector<double> angles_;
};

}  // namespace hqp
