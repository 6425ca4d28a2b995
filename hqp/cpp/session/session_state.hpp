// Parts of a session and their state between ticks.
#pragma once

#include <algorithm>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "following.hpp"
#include "guard_parts.hpp"
#include "inputs.hpp"
#include "latest.hpp"
#include "left_out.hpp"
#include "limit_notes.hpp"
#include "outgoing.hpp"
#include "standstill.hpp"
#include "timing.hpp"

namespace hqp {

class SessionState {
 public:
  template <class Node, class Source>
  SessionState(const Node& root, const Source& source)
      : kept_(source.kept()),
        foreign_(source.foreign()),
        line_(root, source.parts(), foreign_),
        robot_(RobotNames::of(root, line_)),
        check_(state_check(root, line_)),
        latest_(line_),
        left_out_(line_, foreign_),
        standstill_(root, line_, foreign_, Source::kLive, robot_, latest_, left_out_),
        motors_(motor_limits(root, line_, robot_)),
        jerk_(jerk_limiter(root, line_, robot_)),
        limiter_(rate_limiter(root, line_, robot_)),
        following_(line_, foreign_, follow_watch(root, line_, robot_)),
        timing_(root.part("guards").number("deadline")),
        inputs_(root, line_, foreign_, Source::kLive),
        limits_(line_),
        outgoing_(hqp::outgoing(root, line_, robot_)) {
    tick_.command_.resize(robot_.picks.size());
    tick_.x_.resize(latest_.x.size());
    tick_.residuals_.resize(line_.levels().size());
    tick_.marks_.resize(line_.rows());
    tick_.notes_.resize(Tick::kNotes + 2 * limits_.size());
    share();
  }

  // Start from the command that the robot is sent now: rates, braking, and at velocity level the window of
  // acceleration.  q, v: its state, null if unknown; angles: joints of q, if the line has no kinematics.
  // Throws ReferenceError for a command or a state that is not valid.
  void begin(const double* command, const double* q, const double* v, const double* angles = nullptr) {
    Note why;
    if (!(squared(command, int(robot_.picks.size())) < std::numeric_limits<double>::infinity()))
      throw ReferenceError("the command is not finite");
    latest_.placed = false;
    if (q) {
      std::copy(q, q + latest_.q.size(), latest_.q.begin());
      if (!check_.valid(latest_.q.data(), v, angles, why))
        throw ReferenceError("the state is not valid: " + why.text());
      latest_.keep_valid(v);
    }
    latest_.begin(command, robot_.picks, q ? v : nullptr);
    tick_.x_ = latest_.x;
    std::copy(command, command + tick_.command_.size(), tick_.command_.begin());
    tick_.held_ = 0, answered_ = false;
    outgoing_.trend().forget();
    following_.reset();
  }

