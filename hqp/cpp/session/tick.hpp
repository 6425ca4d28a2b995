// Result of one step: a command, a status, and notes that name the culprits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace hqp {

// Status of a tick, as hqp.Status; later ones are worse.
enum class Status {
  kOptimal,
  kRankUncertain,
  kNotStrict,
  kConstraintsViolated,
  kInvalidReference,
  kInvalidElement,
  kContactLost,
  kIterationLimit,
  kTimeLimit,
  kNotCertified,
  kDynamicsFailed,
  kNotFollowing,
  kInvalidState,
  kStopped,
};
constexpr std::size_t kStatuses = std::size_t(Status::kStopped) + 1;

// As Python spells it: "OPTIMAL", ...
const char* name(Status status);
// Return true if the answer is the optimum of the tick's problem.
constexpr bool solved(Status status) {
  return status <= Status::kRankUncertain || status == Status::kConstraintsViolated;
}

// Numbers that a tick owns, valid until the next step.
template <class T>
class View {
 public:
  View(const T* data, std::size_t size) : data_(data), size_(size) {}
  const T* data() const { return data_; }
  std::size_t size() const { return size_; }
  const T& operator[](std::size_t i) const { return data_[i]; }
  const T* begin() const { return data_; }
  const T* end() const { return data_ + size_; }

 private:
  const T* data_;
  std::size_t size_;
};

enum class Cause {
  kNotFinite,   // a number of q, or of the answer
  kNotFiniteV,  // a number of v
  kTooLarge,    // q and v, to be squared
  kQuaternion,  // quaternion not of length 1
  kPair,        // cosine and sine not of length 1
  kPosition,    // beyond its bounds
  kVelocity,
  kBase,       // too far off
  kNoTime,     // the state has no time
  kAhead,      // it is that of later
  kAge,        // it is that of long ago
  kReference,  // not finite: its hold value was taken, or it was left out
  kRotation,   // the value is not a rotation
  kJacobian,   // not finite or too large: the element was left out
  kDemand,     // the same
  kBounds,     // NaN or crossed: it was left out
  kOff,        // a constraint is violated, where: by the limit of that name
  kRate,       // the command would change faster than it may
  kMotor,      // the command would exceed a limit of its motor
  kJerk,       // a limit or row, where, excludes the limit of jerk
  kContact,    // it has carried nothing
  kRestless,   // its command alternates from limit to limit
  kOverrun,    // its position limit will be passed, where: by so many of that unit
  kOutside,    // it is outside its position limits, where: by so many of that unit
  kReturns,    // it is outside them as well, and the command leads it back
  kSolver,     // see the status
  kDynamics,   // the inertia is not positive definite
  kNoState,    // no good state so far
  kStopped,    // a stop holds the robot, where: its reason
  kStart,      // no command was known before the first tick
  kAnyAge,     // states have a time, but no limit of their age is declared
  kFollow,     // the joint of that name does not follow its command
  kForeign,    // a fault of rows written in Python
  kBears,      // a contact on its way out still carries a force [N] and, in `most`, a moment [N m]
};

// A row that is off: its name and by how much; of_shapes: true if it has a distance [m].
struct NotedRow {
  const char* name;
  double amount;
  bool of_shapes;
  double distance;
};

// Problem of an element, joint or part; made without allocation, its text by text().
struct Note {
  const char* element = "";
  Status status = Status::kOptimal;
  Cause cause = Cause::kSolver;
  const char* where = "";                          // the row, joint, limit or unit, "" for none
  double amount = 0.0, allowed = 0.0, most = 0.0;  // allowed: the least, if `most` is given
  bool left_out = false;                           // left out of this tick
  int row = 0;                                     // row of the element
  // Violated rows of subject_to, the worst first, and their count; 0 for rows without names.
  NotedRow rows[3] = {};
  int row_count = 0;

  std::string text() const;
  bool same(const Note& other) const {
    return std::strcmp(element, other.element) == 0 && status == other.status && cause == other.cause &&
           std::strcmp(where, other.where) == 0 && amount == other.amount && allowed == other.allowed &&
           most == other.most && left_out == other.left_out && row == other.row && row_count == other.row_count;
  }
};

class Tick {
 public:
  // (actuated,) in the order of Session::joint_names(): velocities, accelerations or torques.
  View<double> command() const { return {command_.data(), command_.size()}; }
  View<double> x() const { return {x_.data(), x_.size()}; }  // the answer that the command is part of
  Status status() const { return status_; }                  // the worst of the tick
  bool solved() const { return hqp::solved(status_); }
  View<Note> notes() const { return {notes_.data(), note_count_}; }
  // ||w|| of every level of the hierarchy, of the solver's answer.
  View<double> residuals() const { return {residuals_.data(), residuals_.size()}; }
  View<std::int8_t> marks() const { return {marks_.data(), marks_.size()}; }  // per row: -1, 0, 1, 2 (equality)
  std::int64_t count() const { return count_; }  // number of the tick in its session, from 1
  std::int64_t held() const { return held_; }    // for how many ticks the command has been coming to rest

 private:
  friend class Guarded;
  friend class SessionState;
  friend class Transition;
  static constexpr std::size_t kNotes = 16;

  void add(const Note& note) {
    if (note_count_ < notes_.size()) notes_[note_count_++] = note;
  }

  std::vector<double> command_, x_, residuals_;
  std::vector<std::int8_t> marks_;
  std::vector<Note> notes_{kNotes};
  std::size_t note_count_ = 0;
  Status status_ = Status::kOptimal;
  std::int64_t count_ = 0, held_ = 0;
};

}  // namespace hqp
