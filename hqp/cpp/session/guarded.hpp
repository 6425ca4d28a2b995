// The order of a tick: check the state, write references and rows, solve, limit and send the command.
#pragma once

#include <algorithm>
#include <cstdint>
#include <utility>

#include "made.hpp"
#include "session_state.hpp"

namespace hqp {

class Guarded : public SessionState {
 public:
  template <class Source>
  explicit Guarded(const Source& source) : SessionState(source.root(), source) {}

  const Tick& step(const double* q, const double* v, const StateFacts& facts = {}) {
    const Tick& tick = stepped(q, v, facts);
    if (aside_) return tick;
    const bool cut = answered_ && (answer_.status == Status::kIterationLimit || answer_.status == Status::kTimeLimit);
    timing_.count({timing_.begun(), Timing::now(), cut, tick.held_ > 0, refused_, rejected_}, line_.dt());
    return tick;
  }

  // Come to rest if a blend of two sessions has no usable answer.  resting: its braking; last: x of the tick
  // before; held: ticks since then; fit: true if the latest state is valid.
  const Tick& rest(Rest& resting, const double* last, bool good, std::int64_t held, bool fit, Status why) {
    tick_.note_count_ = 0;
    tick_.status_ = why;
    come_to_rest(resting, {last, good, tick_.count_}, fit, held, why, limiter_.get(), reporter());
    tick_.held_ = held;
    return tick_;
  }

  bool limits_jerk() const { return bool(jerk_); }
  // Move a blend of two sessions from the last command with limited jerk and at most `most` changes.
  template <class Report>
  void smooth(const double* last, double most, double* x, const Report& report) {
    outgoing_.smooth(*jerk_, standstill_.from(false).angles, last, most, x, report);
    jerk_->sent(last, x);
  }

 private:
  const Tick& stepped(const double* q, const double* v, const StateFacts& facts) {
    timing_.begin();
    rejected_ = 0, refused_ = answered_ = false;
    ++tick_.count_;
    tick_.note_count_ = 0;
    tick_.status_ = Status::kOptimal;
    inputs_.begin();
    latest_.take(q, v);
    Note why;
    if (facts.fault) why = {"state", Status::kInvalidState, Cause::kForeign, facts.fault};
    following_.begin(facts.now);
    if (facts.fault || !check_.check(latest_.q.data(), latest_.v.data(), facts.time, facts.now, facts.angles, why) ||
        !following_.check(latest_, facts.angles, aside_, why, reporter())) {
      inputs_.skip(false);
      refused_ = why.status == Status::kInvalidState;
      return held(why, false);
    }
    if (facts.time && check_.any_age() && !std::exchange(age_noted_, true))
      report({"session", Status::kOptimal, Cause::kAnyAge});
    timing_.begin_budget();
    inputs_.attend(reporter());
    if (!latest_.good && tick_.count_ == 1) hold_up();
    if (standstill_.halt().why()) {
      inputs_.skip(true);
      return held({}, true);
    }
    inputs_.apply(latest_.q.data(), latest_.v.data(), left_out_.flags(), reporter());
    if (foreign_ && foreign_->fills) return filled_in_python();
    line_.write(latest_.q.data(), latest_.v.data(), latest_.around());
    if (foreign_ && foreign_->writes ? foreign_->failed || !line_.assembly().usable() : !line_.assembly().small())
      left_out_.unusable(reporter());
    left_out_.free();
    begin_solve();
    Solved found = line_.solve(latest_.v.data());
    if (found.outcome == kInvalid && !line_.torque()) {
      left_out_.unusable(reporter());
      found = line_.solve(latest_.v.data());
    }
    return conclude(found);
  }

  // Solve rows that Python fills.
  const Tick& filled_in_python() {
    const char* why = foreign_->fill(left_out_.flags());
    if (!why && foreign_->failed) {
      left_out_.faulty(reporter());
      why = foreign_->fill(left_out_.flags());
    }
    if (why) return held({"robot", Status::kDynamicsFailed, Cause::kForeign, why}, false);
    begin_solve();
    return conclude(line_.run(latest_.v.data()));
  }

