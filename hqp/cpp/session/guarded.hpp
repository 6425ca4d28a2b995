// One tick of a session: check the state, write references and rows, solve, limit and send the command.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "budget.hpp"
#include "counters.hpp"
#include "guard_parts.hpp"
#include "halt.hpp"
#include "left_out.hpp"
#include "outgoing.hpp"
#include "phase_laws.hpp"
#include "presence.hpp"
#include "references.hpp"

namespace hqp {

// A session or its stacks from a plan; throws PlanError if the plan is inconsistent.
template <class Made, class From>
std::unique_ptr<Made> made(const From& from) {
  try {
    return std::make_unique<Made>(from);
  } catch (const PlanError&) {
    throw;
  } catch (const std::exception& error) {  // a part rejects its numbers, or memory is exhausted
    throw PlanError(std::string("cannot make a session of the plan: ") + error.what());
  }
}

class Guarded {
 public:
  template <class Source>
  explicit Guarded(const Source& source) : Guarded(source.root(), source) {}

  template <class Node, class Source>
  Guarded(const Node& root, const Source& source)
      : kept_(source.kept()),
        foreign_(source.foreign()),
        live_(Source::kLive),
        line_(root, source.parts(), foreign_),
        robot_(RobotNames::of(root, line_)),
        check_(state_check(root, line_)),
        rest_(hqp::rest(root, line_, robot_)),
        motors_(motor_limits(root, line_, robot_)),
        halt_(hqp::halt(root, line_)),
        limiter_(rate_limiter(root, line_, robot_)),
        following_(follow_watch(root, line_, robot_)),
        deadline_(root.part("guards").number("deadline")),
        budget_(deadline_),
        q_(std::size_t(line_.nq())),
        v_(std::size_t(line_.nv())),
        good_q_(q_.size()),
        good_v_(v_.size()),
        x_(std::size_t(line_.size())),
        start_(x_.size()),
        angles_(v_.size()),
        references_(line_, live_),
        contacts_(contact_watch(line_)),
        limits_(limit_watch(line_)),
        left_out_(line_, foreign_),
        outgoing_(hqp::outgoing(root, line_, robot_)),
        presence_(root, line_.members()),
        laws_(root, line_, presence_.names().size()),
        out_(line_.members().size(), false),
        named_(out_.size(), false),
        naming_(out_.size(), false) {
    over_.reserve(v_.size());
    tick_.command_.resize(robot_.picks.size());
    tick_.x_.resize(x_.size());
    tick_.residuals_.resize(line_.levels().size());
    tick_.marks_.resize(line_.rows());
    tick_.notes_.resize(Tick::kNotes + 2 * limits_.size());
    CarryOver state = CarryOver::to_first(initial_);
    keep(state);
  }

  // Facts about a state besides q and v.
  struct Told {
    const double* time = nullptr;    // [s], null if unknown
    double now = 0.0;                // time of the tick [s]
    const double* angles = nullptr;  // of q, if the line has no kinematics
    const char* fault = nullptr;     // reason why the state is invalid, null if unknown
  };
  const Tick& step(const double* q, const double* v) { return step(q, v, Told{}); }
  const Tick& step(const double* q, const double* v, const Told& told) {
    const Tick& tick = stepped(q, v, told);
    if (!aside_) {
      const bool cut = answered_ && (answer_.status == Status::kIterationLimit || answer_.status == Status::kTimeLimit);
      counters_->take({seconds(begin_), seconds(Clock::now()), cut, tick.held_ > 0, refused_, rejected_}, line_.dt());
    }
    return tick;
  }

  // Carry the session's state over to the next tick, without pending references and without the rows' state.
  void keep(CarryOver& state) {
    state.take(good_), state.take(placed_), state.take(ordinary_), outgoing_.trend().keep(state);
    state.take(tick_.count_), state.take(tick_.held_);
    state.take(x_.data(), x_.size());
    if (tick_.held_ > 0) rest_->keep(state);
    if (placed_) state.take(good_q_.data(), good_q_.size()), state.take(good_v_.data(), good_v_.size());
    contacts_.keep(state);
    limits_.keep(state);
    references_.keep(state), presence_.keep(state);
  }
  // Carry the state of rows and solver over, which sessions of one stack share.
  void keep_rows(CarryOver& state) {
    line_.assembly().keep(state);
    line_.solver()->keep(state);
  }