  // Carry the state over to the next tick, without pending references and without the rows' state.
  void keep(CarryOver& state) {
    latest_.keep(state), state.take(ordinary_), outgoing_.trend().keep(state);
    state.take(tick_.count_), state.take(tick_.held_);
    if (tick_.held_ > 0) standstill_.rest().keep(state);
    limits_.keep(state), inputs_.keep(state);
    if (jerk_) jerk_->keep(state);
  }
  // Carry the state of rows and solver over, which sessions of one stack share.
  void keep_rows(CarryOver& state) {
    line_.assembly().keep(state);
    line_.solver()->keep(state);
  }
  // Exchange the warm starts of all sets of rows, which keep_rows() leaves.
  void exchange(WarmSets& sets) { line_.solver()->sets().exchange(sets); }
  // The first session of a stack, whose rows and solver are as new.
  void first() {
    CarryOver rows = CarryOver::to_first(initial_rows_);
    keep_rows(rows);
    line_.solver()->make_room(inputs_.size());
  }
  // Return rows and solver to the state of first().
  void reset_rows() {
    line_.solver()->reset();
    CarryOver state = CarryOver::from_first(initial_rows_);
    keep_rows(state);
  }
  // Return to the state after construction, except for rows, solver and stops.
  void renew() {
    CarryOver state = CarryOver::from_first(initial_);
    keep(state);
    latest_.timed = ordinary_ = false;
    timing_.unanswered();
    alone(latest_.x.data());
    inputs_.renew();
    following_.reset();
  }
  // Another session of the stack will write into the rows; before the first tick.
  void share_rows() { inputs_.references().share(), share(); }
  // Share counters and stops with another session.
  void join(const SessionState& other) {
    if (standstill_.join(other.standstill_)) timing_.share_counters(other.timing_);
  }
  // Continue from another session of the robot, after x was sent.
  void follow(const SessionState& other, const double* x) {
    latest_.follow(other.latest_, x), timing_.follow(other.timing_), following_.follow(other.following_);
    tick_.count_ = other.tick_.count_;
    hold(other.tick_.held_, other.resting());
    if (jerk_ && other.jerk_) jerk_->follow(*other.jerk_);
    join(other);
    age_noted_ = other.age_noted_;
  }
  // Run beside a session that blends both answers: without rate limits, in half of the time.
  void aside() {
    inputs_.attend_anew();
    if (!std::exchange(aside_, true)) timing_.halve();
  }
  // Run alone again, after x was sent: references hold for one tick.
  void alone(const double* x) {
    aside_ = false, inputs_.lasting(false), line_.ahead(nullptr);
    timing_.whole();
    std::copy(x, x + latest_.x.size(), latest_.x.begin());
  }
  // Go on coming to rest after so many ticks without a usable answer, as another session does.
  void hold(std::int64_t held, const Rest& resting) {
    tick_.held_ = held;
    standstill_.rest().follow(resting);
  }
  // Finish every answer from now on, and accept states of any age.
  void without_deadline() {
    check_.of_any_age(), following_.drop(), timing_.without_deadline();
    line_.solver()->limit(0.0);
  }

  Inputs& inputs() { return inputs_; }
  const Inputs& inputs() const { return inputs_; }
  Timing& timing() { return timing_; }
  const Timing& timing() const { return timing_; }
  const Latest& latest() const { return latest_; }
  Halt& halt() { return standstill_.halt(); }
  const Rest& resting() const { return standstill_.rest(); }
  Outgoing& outgoing() { return outgoing_; }
  Line& line() { return line_; }
  const Line& line() const { return line_; }
  const Tick& tick() const { return tick_; }
  const RobotNames& robot() const { return robot_; }
  const RateLimiter* rates() const { return limiter_.get(); }
  // Answer of the solver in this tick, null if it did not run.
  const Answered* answered() const { return answered_ ? &answer_ : nullptr; }
  std::size_t plain_notes() const { return plain_notes_; }  // count of notes before those on joint limits
  bool ordinary() const { return ordinary_; }
  // Describe the number of a state that is too large, "" if all are ordinary.
  std::string too_large(const double* q, const double* v, const double* angles) {
    Note why;
    return check_.within(q, v, angles, why) ? "" : why.text();
  }

 protected:
  ~SessionState() = default;

  std::shared_ptr<const void> kept_;  // first: the parts point into it
  Foreign* foreign_;
  Line line_;
  RobotNames robot_;
  StateCheck check_;
  Latest latest_;
  LeftOut left_out_;
  Standstill standstill_;
  std::unique_ptr<MotorLimits> motors_;
  std::unique_ptr<JerkLimiter> jerk_;
  std::unique_ptr<RateLimiter> limiter_;
  Following following_;
  Timing timing_;
  Inputs inputs_;
  LimitNotes limits_;
  Outgoing outgoing_;
  Tick tick_;
  Answered answer_{};
  std::size_t plain_notes_ = 0;
  bool aside_ = false, answered_ = false;
  bool ordinary_ = false;   // the last tick had an answer with all tasks within reach
  bool age_noted_ = false;  // a note on states of any age was sent

 private:
  void share() {
    CarryOver state = CarryOver::to_first(initial_);
    keep(state);
  }
  WarmState initial_, initial_rows_;
};

}  // namespace hqp
