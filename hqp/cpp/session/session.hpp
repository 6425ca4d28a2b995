// A session from a plan's file: a state in, a command out, without Python (docs/plan_file.md).
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "counters.hpp"
#include "errors.hpp"
#include "tick.hpp"

namespace hqp {

class Plan;
class Stacks;

// Enables a template for vectors with data() only.
template <class Vector>
using Data = decltype(std::declval<const Vector&>().data());

// Reference of one element; valid as long as its session. Its numbers hold for the next step only.
class Reference {
 public:
  // The value as the element's reference has it (Python's Element.at(...).value, row by row), then velocity [per s] and
  // acceleration [per s^2] of its rows. Throws ReferenceError for a wrong size.
  template <class Value, class = Data<Value>>
  void at(const Value& value) {
    set(kValue, value.data(), value.size());
  }
  template <class Value, class Rate, class = Data<Rate>>
  void at(const Value& value, const Rate& velocity) {
    at(value);
    set(kVelocity, velocity.data(), velocity.size());
  }
  template <class Value, class Rate, class Change, class = Data<Change>>
  void at(const Value& value, const Rate& velocity, const Change& acceleration) {
    at(value, velocity);
    set(kAcceleration, acceleration.data(), acceleration.size());
  }
  // Typed values: a place [m] (Position, Com, the like), a rotation matrix row by row (Orientation), both (Pose),
  // angles [rad] or places [m] of joints in the order of the element (Posture). Each throws ReferenceError for an
  // element whose value has another size.
  void position(const std::array<double, 3>& place) { set(kValue, place.data(), 3); }
  void orientation(const std::array<double, 9>& rotation) { set(kValue, rotation.data(), 9); }
  void pose(const std::array<double, 3>& p, const std::array<double, 9>& R) {
    const double value[16] = {R[0], R[1], R[2], p[0], R[3], R[4], R[5], p[1], R[6], R[7], R[8], p[2], 0, 0, 0, 1};
    set(kValue, value, 16);
  }
  void joints(const std::vector<double>& angles) { set(kValue, angles.data(), angles.size()); }
  // Linear [m/s], then angular velocity [rad/s], both in the axes of the element.
  void twist(const std::array<double, 6>& rate) { set(kVelocity, rate.data(), 6); }
  void at(std::initializer_list<double> value) { set(kValue, value.begin(), value.size()); }
  void at(const double* value, std::size_t size) { set(kValue, value, size); }
  void velocity(const double* value, std::size_t size) { set(kVelocity, value, size); }
  void acceleration(const double* value, std::size_t size) { set(kAcceleration, value, size); }
  // The ground's normal (3,), of wheels.
  void normal(const double* value) { set(kNormal, value, 3); }
  // The load that a contact carries [N].
  void load(double newtons) { set(kLoad, &newtons, 1); }
  // Set the presence of the element and its followers in the next step. Throws ReferenceError for a contact at torque
  // level: contacts switch by phases.
  void on(bool in);
  // Set the hold value for steps without a reference.
  void hold(const double* value, std::size_t size) { set(kHold, value, size); }

  std::size_t size() const;                 // count of numbers in a value
  const std::vector<double>& held() const;  // the hold value
  const std::string& name() const;

 private:
  friend class Session;
  friend class Inputs;
  friend class References;
  friend class Stacks;
  enum What { kValue, kVelocity, kAcceleration, kNormal, kLoad, kHold };

  Reference(Stacks& session, std::size_t element) : session_(&session), element_(element) {}
  void set(What what, const double* values, std::size_t size);

  Stacks* session_;
  std::size_t element_;
};

class Session {
 public:
  explicit Session(std::shared_ptr<const Plan> plan);
  ~Session();
  Session(Session&&) noexcept;
  Session& operator=(Session&&) noexcept;

  // Throws ReferenceError for a name that the plan does not have.
  Reference reference(const std::string& name);

  // The phase of the steps from now on, by which levels and elements with a `when` are in or out, "" for none; throws
  // ReferenceError for one that the plan does not have.
  void phase(const std::string& name);

  // Start from the command (actuated,) that the robot is sent now: rate limits, braking, and at velocity level the
  // acceleration window. q (nq), v (nv): its state, null if unknown. Without it a torque session starts from the torque
  // that holds the robot. Throws ReferenceError for numbers that are not finite or no state.
  void begin(const double* command, const double* q = nullptr, const double* v = nullptr);
  template <class Command, class Vector, class = Data<Command>>
  void begin(const Command& command, const Vector& q, const Vector& v) {
    begin(command.data(), q.data(), v.data());
  }

  // Switch to the stack of that name, "" for the first one, at once or within `over` seconds at least; see Python's
  // Session.change. It may allocate. Throws ReferenceError for a name that the plan does not have or a bad duration.
  void change(const std::string& stack, double over = 0.0);
  // Progress of a change of stack, 1 without one.
  double transition() const noexcept;
  std::vector<std::string> stacks() const;  // names of the stacks, "" first

  // One tick for q (nq) and v (nv): no allocation, no exception, no lock, no system call but the clock's.
  const Tick& step(const double* q, const double* v) noexcept;
  // Step with the time of the state [s], which plans with a max_age require, on the clock of now
  // (std::chrono::steady_clock by default).
  const Tick& step(const double* q, const double* v, double time) noexcept;
  const Tick& step(const double* q, const double* v, double time, double now) noexcept;
  template <class Vector, class... Times, class = Data<Vector>>
  const Tick& step(const Vector& q, const Vector& v, Times... times) noexcept {
    return step(q.data(), v.data(), times...);
  }
  const Tick& tick() const;

  // Ticks, late and held ones, rejected data and longest times since the session was made; reset() keeps them. Any
  // thread may read them.
  Counts counters() const noexcept;
  // The number of ticks that have ended: it rises with every tick of any status. A watchdog in another thread
  // that sees the same value for longer than a few periods knows that the loop has stopped.
  std::int64_t heartbeat() const noexcept;

  // q + dt v into out (nq).
  void integrate(const double* q, const double* v, double dt, double* out) const;
  // Bring the robot to rest from the next step on and hold it there, with status kStopped, until resume(). Any thread
  // may stop, resume and read the reason, "" while the session runs.
  void stop(const std::string& reason = "stop");
  void resume();
  std::string stopped() const;
  // Forget warm start, hold values and the last command. A stop stays.
  void reset();

  std::size_t levels() const;  // largest number of levels of a stack, those on the way of a change included
  int nq() const;
  int nv() const;
  double dt() const;
  const std::string& robot() const;
  // Fingerprint of joint names, limits and masses of the robot that the plan was written for: compare it with Python's
  // hqp.fingerprint(robot) of the robot that is to move, before the loop.
  const std::string& fingerprint() const { return fingerprint_; }
  const std::vector<std::string>& joint_names() const;  // in the order of a command
  std::vector<std::string> names() const;               // names of elements with a reference
  const std::vector<double>& home() const;              // (nq)

 private:
  std::unique_ptr<Stacks> stacks_;
  std::string fingerprint_;
};

// A plan from its file, to be shared by sessions; throws PlanError with a sentence. With a key it refuses a file that
// was not signed with that key (HMAC-SHA-256).
std::shared_ptr<const Plan> read(const std::string& path, const std::string& key = "");
// A session of its own from a file.
Session load(const std::string& path, const std::string& key = "");

}  // namespace hqp