  void begin_solve() {
    timing_.filled();
    if (!timing_.limited()) return;
    if (line_.solver()) line_.solver()->limit(timing_.left(latest_.timed));
    else foreign_->limit(timing_.left(latest_.timed));
  }

  const Tick& conclude(const Solved& found) {
    if (found.outcome == kInvalid) {
      const bool dynamics = line_.torque() != nullptr;
      return held({dynamics ? "robot" : "solver", dynamics ? Status::kDynamicsFailed : Status::kNotCertified,
                   dynamics ? Cause::kDynamics : Cause::kNotFinite},
                  !dynamics);
    }
    answer_ = line_.answer(found), answered_ = true;
    timing_.solved();
    line_.residuals(answer_.slack, tick_.residuals_.data());
    std::copy(answer_.marks, answer_.marks + tick_.marks_.size(), tick_.marks_.begin());
    const auto here = [this] { return standstill_.from(false); };
    if (!outgoing_.take(answer_, before(), standstill_.rest(), here, inputs_.contacts(), motors_.get(),
                        line_.torque() ? nullptr : latest_.around(), jerk(), limiter(), tick_.x_.data(), reporter()))
      return held({}, true);
    plain_notes_ = tick_.note_count_;
    ordinary_ = answer_.point_count == 0;
    limits_.look(tick_.marks_.data(), answer_.slack, tick_.count_, latest_.q.data(), latest_.around(), reporter());
    send(true);
    timing_.answered(answer_.status);
    latest_.keep_valid(latest_.v.data());
    latest_.good = latest_.timed = true;
    tick_.held_ = 0;
    return tick_;
  }

  // Come to rest: no answer is usable.  fit: true if this state is valid.
  const Tick& held(const Note& why, bool fit) {
    if (why.status != Status::kOptimal) report(why);
    timing_.unanswered(), ordinary_ = false;
    Halt& halt = standstill_.halt();
    halt.rested(++tick_.held_);
    if (const char* stopped = halt.why()) report(halt.note(stopped));
    come_to_rest(standstill_.rest(), before(), fit, tick_.held_, why.status, limiter(), reporter());
    send(false);
    return tick_;
  }

  template <class Report>
  void come_to_rest(Rest& resting, const Before& before, bool fit, std::int64_t held, Status why,
                    const RateLimiter* limiter, const Report& report) {
    const auto start = [&] { return fit || latest_.placed ? standstill_.from(!fit) : RestFrom{}; };
    outgoing_.rest(resting, start, fit, held, why, before, limiter, tick_.x_.data(), report);
  }
  // Start a torque session without a known command from the torque that holds the robot up.
  void hold_up() {
    if (!line_.torque() || !(limiter_ || aside_)) return;
    standstill_.hold_up(latest_.x.data());
    latest_.start = latest_.x;
    report({"session", Status::kOptimal, Cause::kStart});
  }
  // solved: true if the dynamics are those of this tick.
  void send(bool solved) {
    latest_.send(tick_.x_, robot_.picks, tick_.command_);
    following_.sent(tick_.x_.data(), solved);
  }

  void report(const Note& note) {
    rejected_ += note.status == Status::kInvalidReference;
    tick_.add(note);
    tick_.status_ = std::max(tick_.status_, note.status);
  }
  struct Reporter {
    Guarded* session;
    void operator()(const Note& note) const { session->report(note); }
  };
  Reporter reporter() { return {this}; }
  // Limiters of a command that is sent as it is, not blended.
  JerkLimiter* jerk() const { return aside_ ? nullptr : jerk_.get(); }
  const RateLimiter* limiter() const { return aside_ ? nullptr : limiter_.get(); }
  Before before() const { return {latest_.x.data(), latest_.good, tick_.count_}; }

  bool refused_ = false;       // true if the state of the tick is not valid
  std::int64_t rejected_ = 0;  // references in this tick
};

}  // namespace hqp