  // Start from the command that the robot is sent now: rates, braking, and at velocity level the window of
  // acceleration.  q, v: its state, null if unknown; angles: of q, if the line has no kinematics.  Throws
  // ReferenceError for a command or a state that is not valid.
  void begin(const double* command, const double* q, const double* v, const double* angles = nullptr) {
    Note why;
    if (!(squared(command, int(robot_.picks.size())) < std::numeric_limits<double>::infinity()))
      throw ReferenceError("the command is not finite");
    if (q) {
      std::copy(q, q + q_.size(), q_.begin());
      if (!check_.valid(q_.data(), v, angles, why)) throw ReferenceError("the state is not valid: " + why.text());
      good_q_ = q_, std::copy(v, v + v_.size(), good_v_.begin());
    }
    placed_ = q != nullptr;
    std::fill(x_.begin(), x_.end(), 0.0);
    if (q && line_.order() == 1) std::copy(v, v + v_.size(), x_.begin());
    for (std::size_t i = 0; i < robot_.picks.size(); ++i) x_[std::size_t(robot_.picks[i])] = command[i];
    tick_.x_ = start_ = x_;
    std::copy(command, command + tick_.command_.size(), tick_.command_.begin());
    tick_.held_ = 0, good_ = true, answered_ = false;
    outgoing_.trend().forget();
    if (following_) following_->reset();
  }

  // Store a field of an element's next reference, its hold value or its measured load; throws ReferenceError.
  void set(std::size_t member, int field, const double* values, std::size_t size) {
    if (field != Reference::kHold) name(member);
    if (field != Reference::kLoad) return references_.set(member, field, values, size);
    const Member& contact = line_.members()[member];
    if (!contact.contact) throw ReferenceError(contact.name + " is not a contact: it takes no measured load");
    contacts_.measure(member, values[0]);
  }
  // Set the presence of an element in the next tick. At torque level contacts switch by phases, which are checked to
  // leave enough of them.
  void say(std::size_t member, bool in) {
    const Member& told = line_.members()[member];
    if (line_.torque() && told.level < 0 && !live_)
      throw ReferenceError(told.name + ": switch a contact at torque level by phases, not by on()");
    name(member), presence_.say(member, in);
  }
  // The element has a reference in the next tick.
  void name(std::size_t member) { naming_[member] = true; }
  bool named(std::size_t member) const { return naming_[member]; }
  // Set the phase of the following ticks, "" for none.
  void phase(const std::string& name) { presence_.phase(name); }
  bool knows(const std::string& phase) const { return presence_.knows(phase); }

  // Forget what is stored for the next tick.
  void forget() {
    references_.forget(), presence_.forget();
    naming_.assign(naming_.size(), false);
  }
  References& references() { return references_; }
  const References& references() const { return references_; }
  ContactWatch& contacts() { return contacts_; }
  Outgoing& outgoing() { return outgoing_; }

  // Finish every answer from now on, and accept states of any age.
  void without_deadline() {
    check_.of_any_age(), following_.reset();
    deadline_ = std::numeric_limits<double>::infinity();
    budget_ = Budget(deadline_);
    line_.solver()->limit(0.0);
  }

  // The first session of a stack, whose rows and solver are as new.
  void first() {
    CarryOver rows = CarryOver::to_first(initial_rows_);
    keep_rows(rows);
    line_.solver()->make_room(out_.size());
  }
  // Return to the state after construction; a stop stays.
  void reset() { renew(), reset_rows(), pause(); }
  void reset_rows() {
    line_.solver()->reset();
    CarryOver state = CarryOver::from_first(initial_rows_);
    keep_rows(state);
  }
  // Return to the state after construction, but for rows and solver.
  void renew() {
    CarryOver state = CarryOver::from_first(initial_);
    keep(state);
    fresh_ = true, timed_ = ordinary_ = false;
    alone(x_.data()), all_in();
    forget(), references_.forget_all(), presence_.forget_all();
    laws_.reset();
    if (following_) following_->reset();
  }
  // Another session of the stack begins or works: no element is out of the shared rows now.
  void all_in() {
    out_.assign(out_.size(), false);
    line_.go_without(out_), attended_ = false;
  }
  // Another session of its stack will write into the rows; before the first tick.
  void share() {
    references_.share();
    CarryOver state = CarryOver::to_first(initial_);
    keep(state);
  }
  // Share counters and stops with another session.
  void join(const Guarded& other) {
    if (halt_ != other.halt_) counters_ = other.counters_, halt_ = other.halt_;  // other threads may read them
  }
  void pause() { counters_->pause(); }

  // Continue from another session of the robot, after x was sent.
  void follow(const Guarded& other, const double* x) {
    std::copy(x, x + x_.size(), x_.begin());
    good_ = other.good_, good_q_ = other.good_q_, good_v_ = other.good_v_;
    placed_ = other.placed_, timed_ = other.timed_, budget_ = other.budget_;
    tick_.count_ = other.tick_.count_, tick_.held_ = other.tick_.held_;
    join(other);
    told_of_age_ = other.told_of_age_;
    if (following_ && other.following_) *following_ = *other.following_;
  }

  // Run beside a session that blends both answers: without rate limits, in half of the time.
  void aside() {
    attended_ = false;  // the other session may share its rows
    if (!std::exchange(aside_, true)) budget_ = Budget(0.5 * budget_.deadline());
  }
  // Run alone again, after x was sent: references hold for one tick.
  void alone(const double* x) {
    aside_ = false, lasting(false), line_.ahead(nullptr);
    if (budget_.deadline() != deadline_) budget_ = Budget(deadline_);
    std::copy(x, x + x_.size(), x_.begin());
    tick_.held_ = 0;
  }
  // See References::lasting.
  void lasting(bool lasts) { references_.lasting(lasts), presence_.lasting(lasts); }
  // Take over the last references of another stack, but for elements that have one in the next tick.
  void adopt(const Guarded& other) { references_.adopt(other.references_, naming_); }
  // Hold these elements in the next tick where they are, unless they have a reference.
  void hold_here(const std::vector<std::string>& names) {
    for (std::size_t m = 0; m < out_.size(); ++m)
      if (std::find(names.begin(), names.end(), line_.members()[m].name) != names.end()) here_.push_back(m);
  }
  // Come to rest if a blend of two sessions has no usable answer.  last: x of the tick before; held: ticks since then;
  // fit: true if the latest state is valid.
  const Tick& rest(const double* last, bool good, std::int64_t held, bool fit, Status why) {
    tick_.note_count_ = 0;
    tick_.status_ = why;
    const auto start = [&] { return fit || placed_ ? from(!fit) : RestFrom{}; };
    outgoing_.rest(*rest_, start, fit, held, why, {last, good, tick_.count_}, limiter_.get(), tick_.x_.data(),
                   [this](const Note& why_not) { note(why_not); });
    tick_.held_ = held;
    return tick_;
  }

  // Answer of the solver in this tick, null if it did not run; times of rows and solver [s] since the tick's begin.
  const Answered* answered() const { return answered_ ? &answer_ : nullptr; }
  std::size_t plain_notes() const { return plain_notes_; }  // count of notes before those on joint limits
  double begun() const { return seconds(begin_); }
  double filling() const { return std::chrono::duration<double>(filled_ - begin_).count(); }
  double solving() const { return std::chrono::duration<double>(solved_ - filled_).count(); }
  const std::vector<double>& q() const { return q_; }  // of the tick, normalised
  const std::vector<double>& v() const { return v_; }
  const std::vector<double>& sent() const { return x_; }  // last
  Halt& halt() { return *halt_; }
  const Counters& counters() const { return *counters_; }
  // Count a tick that blends this session with another one.
  void count(const Counters::Ended& blend) { counters_->take(blend, line_.dt()); }
  static double now() { return seconds(Clock::now()); }
  // The x that the first tick's rates start from.
  const std::vector<double>& start() const { return start_; }
  bool good() const { return good_; }
  bool ordinary() const { return ordinary_; }
  const RateLimiter* rates() const { return limiter_.get(); }
  const Budget& budget() const { return budget_; }
  // Describe the number of a state that is too large, "" if all are ordinary.
  std::string too_large(const double* q, const double* v, const double* angles) {
    Note why;
    return check_.within(q, v, angles, why) ? "" : why.text();
  }

  Line& line() { return line_; }
  const Tick& tick() const { return tick_; }
  const RobotNames& robot() const { return robot_; }
  const Line& line() const { return line_; }

 private:
  using Clock = std::chrono::steady_clock;

  static double seconds(Clock::time_point time) {
    return std::chrono::duration<double>(time.time_since_epoch()).count();
  }
  void limit(double seconds) {
    if (line_.solver()) line_.solver()->limit(seconds);
    else foreign_->limit(seconds);
  }
  double left() const {  // time for the solver; work before the first answer is slow and does not count
    return budget_.left(timed_ ? std::chrono::duration<double>(Clock::now() - begin_).count() : 0.0);
  }

  const Tick& stepped(const double* q, const double* v, const Told& told) {
    begin_ = filled_ = solved_ = Clock::now();
    rejected_ = 0, refused_ = false;
    ++tick_.count_;
    tick_.note_count_ = 0;
    tick_.status_ = Status::kOptimal;
    answered_ = false;
    named_.swap(naming_);
    naming_.assign(naming_.size(), false);
    std::copy(q, q + q_.size(), q_.begin());
    std::copy(v, v + v_.size(), v_.begin());
    Note why;
    if (told.fault) why = {"state", Status::kInvalidState, Cause::kForeign, told.fault};
    if (following_) following_->pass(told.now);
    if (told.fault || !check_.check(q_.data(), v_.data(), told.time, told.now, told.angles, why) ||
        !follows(told.angles, why)) {
      references_.skip(named_), presence_.take(named_), here_.clear();
      refused_ = why.status == Status::kInvalidState;
      return held_tick(why, false);
    }
    if (told.time && check_.any_age() && !std::exchange(told_of_age_, true))
      note({"session", Status::kOptimal, Cause::kAnyAge});
    if (fresh_ && budget_.limited()) budget_.begin(thread_time());
    else budget_.skip();
    laws_.obey(presence_.phase(), attended_ ? &out_ : nullptr);
    attend(presence_.take(named_));
    if (!good_ && tick_.count_ == 1) hold_up();
    if (halt_->why()) {
      references_.skip(named_), here_.clear();
      return held_tick({}, true);
    }
    for (const std::size_t m : here_)
      if (!named_[m] && !out_[m] && line_.members()[m].slot >= 0)
        references_.hold_here(std::size_t(line_.members()[m].slot));
    here_.clear();
    references_.take_holds(q_.data(), v_.data());
    references_.apply(out_, named_, left_out_.flags(), report());
    if (foreign_ && foreign_->fills) return filled_in_python();
    line_.write(q_.data(), v_.data(), around());
    if (foreign_ && foreign_->writes ? foreign_->failed || !line_.assembly().usable() : !line_.assembly().small())
      left_out_.unusable(report());
    left_out_.free();
    filled_ = Clock::now();
    if (budget_.limited()) limit(left());
    Solved found = line_.solve(v_.data());
    if (found.outcome == kInvalid && !line_.torque()) {
      left_out_.unusable(report());
      found = line_.solve(v_.data());
    }
    return conclude(found);
  }

  void note(const Note& note) {
    rejected_ += note.status == Status::kInvalidReference;
    if (tick_.note_count_ < tick_.notes_.size()) tick_.notes_[tick_.note_count_++] = note;
    if (note.status > tick_.status_) tick_.status_ = note.status;
  }
  struct Report {
    Guarded* session;
    void operator()(const Note& why) const { session->note(why); }
  };
  Report report() { return {this}; }
  const RateLimiter* limiter() const { return aside_ ? nullptr : limiter_.get(); }
  Before before() const { return {x_.data(), good_, tick_.count_}; }

  // Start a torque session without a known command from the torque that holds the robot up.
  void hold_up() {
    if (!line_.torque() || !(limiter_ || aside_)) return;
    rest_->begin(at(false), x_.data(), true);
    rest_->next(x_.data());
    start_ = x_;
    note({"session", Status::kOptimal, Cause::kStart});
  }
  // Return false, and the reason, if the measured joints do not follow their command. Beside another session the
  // command is a blend that this one does not know.
  bool follows(const double* angles, Note& why) {
    if (!following_) return true;
    if (aside_) return following_->reset(), true;
    if (!angles) line_.kinematics()->angles(q_.data(), angles_.data()), angles = angles_.data();
    return following_->follow(angles, v_.data(), why, report());
  }
  // Pass the motion that the sent x demands of the motors. solved: true if the dynamics are those of this tick.
  void followed(bool solved) {
    if (!following_) return;
    const double* x = tick_.x_.data();
    const TorqueParts* torque = line_.torque();
    if (torque && (!solved || (foreign_ && foreign_->fills))) return following_->unknown();
    following_->sent([&](std::size_t joint) { return torque ? torque->acceleration(joint, x) : x[joint]; },
                     [&](std::size_t motor) { return torque->felt(motor); });
  }

  // Switch elements off and on for this tick; returning elements hold their present value.
  void attend(const Presence::Out& asked) {
    if (asked == out_ && attended_) return;
    const Presence::Out& out = supported(asked);
    if (out == out_ && attended_) return;
    attended_ = true;
    line_.go_without(out);
    if (line_.solver()) line_.solver()->turn(out);
    if (foreign_) foreign_->go_without(out);
    for (std::size_t m = 0; m < out.size(); ++m) {
      const int slot = line_.members()[m].slot;
      contacts_.judge(m, out[m]);
      if (slot >= 0 && out_[m] && !out[m]) references_.renew(std::size_t(slot));
    }
    out_ = out;
  }

  // Return the elements that may leave; report the contacts that must stay.
  const Presence::Out& supported(const Presence::Out& asked) {
    if (!foreign_ || !line_.torque()) return asked;
    rest_of_ = asked;
    const char* why = foreign_->supported(rest_of_, stay_);
    for (std::size_t m = 0; why && m < stay_.size(); ++m)
      if (stay_[m]) note({line_.members()[m].name.c_str(), Status::kInvalidReference, Cause::kForeign, why});
    return why ? rest_of_ : asked;
  }

  // Solve rows that Python fills.
  const Tick& filled_in_python() {
    const char* why = foreign_->fill(left_out_.flags());
    if (!why && foreign_->failed) {
      left_out_.faulty(report());
      why = foreign_->fill(left_out_.flags());
    }
    if (why) return held_tick({"robot", Status::kDynamicsFailed, Cause::kForeign, why}, false);
    filled_ = Clock::now();
    if (budget_.limited()) limit(left());
    return conclude(line_.run(v_.data()));
  }

  const Tick& conclude(const Solved& found) {
    if (found.outcome == kInvalid) {
      const bool dynamics = line_.torque() != nullptr;
      return held_tick({dynamics ? "robot" : "solver", dynamics ? Status::kDynamicsFailed : Status::kNotCertified,
                        dynamics ? Cause::kDynamics : Cause::kNotFinite},
                       !dynamics);
    }
    answer_ = line_.answer(found), answered_ = true;
    solved_ = Clock::now();
    line_.residuals(answer_.slack, tick_.residuals_.data());
    std::copy(answer_.marks, answer_.marks + tick_.marks_.size(), tick_.marks_.begin());
    const auto here = [this] { return from(false); };
    if (!outgoing_.take(answer_, before(), *rest_, here, contacts_, motors_.get(), line_.torque() ? nullptr : around(),
                        limiter(), tick_.x_.data(), report()))
      return held_tick({}, true);
    plain_notes_ = tick_.note_count_;
    ordinary_ = answer_.point_count == 0;
    limits();
    send();
    followed(true);
    if (budget_.limited() && answer_.status != Status::kOptimal)
      budget_.end(thread_time(), answer_.status == Status::kTimeLimit);
    fresh_ = answer_.status != Status::kOptimal;
    std::copy(q_.begin(), q_.end(), good_q_.begin());
    std::copy(v_.begin(), v_.end(), good_v_.begin());
    good_ = placed_ = timed_ = true;
    tick_.held_ = 0;
    return tick_;
  }

  void send() {
    std::copy(tick_.x_.begin(), tick_.x_.end(), x_.begin());
    for (std::size_t i = 0; i < robot_.picks.size(); ++i) tick_.command_[i] = x_[std::size_t(robot_.picks[i])];
  }

  // Come to rest: no answer is usable.  fit: true if this state is valid.
  const Tick& held_tick(const Note& why, bool fit) {
    if (why.status != Status::kOptimal) note(why);
    fresh_ = true, ordinary_ = false;
    halt_->rested(++tick_.held_);
    if (const char* stopped = halt_->why()) note(halt_->note(stopped));
    const auto start = [&] { return fit || placed_ ? from(!fit) : RestFrom{}; };
    outgoing_.rest(*rest_, start, fit, tick_.held_, why.status, before(), limiter(), tick_.x_.data(), report());
    send();
    followed(false);
    return tick_;
  }

  // Velocity at the centre of the limits' windows.
  const double* around() const { return line_.order() == 1 && good_ ? x_.data() : v_.data(); }
  // State at the begin of braking: the tick's, or the last valid one.
  RestFrom from(bool last) {
    const RestFrom found = at(last);
    if (live_ && line_.torque() && !last && !elsewhere()) {
      line_.write(q_.data(), v_.data(), around());  // explanations read the rows of this tick
      left_out_.free();
      line_.rewrite(v_.data());
    }
    return found;
  }
  bool elsewhere() const { return foreign_ && (foreign_->fills || !line_.kinematics()); }  // Python has the state
  RestFrom at(bool last) {
    if (elsewhere()) return foreign_->start(last);
    const double *q = last ? good_q_.data() : q_.data(), *v = last ? good_v_.data() : v_.data();
    RestFrom found;
    line_.kinematics()->angles(q, angles_.data());
    found.angles = angles_.data(), found.v = v;
    if (line_.torque() && line_.at_rest(q, v)) found.holding = line_.holding(), found.momentum = line_.momentum();
    return found;
  }

  // Report joint limits that alternate, and limits that cannot be kept.
  void limits() {
    const std::size_t before = tick_.note_count_;
    limits_.look(tick_.marks_.data(), tick_.count_, report());
    if (tick_.note_count_ == before && !limits_.meet()) return;
    for (const Member* member : line_.placed()) {
      if (member->units.empty() || member->operation < 0) continue;
      line_.assembly().overrun(std::size_t(member->operation), q_.data(), around(), over_);
      for (std::size_t i = 0; i < std::min(over_.size(), member->units.size()); ++i) {
        Note why{member->row_names[i].c_str()};
        if (LimitWatch::passed(over_[i], member->units[i].c_str(), why)) note(why);
      }
    }
  }

  std::shared_ptr<const void> kept_;  // first: the parts point into it
  Foreign* foreign_;
  bool live_;  // true if a program writes into the line's arrays between ticks
  Line line_;
  RobotNames robot_;
  StateCheck check_;
  std::unique_ptr<Rest> rest_;
  std::unique_ptr<MotorLimits> motors_;
  std::shared_ptr<Halt> halt_;  // shared by all lines of a session
  std::unique_ptr<RateLimiter> limiter_;
  std::unique_ptr<FollowWatch> following_;
  double deadline_;  // [s], as the plan has it
  Budget budget_;
  std::vector<double> q_, v_, good_q_, good_v_, x_, start_, angles_, over_;
  References references_;
  WarmState initial_, initial_rows_;
  ContactWatch contacts_;
  LimitWatch limits_;
  LeftOut left_out_;
  Outgoing outgoing_;
  Presence presence_;
  PhaseLaws laws_;
  Presence::Out out_, rest_of_, stay_;
  bool refused_ = false;           // true if the state of the tick is not valid
  Presence::Out named_, naming_;   // elements with a reference in this tick, and in the next one
  std::vector<std::size_t> here_;  // elements to be held in the next tick where they are
  // good: x was sent.  placed: good_q_ and good_v_ are known.  timed: an answer was usable before.  ordinary: the last
  // tick had an answer with all tasks within reach.
  bool aside_ = false, good_ = false, placed_ = false, timed_ = false, fresh_ = true, attended_ = false,
       answered_ = false, ordinary_ = false;
  Clock::time_point begin_, filled_, solved_;
  Answered answer_{};
  std::size_t plain_notes_ = 0;
  bool told_of_age_ = false;   // true after the note that states may be of any age
  std::int64_t rejected_ = 0;  // references in this tick
  std::shared_ptr<Counters> counters_ = std::make_shared<Counters>();  // shared by sessions that follow each other
  Tick tick_;
};

}  // namespace hqp
